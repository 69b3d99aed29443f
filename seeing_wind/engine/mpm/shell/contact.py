"""Contact of vertices with obstacles: a stiff spring against penetration, and friction.

During a substep a vertex meets each obstacle as its tangent plane nearest to where the vertex is about to be. The spring is a hundred
times as stiff as the vertex's own inertia over the substep, so a vertex at rest sinks in by a hundredth of what it would fall in that time.
Friction is Coulomb's; below the speed `CREEP` it is proportional to the speed, as in Li et al. (2020, ACM Trans. Graph. 39, 49), so what
rests on a slope creeps at up to that speed.

Only vertices touch: a corner of an obstacle may show through a face between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .obstacle import Obstacle

STIFF = 100.0
"""Stiffness of the spring over the vertex's inertia."""
CREEP = 1e-3
"""Speed [m/s] below which friction is not full."""


@dataclass(frozen=True)
class Contact:
    """Pairs of a vertex and a plane during one substep."""

    vertex: np.ndarray
    """(C,) which vertices."""
    normal: np.ndarray
    """(C, 3) unit."""
    level: np.ndarray
    """(C,) value of n.x at which the vertex touches the plane [m]."""
    friction: np.ndarray
    """(C,) Coulomb's coefficient; infinite where the vertex sticks."""
    bound: np.ndarray
    """(C,) bool: a vertex that touches the plane does not leave it."""
    stiffness: np.ndarray
    """(C,) of the spring [N/m]."""
    wall: np.ndarray
    """(C, 3) how far the plane moves in the substep [m]."""
    start: np.ndarray
    """(C, 3) where the vertices are at the substep's start [m]."""
    dt: float

    @classmethod
    def near(
        cls, obstacles: tuple[Obstacle, ...], x: np.ndarray, ahead: np.ndarray, inertia: np.ndarray, dt: float, thickness: float
    ) -> Contact:
        """The planes near vertices at x (V, 3) that are about to be at `ahead` (V, 3) [m]; inertia (V,): mass over time squared [N/m]."""
        found = [obstacle.planes(x, ahead) for obstacle in obstacles]
        vertex, normal, level, friction, bound, velocity = (
            (np.concatenate(part) for part in zip(*found))
            if found
            else (np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, bool), np.zeros((0, 3)))
        )
        return cls(vertex, normal, level + 0.5 * thickness, friction, bound, STIFF * inertia[vertex], dt * velocity, x[vertex], dt)

    def _contact_forces(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Force along the normal (C,) [N], friction over the speed (C,) [N s/m], and which pairs are in contact (C,) bool."""
        gap = (self.normal * x[self.vertex]).sum(axis=1) - self.level
        held = self.bound & ((self.normal * (self.start + self.wall)).sum(axis=1) < self.level + 1e-9)
        on = (gap < 0.0) | held
        press = np.where(on, -self.stiffness * gap, 0.0)
        speed = np.linalg.norm(self._slid(x), axis=1) / self.dt
        sticks = np.isinf(self.friction)
        grip = np.where(sticks, 0.0, self.friction) * np.maximum(press, 0.0) / np.maximum(speed, CREEP)
        return press, np.where(sticks & on, self.stiffness * self.dt, grip), on

    def _slid(self, x: np.ndarray) -> np.ndarray:
        """(C, 3) motion along the plane since the substep's start, relative to the plane [m]."""
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
        """(V, 3, 3) derivative of `force` [N/m], with the ratio of friction to speed taken as constant."""
        blocks = np.zeros((len(x), 3, 3))
        if len(self.vertex):
            _, grip, on = self._contact_forces(x)
            n = self.normal[:, :, None] * self.normal[:, None, :]
            along = (grip / self.dt)[:, None, None]
            np.add.at(blocks, self.vertex, along * (np.eye(3) - n) + np.where(on, self.stiffness, 0.0)[:, None, None] * n)
        return blocks


def contact_normals(contact: Contact, x: np.ndarray) -> np.ndarray:
    """(V, 3) unit normal of the obstacle that each vertex touches, zero where it touches none."""
    normal, on = np.zeros_like(x), contact._contact_forces(x)[2]
    normal[contact.vertex[on]] = contact.normal[on]
    return normal
