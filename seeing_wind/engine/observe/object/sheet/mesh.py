"""The mesh of a sheet in frame 0: one layer of triangles on the visible surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.optimize import least_squares
from scipy.sparse import coo_matrix

from ..shape.relief import Relief
from ..shape.surface import MIN_STEP, silhouette_triangles

FLAT = 0.02
"""Root mean square distance of a mesh from its plane, in units of its size, below which it counts as flat."""


@dataclass(frozen=True)
class SheetMesh:
    """V vertices and M faces."""

    x: np.ndarray
    """(V, 3) in frame 0 [m]."""
    faces: np.ndarray
    """(M, 3), normals towards the camera."""
    xy: np.ndarray
    """(V, 2) in frame 0 [px]."""
    flat: np.ndarray
    """(V, 2) the mesh laid flat [m], with the lengths of its edges kept as well as possible."""
    pinned: np.ndarray
    """(V,) bool."""

    @property
    def spacing(self) -> float:
        """Mean length of an edge [m]."""
        a, b = edges_of(self.faces).T
        return float(np.linalg.norm(self.x[a] - self.x[b], axis=1).mean())

    @property
    def size(self) -> float:
        """The root of its area [m]."""
        return float(np.sqrt(self.areas().sum()))

    def areas(self) -> np.ndarray:
        """(V,) area of each vertex [m²], a third of the faces round it."""
        a, b, c = self.x[self.faces].swapaxes(0, 1)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return np.bincount(self.faces.ravel(), np.repeat(area / 3.0, 3), len(self.x))


def mesh_of(relief: Relief, held: np.ndarray, count: int) -> SheetMesh:
    """A mesh of about `count` vertices on the front of a relief; held: (H, W) bool, the part painted as held.

    Raises:
        ObjectError: a silhouette too small or too thin to carry a triangle.
    """
    step = max(MIN_STEP, float(np.sqrt(relief.mask.sum() / count)))
    xy, triangles = silhouette_triangles(relief.mask, step)
    x = relief.points(xy, 0.0)
    pinned = np.zeros(len(x), bool)
    if held.any():
        away = ndimage.map_coordinates(ndimage.distance_transform_edt(~held), xy.T[::-1], order=1, mode="nearest")
        pinned = away <= max(0.5 * step, float(away.min()))
    faces = triangles[:, ::-1].astype(np.int64)
    return SheetMesh(x, faces, xy, flatten_mesh(x, faces), pinned)


def edges_of(faces: np.ndarray) -> np.ndarray:
    """The vertices (E, 2) of every edge, each edge once."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(sides, axis=1), axis=0)


def flatten_mesh(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The mesh x (V, 3) [m] laid flat, (V, 2) [m], with the lengths of its edges kept in the least-squares sense; exact for a developable
    surface."""
    centre = x.mean(axis=0)
    spread, axes = np.linalg.svd(x - centre, full_matrices=False)[1:]
    start = (x - centre) @ axes[:2].T
    if spread[2] < FLAT * spread[0]:
        return start
    a, b = edges_of(faces).T
    length, edge = np.linalg.norm(x[a] - x[b], axis=1), np.arange(len(a))

    def stretched(flat: np.ndarray) -> np.ndarray:
        at = flat.reshape(-1, 2)
        return np.linalg.norm(at[a] - at[b], axis=1) / length - 1.0

    def slopes(flat: np.ndarray) -> coo_matrix:
        at = flat.reshape(-1, 2)
        apart = at[a] - at[b]
        slope = apart / (np.linalg.norm(apart, axis=1) * length)[:, None]
        columns = np.stack([2 * a, 2 * a + 1, 2 * b, 2 * b + 1], axis=1)
        return coo_matrix((np.hstack([slope, -slope]).ravel(), (np.repeat(edge, 4), columns.ravel())), (len(a), 2 * len(x))).tocsr()

    return least_squares(stretched, start.ravel(), slopes, tr_solver="lsmr").x.reshape(-1, 2)
