"""Colliders (planes, rooms and closed meshes) as obstacles for a shell's vertices. Meshes may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..lattice.beside import velocity_at
from ..lattice.colliders import Collider
from ..lattice.mesh_collider import MeshCollider
from ..lattice.signed_distance import closest_on

Planes = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Vertices (C,), unit normals (C, 3), the least n.x (C,) that each vertex may have [m], friction (C,), whether a vertex may not leave the
plane once it touches it (C,), and velocities (C, 3) of the planes [m/s]."""


@dataclass(frozen=True)
class Wall:
    """A plane that every vertex may meet."""

    normal: np.ndarray
    """(3,) unit."""
    level: float
    """Vertices stay where n.x is above it [m]."""
    friction: float
    bound: bool

    def planes(self, x: np.ndarray, ahead: np.ndarray) -> Planes:
        """The plane, for those of the vertices at x (V, 3), about to be at `ahead` (V, 3) [m], that come near it."""
        low = np.minimum(x @ self.normal, ahead @ self.normal) < self.level + 0.5 * np.abs(ahead - x).max() + 0.01
        vertex = np.flatnonzero(low)
        count = len(vertex)
        return (
            vertex, np.broadcast_to(self.normal, (count, 3)), np.full(count, self.level), np.full(count, self.friction),
            np.full(count, self.bound), np.zeros((count, 3)),
        )  # fmt: skip

    def at(self, time: float, frame_dt: float) -> Wall:
        """Itself: a wall does not move."""
        return self


@dataclass(frozen=True)
class Block:
    """A closed mesh, for the vertices that come near its bounding box."""

    mesh: MeshCollider
    reach: float
    """Distance [m] from the mesh within which vertices are checked against it: an edge's length."""
    friction: float
    bound: bool

    def planes(self, x: np.ndarray, ahead: np.ndarray) -> Planes:
        """The tangent planes of the mesh, as in `Wall.planes`. A vertex inside is pushed out along the shortest way."""
        low, high = self.mesh.vertices.min(axis=0), self.mesh.vertices.max(axis=0)
        margin = self.reach + np.abs(ahead - x).max()
        vertex = np.flatnonzero(((ahead > low - margin) & (ahead < high + margin)).all(axis=1))
        size = float(np.ptp(self.mesh.vertices, axis=0).max())
        if not len(vertex):
            return vertex, np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool), np.zeros((0, 3))
        place, normal = closest_on(self.mesh, ahead[vertex], max(self.reach, size / 100.0))
        way = ahead[vertex] - place
        side = np.where((way * normal).sum(axis=1) >= 0.0, 1.0, -1.0)
        length = np.linalg.norm(way, axis=1)
        clear = length > 1e-6 * size
        normal = np.where(clear[:, None], side[:, None] * way / np.maximum(length, 1e-300)[:, None], normal)
        count = len(vertex)
        velocity = np.zeros((count, 3)) if self.mesh.velocity is None else velocity_at(place, self.mesh.vertices, self.mesh.velocity)
        return vertex, normal, (normal * place).sum(axis=1), np.full(count, self.friction), np.full(count, self.bound), velocity

    def at(self, time: float, frame_dt: float) -> Block:
        """The mesh at a time [frames]; a frame lasts `frame_dt` [s]."""
        return self if self.mesh.path is None else replace(self, mesh=self.mesh.posed(time, frame_dt))


Obstacle = Wall | Block


def obstacles_of(colliders: Sequence[Collider], reach: float) -> tuple[Obstacle, ...]:
    """The solid solver's colliders, as obstacles for a shell with edges about `reach` [m] long."""
    found: list[Obstacle] = []
    for collider in colliders:
        friction = np.inf if collider.kind == "sticky" else collider.friction
        bound = collider.kind != "separate"
        if isinstance(collider, MeshCollider):
            found.append(Block(collider, reach, friction, bound))
        else:
            found.append(Wall(*collider.side(), friction, bound))
    return tuple(found)
