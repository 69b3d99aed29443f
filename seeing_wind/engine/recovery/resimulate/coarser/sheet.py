"""Fewer vertices for a sheet than in the full result, for a preview, by half-edge collapses, shortest edges first (Hoppe 1996).

The remaining vertices keep their places, so that pins stay valid; the others ride on the coarser faces.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

FEWEST = 60
"""A sheet is not reduced below this number of vertices, with which it is fast."""
STRAIGHT = 0.85
"""Cosine of the largest angle by which a border may turn at a vertex that is removed, so that a sheet keeps its corners."""
TURNED = 0.7
"""Cosine of the largest angle by which a face may turn when one of its corners moves."""
SLIVER = 0.1
"""Smallest ratio of a face's area to its longest edge squared: the best is 0.43, half a square has 0.25."""
STRETCHED = 1.5
"""Largest length of an edge, relative to the wanted length: without a limit, some edges would grow while others stay short."""
NEAR = 12
"""Number of faces with the nearest centres that are searched for the face below a vertex."""


@dataclass(frozen=True)
class Ridden:
    """A coarser sheet, and how the vertices of the full sheet ride on it."""

    used: np.ndarray
    """(U,) indices of the full sheet's vertices that remain."""
    faces: np.ndarray
    """(G, 3) faces of the coarser sheet, as indices of its own vertices."""
    corners: np.ndarray
    """(V, 3) the three vertices of the coarser sheet that carry each vertex of the full one."""
    weights: np.ndarray
    """(V, 3) barycentric weights of these vertices."""
    above: np.ndarray
    """(V,) distance of each vertex of the full sheet from the plane of the three, along the normal [m]."""

    def follow(self, x: np.ndarray) -> np.ndarray:
        """Positions (T+1, V, 3) [m] of the full sheet's vertices for those of the coarser sheet at x (T+1, U, 3) [m]."""
        found = np.empty((len(x), len(self.corners), 3))
        for now, place in zip(x, found):
            a, b, c = (now[self.corners[:, k]] for k in range(3))
            normal = np.cross(b - a, c - a)
            length = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)
            place[:] = np.einsum("vk,vki->vi", self.weights, now[self.corners]) + (self.above / length)[:, None] * normal
        return found


def coarser_sheet(x: np.ndarray, faces: np.ndarray, held: np.ndarray, coarseness: float) -> Ridden | None:
    """A sheet with edges about `coarseness` times as long; None if it already has few vertices.

    Args:
        x: (V, 3) vertices at rest [m]; faces: (F, 3), each edge with one face or two, as in a `Surface`.
        held: (V,) bool: a held vertex collapses only into another held vertex.
        coarseness: 1 or more.
    """
    wanted = max(FEWEST, round(len(x) / coarseness**2))
    if coarseness <= 1.0 or len(x) <= wanted:
        return None
    left = _Collapse(x, faces, held, coarseness).down_to(wanted)
    used, coarse = np.unique(left, return_inverse=True)
    return _ride(x, used, coarse.reshape(left.shape))


Vector = tuple[float, float, float]


class _Collapse:
    """The mesh while its edges collapse. It uses plain numbers, as NumPy arrays of three take ten times as long."""

    def __init__(self, x: np.ndarray, faces: np.ndarray, held: np.ndarray, coarseness: float) -> None:
        self.x: list[Vector] = [(a, b, c) for a, b, c in x.tolist()]
        self.held: list[bool] = held.tolist()
        self.face: dict[int, tuple[int, int, int]] = {k: (a, b, c) for k, (a, b, c) in enumerate(faces.tolist())}
        self.around: list[set[int]] = [set() for _ in x]
        for k, corners in self.face.items():
            for v in corners:
                self.around[v].add(k)
        ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        self.longest = STRETCHED * coarseness * float(np.median(np.linalg.norm(x[ends[:, 0]] - x[ends[:, 1]], axis=1)))
        self.vertices = len(x)

    def down_to(self, wanted: int) -> np.ndarray:
        """Collapse edges until `wanted` vertices are left, or no edge can collapse. Returns the remaining faces (G, 3)."""
        queue = [(self._cost(v, u), v, u) for v in range(len(self.x)) for u in self._next_to(v)]
        heapq.heapify(queue)
        while queue and self.vertices > wanted:
            _, v, u = heapq.heappop(queue)
            if self.around[v] and self.around[v] & self.around[u] and self._may_go(v, u):
                self._go(v, u)
                for w in self._next_to(u):  # edges that could not collapse before may do so now
                    heapq.heappush(queue, (self._cost(u, w), u, w))
                    heapq.heappush(queue, (self._cost(w, u), w, u))
        return np.array([self.face[k] for k in sorted(self.face)])

    def _cost(self, v: int, u: int) -> float:
        """Cost of collapsing an edge: its length, increased if the remaining vertex would not have six faces, as in a regular mesh."""
        crowd = len(self.around[v]) + len(self.around[u]) - 4
        return math.dist(self.x[v], self.x[u]) * (1.0 + 0.15 * abs(crowd - 6))

    def _next_to(self, v: int) -> set[int]:
        return {w for k in self.around[v] for w in self.face[k]} - {v}

    def _rim(self, v: int) -> list[int]:
        """Neighbours of a vertex along the border; none for a vertex inside."""
        return [w for w in self._next_to(v) if len(self.around[v] & self.around[w]) == 1]

    def _may_go(self, v: int, u: int) -> bool:
        """Whether v may collapse into its neighbour u and leave a sheet of about the same shape."""
        if self.held[v] and not self.held[u]:
            return False
        rim = self._rim(v)
        if rim:
            if u not in rim or len(rim) != 2:
                return False
            one, other = _way(self.x[rim[0]], self.x[v]), _way(self.x[v], self.x[rim[1]])
            if _dot(one, other) < STRAIGHT * math.hypot(*one) * math.hypot(*other):
                return False
        shared = self.around[v] & self.around[u]
        if len(self._next_to(v) & self._next_to(u)) != len(shared):  # otherwise two faces would coincide
            return False
        stay = [self.face[k] for k in self.around[v] - shared]
        if not stay:
            return False
        # The moving corner comes first, and the winding is kept.
        return all(self._alike(v, u, corners[k - 2], corners[k - 1]) for corners in stay for k in (corners.index(v),))

    def _alike(self, v: int, u: int, b: int, c: int) -> bool:
        """Whether the face (v, b, c) keeps about its plane, and a fair shape, with u in place of v."""
        side = _way(self.x[b], self.x[c])
        was, now = (_cross(side, _way(self.x[b], self.x[w])) for w in (v, u))
        longest = max(math.hypot(*side), math.dist(self.x[u], self.x[b]), math.dist(self.x[u], self.x[c]))
        size = math.hypot(*now)
        if longest > self.longest or 0.5 * size < SLIVER * longest**2:
            return False
        return _dot(was, now) >= TURNED * math.hypot(*was) * size

    def _go(self, v: int, u: int) -> None:
        for k in self.around[v] & self.around[u]:
            for w in self.face.pop(k):
                self.around[w].discard(k)
        for k in self.around[v]:
            a, b, c = (u if w == v else w for w in self.face[k])
            self.face[k] = (a, b, c)
            self.around[u].add(k)
        self.around[v] = set()
        self.vertices -= 1


def _way(a: Vector, b: Vector) -> Vector:
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _ride(x: np.ndarray, used: np.ndarray, faces: np.ndarray) -> Ridden:
    """Attach the vertices x (V, 3) [m] of the full sheet, each to the nearest of the coarser faces (G, 3)."""
    from trimesh.triangles import closest_point, points_to_barycentric

    corners = x[used][faces]
    _, near = cKDTree(corners.mean(axis=1)).query(x, k=min(NEAR, len(faces)))
    near = near.reshape(len(x), -1)
    place = closest_point(corners[near.ravel()], np.repeat(x, near.shape[1], axis=0)).reshape(*near.shape, 3)
    best = ((place - x[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    rows = np.arange(len(x))
    face, below = near[rows, best], place[rows, best]
    a, b, c = (corners[face, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    weights = points_to_barycentric(corners[face], below)
    return Ridden(used, faces, faces[face], weights, ((x - below) * normal).sum(axis=1))
