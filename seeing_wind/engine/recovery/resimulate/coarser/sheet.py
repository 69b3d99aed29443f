"""Fewer vertices for a sheet than in the full result, for a preview: half edges collapse, the shortest first (Hoppe 1996).

The vertices that are left keep their places, so that pins stay what they are; the others ride on the coarser faces.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

FEWEST = 60
"""Vertices below which a sheet is quick as it is."""
STRAIGHT = 0.85
"""Cosine of how far a border may turn at a vertex that goes: a sheet keeps its corners."""
TURNED = 0.7
"""Cosine of how far a face may turn when a corner of it moves."""
SLIVER = 0.1
"""Area of a face over its longest edge squared below which it is too thin: 0.43 is the best, 0.25 that of a square's half."""
STRETCHED = 1.5
"""Of the wanted length, at most, is an edge: else some collapse again and again where others are left."""
NEAR = 12
"""Faces with the nearest middles, among which that below a vertex is sought."""


@dataclass(frozen=True)
class Ridden:
    """A coarser sheet, and how the vertices of the full one ride on it."""

    used: np.ndarray
    """(U,) vertices of the full sheet that it has."""
    faces: np.ndarray
    """(G, 3) of its own vertices."""
    corners: np.ndarray
    """(V, 3) those of its vertices that carry each of the full sheet's."""
    weights: np.ndarray
    """(V, 3) their shares."""
    above: np.ndarray
    """(V,) how far off their plane it is, along the normal [m]."""

    def follow(self, x: np.ndarray) -> np.ndarray:
        """Places (T+1, V, 3) of the full sheet's vertices where the coarser one's are at x (T+1, U, 3) [m]."""
        found = np.empty((len(x), len(self.corners), 3))
        for now, place in zip(x, found):
            a, b, c = (now[self.corners[:, k]] for k in range(3))
            normal = np.cross(b - a, c - a)
            length = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)
            place[:] = np.einsum("vk,vki->vi", self.weights, now[self.corners]) + (self.above / length)[:, None] * normal
        return found


def coarser_sheet(x: np.ndarray, faces: np.ndarray, held: np.ndarray, coarseness: float) -> Ridden | None:
    """A sheet with edges about `coarseness` times as long; None where it has few vertices as it is.

    Args:
        x: (V, 3) at rest [m]; faces: (F, 3), each edge with one face or two, as of a `Surface`.
        held: (V,) bool: such a vertex goes only into another one that is held.
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
    """The mesh while edges of it collapse. In plain numbers: arrays of three take ten times as long."""

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
        """Collapse edges until so many vertices are left, or none can go; the faces (G, 3) that are left."""
        queue = [(self._cost(v, u), v, u) for v in range(len(self.x)) for u in self._next_to(v)]
        heapq.heapify(queue)
        while queue and self.vertices > wanted:
            _, v, u = heapq.heappop(queue)
            if self.around[v] and self.around[v] & self.around[u] and self._may_go(v, u):
                self._go(v, u)
                for w in self._next_to(u):  # what could not go before may go now
                    heapq.heappush(queue, (self._cost(u, w), u, w))
                    heapq.heappush(queue, (self._cost(w, u), w, u))
        return np.array([self.face[k] for k in sorted(self.face)])

    def _cost(self, v: int, u: int) -> float:
        """Its length, and how many faces its end would have: six is a regular mesh."""
        crowd = len(self.around[v]) + len(self.around[u]) - 4
        return math.dist(self.x[v], self.x[u]) * (1.0 + 0.15 * abs(crowd - 6))

    def _next_to(self, v: int) -> set[int]:
        return {w for k in self.around[v] for w in self.face[k]} - {v}

    def _rim(self, v: int) -> list[int]:
        """Neighbours of a vertex along the border; none inside."""
        return [w for w in self._next_to(v) if len(self.around[v] & self.around[w]) == 1]

    def _may_go(self, v: int, u: int) -> bool:
        """Whether v may go into its neighbour u, and a sheet of about the same shape is left."""
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
        if len(self._next_to(v) & self._next_to(u)) != len(shared):  # or two faces would lie on one another
            return False
        stay = [self.face[k] for k in self.around[v] - shared]
        if not stay:
            return False
        # the corner that moves comes first, and the way round is kept
        return all(self._alike(v, u, corners[k - 2], corners[k - 1]) for corners in stay for k in (corners.index(v),))

    def _alike(self, v: int, u: int, b: int, c: int) -> bool:
        """Whether the face of v, b and c stays one of about the same plane with u in place of v."""
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
    """The vertices x (V, 3) of the full sheet, each on the nearest of the coarser faces (G, 3)."""
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
