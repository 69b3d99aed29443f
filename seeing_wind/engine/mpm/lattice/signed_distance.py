"""Depth inside a closed mesh at the nodes of a lattice, and the direction of the shortest way out."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from .closed_mesh import dots_on, signed_volume, winding_numbers
from .mesh_collider import MeshCollider

_LOOKED_AT = 6
"""How many dots on the surface, those nearest to a point, have their triangles searched for the nearest place."""
_ROUND = 8.0
"""Margin around the points within which dots are searched first, in spacings of the dots."""
_EXACT = 3.0
"""Depth below the surface [cells] down to which distances to it are exact."""


def node_box(mesh: MeshCollider, offset: np.ndarray, dx: float, region: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """First and last node (3,) that may lie inside the mesh, and in a region (2, 3) [m] if given; there are none if first > last."""
    low, high = mesh.vertices[mesh.faces.ravel()].min(axis=0), mesh.vertices[mesh.faces.ravel()].max(axis=0)
    if region is not None:
        low, high = np.maximum(low, region[0]), np.minimum(high, region[1])
        if (low > high).any():
            return np.zeros(3, np.int64), np.full(3, -1)
    return np.floor((low - offset) / dx).astype(np.int64), np.ceil((high - offset) / dx).astype(np.int64)


def inside_of(
    mesh: MeshCollider, first: tuple[int, ...], last: tuple[int, ...], offset: tuple[float, ...], dx: float
) -> tuple[np.ndarray, np.ndarray]:
    """Depth [m] below the surface, 0 outside, and the unit vector (..., 3) of the shortest way out, at nodes first..last."""
    # Shifted by a ten-thousandth of a cell, to where no modeller puts an edge: a line along Z through an edge would count it twice.
    aside = dx * np.array([1.37e-4, 2.11e-4, 0.0])
    axes = [offset[c] + dx * np.arange(first[c], last[c] + 1) for c in range(3)]
    inside = winding_numbers(mesh.vertices, mesh.faces, [axis + shift for axis, shift in zip(axes, aside)]) != 0
    # Far inside, where no matter gets, the way to the nearest node outside is good enough; near the surface, the way to it is exact.
    framed = np.pad(inside, 1, mode="edge")  # beyond the border of a region the mesh goes on
    cells, outside = distance_transform_edt(np.pad(inside, 1) if framed.all() else framed, return_indices=True)
    core = (slice(1, -1),) * 3
    way = np.moveaxis(outside, 0, -1)[core] - np.moveaxis(np.indices(cells.shape), 0, -1)[core]
    depth = np.maximum(cells[core] - 0.5, 0.0) * dx
    normals = way / np.maximum(cells[core], 1.0)[..., None]
    index = np.argwhere(inside & (cells[core] <= _EXACT))
    nodes = np.stack([axes[c][index[:, c]] for c in range(3)], axis=1)
    closest, normal = closest_on(mesh, nodes, dx)
    length = np.linalg.norm(closest - nodes, axis=1)
    clear = length > 1e-3 * dx
    normal[clear] = (closest - nodes)[clear] / length[clear, None]
    depth[tuple(index.T)], normals[tuple(index.T)] = np.maximum(length, 1e-12 * dx), normal
    return depth, normals


kept_inside_of = lru_cache(maxsize=8)(inside_of)
"""`inside_of` with a cache, for meshes that stand still."""


def closest_on(mesh: MeshCollider, points: np.ndarray, dx: float) -> tuple[np.ndarray, np.ndarray]:
    """The place (P, 3) [m] on the surface nearest to each of the points (P, 3) [m], and the outward unit normal (P, 3) of its face."""
    from trimesh.triangles import closest_point

    near = _nearest_faces(mesh, points, dx)
    best, found, face = np.full(len(points), np.inf), np.zeros_like(points), np.zeros(len(points), int)
    for k, column in enumerate(near.T):
        new = np.flatnonzero((near[:, :k] != column[:, None]).all(axis=1))
        place = closest_point(mesh.corners[column[new]], points[new])
        distance = ((place - points[new]) ** 2).sum(axis=1)
        nearer = distance < best[new]
        rows = new[nearer]
        best[rows], found[rows], face[rows] = distance[nearer], place[nearer], column[rows]
    a, b, c = (mesh.corners[:, k] for k in range(3))
    cross = np.cross(b - a, c - a) * np.sign(signed_volume(mesh.vertices, mesh.faces))
    return found, (cross / np.linalg.norm(cross, axis=1, keepdims=True))[face]


def _nearest_faces(mesh: MeshCollider, points: np.ndarray, dx: float) -> np.ndarray:
    """(P, k) the triangles of the dots nearest to points (P, 3) [m]. The part of the mesh around the points is searched first."""
    dots, owner = dots_on(mesh.corners, dx)
    if not len(points):
        return np.zeros((0, 1), int)
    margin = _ROUND * dx
    some = np.flatnonzero(((dots >= points.min(axis=0) - margin) & (dots <= points.max(axis=0) + margin)).all(axis=1))
    found = np.full((len(points), _LOOKED_AT), -1)
    missing = np.arange(len(points))
    for choice in (some, np.arange(len(dots))):
        if len(choice) and len(missing):
            count = min(_LOOKED_AT, len(choice))
            distance, index = cKDTree(dots[choice]).query(points[missing], k=count)
            found[missing] = np.pad(owner[choice[index.reshape(-1, count)]], ((0, 0), (0, _LOOKED_AT - count)), mode="edge")
            missing = missing[distance.reshape(-1, count)[:, -1] > margin]
    return found
