"""Meshes for the tests in this folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def sheet() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """An open rectangle in the XZ plane, its corner at the origin: sheet(width, height) -> vertices, triangles."""

    def make(width: float, height: float, columns: int = 8, rows: int = 6) -> tuple[np.ndarray, np.ndarray]:
        u, v = np.meshgrid(np.linspace(0, width, columns + 1), np.linspace(0, height, rows + 1), indexing="ij")
        vertices = np.stack([u.ravel(), np.zeros(u.size), v.ravel()], 1)
        index = np.arange(u.size).reshape(u.shape)
        a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
        return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])

    return make


@pytest.fixture
def folder(tmp_path, sheet) -> Path:
    """A folder with a box and a flag as files."""
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((0.2, 0.2, 0.2)).export(tmp_path / "box.obj")
    vertices, triangles = sheet(0.3, 0.2)
    np.savez(tmp_path / "flag.npz", vertices=vertices, triangles=triangles)
    return tmp_path
