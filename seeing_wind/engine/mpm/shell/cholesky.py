"""Cholesky factors of a mesh's matrix, a 3 x 3 block per pair of vertices, by nested dissection.

The vertices are halved along their longest side, again and again, and each time a row of vertices that separates the halves is
eliminated after both (George 1973, SIAM J. Numer. Anal. 10, 345). Every part is a small dense matrix whose remainder is added into its
parent's (the multifrontal method: Liu 1992, SIAM Review 34, 82), so all arithmetic is LAPACK's. What depends on the pattern only is
found once.

SciPy's own sparse factors (SuperLU) take many times as long: `benchmarks/shell_speed.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import get_lapack_funcs
from scipy.sparse import csr_array

LEAF = 40
"""Vertices that are not halved any more."""


@dataclass(frozen=True)
class _Front:
    """One dense part: it eliminates the vertices start..end of the order."""

    start: int
    end: int
    update: np.ndarray
    """(u,) places in the order, increasing, of later vertices that it touches."""
    slots: np.ndarray
    """(k,) blocks of the matrix in its columns,"""
    rows: np.ndarray
    """and where they go in the front: (k,) row"""
    columns: np.ndarray
    """and column, in vertices."""
    children: tuple[int, ...]
    """Fronts whose remainders are added here."""
    into_parent: list[tuple[int, int, int]]
    """Where its own remainder goes in its parent's front: rows start..end from row `to` on."""


class BlockCholesky:
    """The order of elimination for one pattern; `factor` for each matrix of it.

    Args:
        pattern: (V, V), symmetric with its diagonal; only where it has entries matters.
        places: (V, 3) where the vertices lie, for halving them.

    `pairs` (B, 2) tells which block stands for which vertices (row, column); the other half follows by symmetry.
    """

    def __init__(self, pattern: csr_array, places: np.ndarray) -> None:
        groups: list[np.ndarray] = []
        tree: list[tuple[int, ...]] = []
        _dissect(np.arange(len(places)), pattern, places, groups, tree)
        self.order = np.concatenate(groups)
        self._rank = np.empty(len(places), dtype=np.int64)
        self._rank[self.order] = np.arange(len(places))
        coo = pattern.tocoo()
        row, column = coo.coords
        lower = self._rank[row] >= self._rank[column]
        by_column = np.lexsort((self._rank[row[lower]], self._rank[column[lower]]))
        self.pairs = np.stack([row[lower][by_column], column[lower][by_column]], axis=1)
        self._fronts = self._symbolic(groups, tree)

    def slots(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Numbers of the blocks of vertices (row, column), each later in the order than its column or the same."""
        size = len(self.order)
        key = self._rank[self.pairs[:, 1]] * size + self._rank[self.pairs[:, 0]]
        return np.searchsorted(key, self._rank[column] * size + self._rank[row])

    def later(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Whether the matrix keeps the block (row, column) rather than its transpose."""
        return self._rank[row] >= self._rank[column]

    def _symbolic(self, groups: list[np.ndarray], tree: list[tuple[int, ...]]) -> list[_Front]:
        rows, columns = self._rank[self.pairs[:, 0]], self._rank[self.pairs[:, 1]]
        ends = np.cumsum([len(group) for group in groups])
        begin = np.searchsorted(columns, ends - [len(group) for group in groups])
        stop = np.searchsorted(columns, ends)
        updates: list[np.ndarray] = []
        for node, end in enumerate(ends):
            touched = [rows[begin[node] : stop[node]], *(updates[child] for child in tree[node])]
            everything = np.unique(np.concatenate(touched))
            updates.append(everything[everything >= end])
        fronts, parent = [], {child: node for node, children in enumerate(tree) for child in children}
        for node, end in enumerate(ends):
            start = end - len(groups[node])
            members = np.concatenate([np.arange(start, end), updates[node]])
            into = []
            if node in parent and len(updates[node]):
                above = parent[node]
                of_parent = np.concatenate([np.arange(ends[above] - len(groups[above]), ends[above]), updates[above]])
                into = _runs(np.searchsorted(of_parent, updates[node]))
            inside = slice(begin[node], stop[node])
            fronts.append(_Front(
                start, int(end), updates[node], np.arange(begin[node], stop[node]), np.searchsorted(members, rows[inside]),
                columns[inside] - start, tree[node], into,
            ))  # fmt: skip
        return fronts

    def factor(self, blocks: np.ndarray) -> Factors:
        """Factors of the positive definite matrix with the blocks (B, 3, 3) of `pairs`, in their precision, single or double.

        Raises:
            numpy.linalg.LinAlgError: for a matrix that is not positive definite, or not finite.
        """
        potrf, trtri = get_lapack_funcs(("potrf", "trtri"), (blocks,))
        remainders: dict[int, np.ndarray] = {}
        parts = []
        for number, front in enumerate(self._fronts):
            own, size = front.end - front.start, front.end - front.start + len(front.update)
            dense = np.zeros((size, 3, size, 3), dtype=blocks.dtype)
            dense[front.rows, :, front.columns, :] = blocks[front.slots]
            dense = dense.reshape(3 * size, 3 * size)
            for child in front.children:
                if child in remainders:
                    _add(dense, remainders.pop(child), self._fronts[child].into_parent)
            # LAPACK counts by columns: the lower half of a C array is the upper half of its transpose.
            upper, failed = potrf(dense[: 3 * own, : 3 * own].T, lower=0, clean=1)
            if not failed:
                inverse, failed = trtri(upper, lower=0)
            if failed:
                raise np.linalg.LinAlgError(f"the matrix is not positive definite at vertex {self.order[front.start]}")
            below = dense[3 * own :, : 3 * own] @ inverse
            if len(front.update):
                remainders[number] = dense[3 * own :, 3 * own :] - below @ below.T
            parts.append((inverse, below))
        return Factors(self, parts)


def _runs(places: np.ndarray) -> list[tuple[int, int, int]]:
    """Increasing places of vertices as runs of rows, three for each vertex: start..end go to..."""
    cuts = np.flatnonzero(np.diff(places) != 1) + 1
    starts, ends = np.concatenate([[0], cuts]), np.concatenate([cuts, [len(places)]])
    return [(3 * int(a), 3 * int(b), 3 * int(places[a])) for a, b in zip(starts, ends)]


def _add(dense: np.ndarray, remainder: np.ndarray, into: list[tuple[int, int, int]]) -> None:
    """Add a remainder to a front: its lower half, which is all that counts."""
    for number, (a, b, to) in enumerate(into):
        for c, d, at in into[: number + 1]:
            dense[to : to + b - a, at : at + d - c] += remainder[a:b, c:d]


class Factors:
    """Solves with one matrix."""

    def __init__(self, plan: BlockCholesky, parts: list[tuple[np.ndarray, np.ndarray]]) -> None:
        self._plan, self._parts = plan, parts

    @property
    def precision(self) -> np.dtype:
        """That of the blocks they were made from."""
        return self._parts[0][0].dtype

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(V, 3) of which the matrix makes `right` (V, 3)."""
        plan = self._plan
        y = right[plan.order].astype(self.precision)
        for front, (inverse, below) in zip(plan._fronts, self._parts):
            own = inverse.T @ y[front.start : front.end].ravel()
            y[front.start : front.end] = own.reshape(-1, 3)
            if len(front.update):
                y[front.update] -= (below @ own).reshape(-1, 3)
        for front, (inverse, below) in zip(reversed(plan._fronts), reversed(self._parts)):
            own = y[front.start : front.end].ravel()
            if len(front.update):
                own = own - below.T @ y[front.update].ravel()
            y[front.start : front.end] = (inverse @ own).reshape(-1, 3)
        result = np.empty_like(right)
        result[plan.order] = y
        return result


def _dissect(vertices: np.ndarray, pattern: csr_array, places: np.ndarray, groups: list[np.ndarray], tree: list[tuple[int, ...]]) -> int:
    """Put the parts of `vertices` into groups, children first; returns the number of the last."""
    children: tuple[int, ...] = ()
    group = vertices
    if len(vertices) > LEAF:
        low, high, group = _halves(vertices, pattern, places)
        children = tuple(_dissect(half, pattern, places, groups, tree) for half in (low, high) if len(half))
    groups.append(group)
    tree.append(children)
    return len(groups) - 1


def _halves(vertices: np.ndarray, pattern: csr_array, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two halves that do not touch, and what lies between them."""
    here = places[vertices] - places[vertices].mean(axis=0)
    _, short, axis = np.linalg.eigh(here.T @ here)[1].T
    along = np.argsort(here @ axis, kind="stable")
    low, high = vertices[along[: len(along) // 2]], vertices[along[len(along) // 2 :]]
    side = np.zeros(len(places), dtype=np.int8)
    side[low], side[high] = 1, 2
    edges = [half[_touches(half, pattern, side, other)] for half, other in ((low, 2), (high, 1))]
    between = min(edges, key=len)
    # In the order of their places: what touches part of them then touches a few runs.
    between = between[np.argsort(places[between] @ short, kind="stable")]
    return low[~np.isin(low, between)], high[~np.isin(high, between)], between


def _touches(half: np.ndarray, pattern: csr_array, side: np.ndarray, other: int) -> np.ndarray:
    """(n,) bool: vertices that have a neighbour on the other side."""
    return np.asarray(abs(pattern[half]) @ (side == other).astype(np.float64)).ravel() > 0.0
