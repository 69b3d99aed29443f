"""Solids as signed distances [m], and objects composed of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from skimage.measure import marching_cubes

Distance = Callable[[np.ndarray], np.ndarray]
"""Points (M, 3) [m] -> signed distance (M,) [m], negative inside."""
Vector = Sequence[float]


def box(centre: Vector, half: Vector, bevel: float = 0.008) -> Distance:
    """A box of half sides `half` with rounded edges."""

    def distance(p: np.ndarray) -> np.ndarray:
        q = np.abs(p - np.asarray(centre)) - np.asarray(half) + bevel
        return np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - bevel

    return distance


def capsule(a: Vector, b: Vector, radius: float) -> Distance:
    """A rod from a to b with round ends."""
    start, along = np.asarray(a, float), np.asarray(b, float) - np.asarray(a, float)

    def distance(p: np.ndarray) -> np.ndarray:
        share = np.clip((p - start) @ along / max(along @ along, 1e-12), 0.0, 1.0)
        return np.linalg.norm(p - start - share[:, None] * along, axis=1) - radius

    return distance


def ellipsoid(centre: Vector, radii: Vector, axes: np.ndarray | None = None) -> Distance:
    """An ellipsoid whose axes are the columns of `axes` (3, 3); the distance is correct to first order near the surface."""
    turn, r = np.eye(3) if axes is None else axes, np.asarray(radii, float)

    def distance(p: np.ndarray) -> np.ndarray:
        q = (p - np.asarray(centre)) @ turn
        k0, k1 = np.linalg.norm(q / r, axis=1), np.linalg.norm(q / r**2, axis=1)
        return k0 * (k0 - 1.0) / np.maximum(k1, 1e-9)

    return distance


def cylinder(centre: Vector, axis: int, radius: float, half: float, bevel: float = 0.006) -> Distance:
    """A cylinder along a coordinate axis with rounded rims."""
    across = [c for c in range(3) if c != axis]

    def distance(p: np.ndarray) -> np.ndarray:
        q = p - np.asarray(centre)
        d = np.stack([np.linalg.norm(q[:, across], axis=1) - radius, np.abs(q[:, axis]) - half], axis=1) + bevel
        return np.linalg.norm(np.maximum(d, 0.0), axis=1) + np.minimum(d.max(axis=1), 0.0) - bevel

    return distance


@dataclass(frozen=True)
class Part:
    """A solid of one colour."""

    distance: Distance
    colour: tuple[float, float, float]
    """RGB in 0..1."""


@dataclass(frozen=True)
class Solid:
    """The union of parts, which can be meshed and filled with particles."""

    parts: tuple[Part, ...]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    """A box round all parts [m]."""

    def distance(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance (M,) of the union and which part is nearest (M,)."""
        every = np.stack([part.distance(points) for part in self.parts])
        return every.min(axis=0), every.argmin(axis=0)

    def mesh(self, cell: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Vertices (V, 3) [m], triangles (M, 3) with normals outward, colours (V, 3): marching cubes with this cell size [m]."""
        axes = [np.arange(lo - 3 * cell, hi + 3 * cell, cell) for lo, hi in zip(self.low, self.high)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        values = self.distance(grid.reshape(-1, 3))[0].reshape(grid.shape[:3])
        vertices, triangles, _, _ = marching_cubes(values, 0.0, spacing=(cell, cell, cell), gradient_direction="descent")
        vertices = vertices + [axis[0] for axis in axes]
        colours = np.array([part.colour for part in self.parts])[self.distance(vertices)[1]]
        return vertices, triangles.astype(np.int32), np.clip(colours * texture(vertices)[:, None], 0.0, 1.0)

    def fill(self, spacing: float, shift: float = 0.5) -> np.ndarray:
        """Lattice points (N, 3) inside, `shift` of a spacing off the origin."""
        axes = [(np.arange(np.floor(lo / spacing) - 1, np.ceil(hi / spacing) + 2) + shift) * spacing for lo, hi in zip(self.low, self.high)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        return points[self.distance(points)[0] < 0.0]


def texture(points: np.ndarray) -> np.ndarray:
    """Speckles (M,), factors of about 1, fixed to the material at rest points (M, 3), for a tracker to follow."""
    random = np.random.default_rng(5)
    value = np.zeros(len(points))
    for wavelength, size in ((0.08, 0.08), (0.035, 0.10), (0.018, 0.12)):
        for _ in range(6):
            direction = random.normal(size=3)
            direction /= np.linalg.norm(direction)
            value += size / np.sqrt(3.0) * np.sin(points @ direction * 2.0 * np.pi / wavelength + random.uniform(0.0, 2.0 * np.pi))
    return 1.0 + value
