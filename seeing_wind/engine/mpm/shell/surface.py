"""The triangle mesh of a shell: its edges, the neighbours of its faces, and which meshes are refused."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import UsageError
from ..lattice.closed_mesh import triangle_areas

NONE = -1
"""Stands for a missing neighbour."""
THINNEST = 1e-7
"""A face whose area is at most this fraction of its longest edge squared counts as having no area."""


@dataclass(frozen=True)
class Surface:
    """A mesh in which every edge has one face or two. Corner k of a face lies opposite its edge k."""

    x: np.ndarray
    """(V, 3) at rest [m]."""
    faces: np.ndarray
    """(F, 3)."""
    neighbour: np.ndarray
    """(F, 3) the face across edge k, or NONE at the border."""
    opposite: np.ndarray
    """(F, 3) the vertex across edge k, or NONE."""
    area: np.ndarray
    """(F,) at rest [m²]."""
    edge: np.ndarray
    """(F, 3) number of edge k in the mesh; the same for both faces at an edge."""
    edges: int
    """Number of edges."""

    @property
    def edge_length(self) -> float:
        """Median length of the edges at rest [m]."""
        ends = self.x[np.roll(self.faces, -1, axis=1)] - self.x[self.faces]
        return float(np.median(np.linalg.norm(ends, axis=2)))


def surface_of(vertices: np.ndarray, faces: np.ndarray) -> Surface:
    """A mesh as the surface of a sheet.

    Args:
        vertices: (V, 3) [m]; faces: (F, 3) int with any winding: the faces of a connected part are turned to face the same way.

    Raises:
        UsageError: no faces, a vertex that is not finite, a face without area, an edge with more than two faces, a vertex without a face,
            a surface with only one side (a Moebius strip).
    """
    x, faces = np.asarray(vertices, dtype=np.float64), np.array(faces, dtype=np.int64)
    if faces.ndim != 2 or faces.shape[1:] != (3,) or not len(faces) or faces.min() < 0 or faces.max() >= len(x):
        raise UsageError(f"A sheet cannot have faces of shape {faces.shape} on {len(x)} vertices.", "Give triangles, (F, 3) indices.")
    if not np.isfinite(x).all():
        raise UsageError(f"Vertex {_first(~np.isfinite(x).all(axis=1))} of the sheet is not finite.", "Mend the mesh and export it again.")
    alone = np.bincount(faces.ravel(), minlength=len(x)) == 0
    if alone.any():
        one, many = f"Vertex {_first(alone)} of the sheet belongs", f"{alone.sum()} vertices of the sheet, such as {_first(alone)}, belong"
        message = f"{one if alone.sum() == 1 else many} to no face: loose points or edges have no area."
        raise UsageError(message, "Delete loose geometry (Mesh > Clean Up > Delete Loose).")
    area = triangle_areas(x, faces)[0]
    flat = area <= THINNEST * _longest(x, faces) ** 2
    if flat.any():
        one, many = f"Face {_first(flat)} of the sheet has", f"{flat.sum()} faces of the sheet, such as {_first(flat)}, have"
        raise UsageError(f"{one if flat.sum() == 1 else many} no area.", "Dissolve them (Mesh > Clean Up > Degenerate Dissolve).")
    faces = _orient(faces)
    neighbour, opposite, edge, edges = _around(faces)
    return Surface(x, faces, neighbour, opposite, area, edge, edges)


def _first(wrong: np.ndarray) -> int:
    return int(np.flatnonzero(wrong)[0])


def _longest(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Longest edges (F,)."""
    start, end = _sides(faces)
    return np.linalg.norm(x[end] - x[start], axis=2).max(axis=1)


def _sides(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start and end (F, 3) of edge k of every face, which goes from corner k+1 to corner k+2."""
    return np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)


def _pairs(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The two half edges (P, 2) of each inner edge, as face * 3 + k, the number (F, 3) of every edge, and how many edges there are."""
    start, end = _sides(faces)
    low, high = np.minimum(start, end).ravel(), np.maximum(start, end).ravel()
    key = low * (int(faces.max()) + 1) + high
    _, number, count = np.unique(key, return_inverse=True, return_counts=True)
    number = number.ravel()
    if (count > 2).any():
        half = int(np.flatnonzero(count[number] > 2)[0])
        raise UsageError(
            f"{(count > 2).sum()} edges of the sheet, such as the one between vertices {low[half]} and {high[half]}, have more than two "
            "faces.", "Separate what branches (Select > Non Manifold shows it), or give the mesh a thickness.",
        )  # fmt: skip
    order = np.argsort(number, kind="stable")
    inner = np.flatnonzero(np.diff(number[order]) == 0)
    return np.stack([order[inner], order[inner + 1]], axis=1), number.reshape(faces.shape), len(count)


def _orient(faces: np.ndarray) -> np.ndarray:
    """The faces (F, 3), reversed where needed so that each faces the same way as its neighbours."""
    pairs, _, _ = _pairs(faces)
    start = _sides(faces)[0].ravel()
    if not (start[pairs[:, 0]] == start[pairs[:, 1]]).any():
        return faces
    same = start[pairs[:, 0]] == start[pairs[:, 1]]  # both faces run along the edge in the same direction: one must be reversed
    around: list[list[tuple[int, bool]]] = [[] for _ in faces]
    for (p, q), turn in zip((pairs // 3).tolist(), same.tolist()):
        around[p].append((q, turn))
        around[q].append((p, turn))
    flip = np.full(len(faces), -1)
    for seed in range(len(faces)):
        if flip[seed] >= 0:
            continue
        flip[seed], queue = 0, [seed]
        for face in queue:
            for other, turn in around[face]:
                if flip[other] < 0:
                    flip[other] = flip[face] ^ turn
                    queue.append(other)
                elif flip[other] != flip[face] ^ turn:
                    raise UsageError("The sheet has one side only, like a Moebius strip.", "Cut it open somewhere.")
    return np.where(flip[:, None] == 1, faces[:, ::-1], faces)


def _around(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Neighbour (F, 3), opposite vertex (F, 3) and edge number (F, 3) across every edge, and the number of edges."""
    pairs, edge, edges = _pairs(faces)
    neighbour, opposite = np.full(faces.size, NONE), np.full(faces.size, NONE)
    for p, q in ((pairs[:, 0], pairs[:, 1]), (pairs[:, 1], pairs[:, 0])):
        neighbour[p], opposite[p] = q // 3, faces.ravel()[q]
    return neighbour.reshape(faces.shape), opposite.reshape(faces.shape), edge, edges
