"""Triangle meshes as solids: whether they are closed, their area and volume, points on them, and which points lie inside."""

from __future__ import annotations

import numpy as np


def weld(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles (M, 3) renumbered so that vertices at the same place have one number: many files repeat vertices at texture seams."""
    size = max(float(np.ptp(vertices, axis=0).max()), 1e-300)
    return np.unique(np.round(vertices / (1e-7 * size)), axis=0, return_inverse=True)[1].ravel()[triangles]


def triangle_areas(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Areas (M,) [m²] and cross products (M, 3) [m²] of two edges, of triangles (M, 3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    return 0.5 * np.linalg.norm(cross, axis=1), cross


def dots_on(corners: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 3) on triangles with these corners (M, 3, 3), and the triangle (P,) of each point.

    No place on a triangle is farther than `spacing` [m] from one of its points.
    """
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    cuts = np.maximum(np.ceil(edge / spacing), 1).astype(int)
    dots, owner = [], []
    for count in np.unique(cuts):
        which = np.flatnonzero(cuts == count)
        i, j = np.array([(i, j) for i in range(count + 1) for j in range(count + 1 - i)]).T
        weight = np.stack([i, j, count - i - j], axis=1) / count
        dots.append(np.einsum("pk,mkc->mpc", weight, corners[which]).reshape(-1, 3))
        owner.append(np.repeat(which, len(i)))
    return np.concatenate(dots), np.concatenate(owner)


def signed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Volume [m³] that a closed surface encloses, positive if its normals point outwards (divergence theorem)."""
    if len(triangles) == 0:
        return 0.0
    shifted = vertices - vertices[triangles[:, 0]].mean(axis=0)
    a, b, c = (shifted[triangles[:, k]] for k in range(3))
    return float(np.einsum("mi,mi->", a, np.cross(b, c)) / 6.0)


def is_closed(triangles: np.ndarray) -> bool:
    """Whether every edge is passed exactly once in each direction: a consistently wound surface with an inside."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    size = edges.max() + 1
    forward, backward = edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0]
    return len(np.unique(forward)) == len(forward) and bool(np.array_equal(np.sort(forward), np.sort(backward)))


def winding_numbers(vertices: np.ndarray, triangles: np.ndarray, axes: list[np.ndarray]) -> np.ndarray:
    """Winding number (A, B, C) int of a closed surface about the points of a lattice, from signed crossings of lines along Z.

    A line through an edge counts a crossing for each of the two triangles: place the lattice where the mesh is unlikely to have edges.

    Args:
        vertices: (V, 3) [m].
        triangles: (M, 3) int, closed and consistently wound.
        axes: increasing x (A,), y (B,) and z (C,) of the lattice [m].
    """
    corners = vertices[triangles]
    first = [np.searchsorted(axes[c], corners[:, :, c].min(axis=1)) for c in range(2)]
    last = [np.searchsorted(axes[c], corners[:, :, c].max(axis=1)) for c in range(2)]
    wide = [last[c] - first[c] for c in range(2)]
    each = wide[0] * wide[1]
    triangle = np.repeat(np.arange(len(triangles)), each)
    rank = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
    i = first[0][triangle] + rank // np.maximum(wide[1][triangle], 1)
    j = first[1][triangle] + rank % np.maximum(wide[1][triangle], 1)
    a, b, c = (corners[triangle, k] for k in range(3))
    px, py = axes[0][i], axes[1][j]

    def side(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return (q[:, 0] - p[:, 0]) * (py - p[:, 1]) - (q[:, 1] - p[:, 1]) * (px - p[:, 0])

    wa, wb, wc = side(b, c), side(c, a), side(a, b)
    total = wa + wb + wc
    hit = (total != 0.0) & (((wa > 0) & (wb > 0) & (wc > 0)) | ((wa < 0) & (wb < 0) & (wc < 0)))
    height = (wa * a[:, 2] + wb * b[:, 2] + wc * c[:, 2])[hit] / total[hit]
    change = np.zeros((len(axes[0]), len(axes[1]), len(axes[2]) + 1), dtype=int)
    above = np.searchsorted(axes[2], height)
    np.add.at(change, (i[hit], j[hit], above), np.where(total[hit] > 0, -1, 1))
    return np.cumsum(change, axis=2)[:, :, :-1]
