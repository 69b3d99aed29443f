"""Flat meshes for the tests of this room."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import Delaunay

Mesh = tuple[np.ndarray, np.ndarray]


def grid(length: float, width: float, columns: int, rows: int) -> Mesh:
    """A rectangle in the XY plane from the origin, squares cut along one diagonal: vertices (V, 3) [m], faces (F, 3)."""
    u, v = np.meshgrid(np.linspace(0.0, length, columns + 1), np.linspace(0.0, width, rows + 1), indexing="ij")
    index = np.arange(u.size).reshape(u.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], 1), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def irregular(length: float, width: float, columns: int, rows: int, seed: int = 0) -> Mesh:
    """The same rectangle with inner vertices moved at random and triangles by Delaunay."""
    x, _ = grid(length, width, columns, rows)
    shift = 0.3 * np.random.default_rng(seed).uniform(-1.0, 1.0, (len(x), 2)) * [length / columns, width / rows]
    shift[(x[:, 0] < 1e-9) | (x[:, 0] > length - 1e-9), 0] = 0.0
    shift[(x[:, 1] < 1e-9) | (x[:, 1] > width - 1e-9), 1] = 0.0
    x[:, :2] += shift
    faces = Delaunay(x[:, :2]).simplices
    corners = x[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return x, faces[area > 1e-6 * length * width / (columns * rows)]


@pytest.fixture
def make() -> dict[str, Callable[..., Mesh]]:
    """Both kinds of mesh by name."""
    return {"grid": grid, "irregular": irregular}
