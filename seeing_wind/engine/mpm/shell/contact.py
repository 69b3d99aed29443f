"""Vertices against what stands in their way: a stiff spring against entering, and friction.

For a substep each obstacle is the plane that touches it nearest to where the vertex is about to be. The spring is a hundred times as
stiff as the vertex's own inertia over the substep, so a vertex at rest sinks in by a hundredth of what it would fall in that time.
Friction is Coulomb's; below `CREEP` it grows with the speed, as in Li et al. (2020, ACM Trans. Graph. 39, 49), so what rests on a slope
creeps by up to that.

Only vertices touch: a corner of an obstacle may show through a face between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .obstacle import Obstacle

STIFF = 100.0
"""Spring over the vertex's inertia."""
CREEP = 1e-3
"""m/s below which friction is not full."""


@dataclass(frozen=True)
class Contact:
    """Planes before some vertices during one substep."""

    vertex: np.ndarray
    """(C,) which vertices."""
    normal: np.ndarray
    """(C, 3) unit."""
    level: np.ndarray
    """(C,) of n.x at which they touch [m]."""
    friction: np.ndarray
    """(C,) Coulomb's coefficient; infinite where it sticks."""
    bound: np.ndarray
    """(C,) bool: what touches does not leave."""
    stiffness: np.ndarray
    """(C,) [N/m]."""
    wall: np.ndarray
    """(C, 3) how far the plane moves in the substep [m]."""
    start: np.ndarray
    """(C, 3) where the vertices are at the substep's start [m]."""
    dt: float

    @classmethod
    def near(
        cls, obstacles: tuple[Obstacle, ...], x: np.ndarray, ahead: np.ndarray, inertia: np.ndarray, dt: float, thickness: float
    ) -> Contact:
        """The planes near vertices x (V, 3) that are about to be at `ahead` (V, 3); inertia (V,) [N/m] is mass over the square of time."""
        found = [obstacle.planes(x, ahead) for obstacle in obstacles]
        vertex, normal, level, friction, bound, velocity = (
            (np.concatenate(part) for part in zip(*found))
            if found
            else (np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, bool), np.zeros((0, 3)))
        )
        return cls(vertex, normal, level + 0.5 * thickness, friction, bound, STIFF * inertia[vertex], dt * velocity, x[vertex], dt)

    def _contact_forces(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Force along the normal (C,) [N], friction over the speed (C,) [N s/m], and which vertices count (C,) bool."""
        gap = (self.normal * x[self.vertex]).sum(axis=1) - self.level
        held = self.bound & ((self.normal * (self.start + self.wall)).sum(axis=1) < self.level + 1e-9)
        on = (gap < 0.0) | held
        press = np.where(on, -self.stiffness * gap, 0.0)
        speed = np.linalg.norm(self._slid(x), axis=1) / self.dt
        sticks = np.isinf(self.friction)
        grip = np.where(sticks, 0.0, self.friction) * np.maximum(press, 0.0) / np.maximum(speed, CREEP)
        return press, np.where(sticks & on, self.stiffness * self.dt, grip), on

    def _slid(self, x: np.ndarray) -> np.ndarray:
        """(C, 3) way along the plane, as one sees it from there, since the substep's start [m]."""
        way = x[self.vertex] - self.start - self.wall
        return way - (way * self.normal).sum(axis=1, keepdims=True) * self.normal

    def force(self, x: np.ndarray) -> np.ndarray:
        """Minus the forces (V, 3) [N]."""
        r = np.zeros_like(x)
        if len(self.vertex):
            press, grip, _ = self._contact_forces(x)
            np.add.at(r, self.vertex, (grip / self.dt)[:, None] * self._slid(x) - press[:, None] * self.normal)
        return r

    def matrix(self, x: np.ndarray) -> np.ndarray:
        """(V, 3, 3) derivative of `force`, with friction over the speed held."""
        blocks = np.zeros((len(x), 3, 3))
        if len(self.vertex):
            _, grip, on = self._contact_forces(x)
            n = self.normal[:, :, None] * self.normal[:, None, :]
            along = (grip / self.dt)[:, None, None]
            np.add.at(blocks, self.vertex, along * (np.eye(3) - n) + np.where(on, self.stiffness, 0.0)[:, None, None] * n)
        return blocks


def contact_normals(contact: Contact, x: np.ndarray) -> np.ndarray:
    """(V, 3) unit normal of the obstacle that a vertex touches, zero where it touches none."""
    normal, on = np.zeros_like(x), contact._contact_forces(x)[2]
    normal[contact.vertex[on]] = contact.normal[on]
    return normal
