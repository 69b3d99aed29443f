"""The dense parts ("fronts") that a sparse matrix is eliminated in: what depends on its pattern only.

Every group of the dissection is a small dense matrix whose remainder is added into its parent's (the multifrontal method: Liu 1992,
SIAM Review 34, 82). `front_kernels` says how one is laid out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .front_kernels import (
    BELOW,
    COUNT,
    FIRST,
    FIRST_BLOCK,
    FIRST_CHILD,
    LAST_BLOCK,
    LAST_CHILD,
    LENGTH,
    OWN,
    PLACES,
    REMAINDER,
    ROWS,
    TILE,
    TOUCHED,
    UPDATE,
    VECTOR,
)

DEPTH = 3
"""How often the mesh is halved before its parts are shared out to threads, eight parts: those above are done one after the other."""
SMALL = 2000
"""Vertices up to which one thread does all: to wake another one takes longer."""


@dataclass(frozen=True)
class Fronts:
    """The fronts of one pattern, children before parents. See the arguments of the kernels."""

    table: np.ndarray
    """(fronts, LENGTH) int32."""
    slots: np.ndarray
    """(B, 2) int32 row and column of each block in its front."""
    children: np.ndarray
    """int32."""
    places: np.ndarray
    """int32."""
    runs: np.ndarray
    """(runs, 2) int32 the first front of each and the one after its last."""
    levels: tuple[tuple[int, int], ...]
    """First and last (exclusive) of the runs that can be done at the same time, one level after the other."""
    remainders: int
    """Vectors that the remainders take."""

    @classmethod
    def of(cls, sizes: np.ndarray, tree: list[tuple[int, ...]], rows: np.ndarray, columns: np.ndarray) -> Fronts:
        """The fronts that eliminate `sizes` vertices each, with blocks at places (rows, columns) of the order, sorted by columns."""
        ends = np.cumsum(sizes)
        starts = ends - sizes
        begin, stop = np.searchsorted(columns, starts), np.searchsorted(columns, ends)
        updates = _updates(ends, tree, rows, begin, stop)
        touched, counts = np.array([len(update) for update in updates]), np.array([len(below) for below in tree])
        table = np.zeros((len(tree), LENGTH), np.int32)
        table[:, COUNT], table[:, TOUCHED], table[:, FIRST] = 3 * sizes, 3 * touched, starts
        table[:, OWN], table[:, UPDATE] = -(-3 * sizes // TILE), -(-3 * touched // TILE)
        table[:, FIRST_BLOCK], table[:, LAST_BLOCK] = begin, stop
        table[:, ROWS] = _offsets(TILE * table[:, OWN] * (table[:, OWN] + table[:, UPDATE]))
        table[:, VECTOR], table[:, BELOW] = _offsets(table[:, OWN]), _offsets(table[:, UPDATE])
        table[:, PLACES] = TILE * table[:, BELOW]
        table[:, FIRST_CHILD] = _offsets(counts)
        table[:, LAST_CHILD] = table[:, FIRST_CHILD] + counts

        def row_in(front: int, rank: np.ndarray) -> np.ndarray:
            """The row of a front in which the first coordinate of vertices stands, by their places in the order."""
            later = TILE * table[front, OWN] + 3 * np.searchsorted(updates[front], rank)
            return np.where(rank < ends[front], 3 * (rank - starts[front]), later)

        slots, places = [], [np.zeros(0, np.int64) for _ in tree]
        for front, below in enumerate(tree):
            inside = slice(begin[front], stop[front])
            slots.append(np.stack([row_in(front, columns[inside]), row_in(front, rows[inside])], axis=1))
            for child in below:
                own = (row_in(front, updates[child])[:, None] + np.arange(3)).ravel()
                # What fills up a tile is zero and may be added anywhere: to the last column, which all rows have.
                full = np.pad(own, (0, -len(own) % TILE), mode="edge") if len(own) else own
                places[child] = full // TILE * TILE**2 + full % TILE
        runs, levels = _runs(tree, int(ends[-1]))
        room = _remainders(table, tree, runs)
        children = [child for below in tree for child in below]
        return cls(
            table, np.concatenate(slots).astype(np.int32), np.array(children or [0], np.int32),
            np.concatenate([*places, [0]]).astype(np.int32), np.array(runs, np.int32), levels, room,
        )  # fmt: skip

    @property
    def vectors(self) -> tuple[int, int, int]:
        """How many vectors the rows of all fronts take, their own numbers, and those below."""
        own, update = (self.table[:, k].astype(np.int64) for k in (OWN, UPDATE))
        return int((TILE * own * (own + update)).sum()), int(own.sum()), int(update.sum()) + 1


def _offsets(sizes: np.ndarray) -> np.ndarray:
    """Where each of some lists begins if they are put one after the other."""
    return np.cumsum(sizes) - sizes


def _updates(ends: np.ndarray, tree: list[tuple[int, ...]], rows: np.ndarray, begin: np.ndarray, stop: np.ndarray) -> list[np.ndarray]:
    """The places in the order, increasing, of the later vertices that each front touches."""
    updates: list[np.ndarray] = []
    for front, end in enumerate(ends):
        touched = np.unique(np.concatenate([rows[begin[front] : stop[front]], *(updates[child] for child in tree[front])]))
        updates.append(touched[touched >= end])
    return updates


def _runs(tree: list[tuple[int, ...]], vertices: int) -> tuple[list[tuple[int, int]], tuple[tuple[int, int], ...]]:
    """Whole subtrees first, then the fronts above them, deepest first; and the levels of these."""
    depth, first = np.zeros(len(tree), np.int64), np.arange(len(tree))
    for front in reversed(range(len(tree))):
        depth[list(tree[front])] = depth[front] + 1
    for front, below in enumerate(tree):
        if below:
            first[front] = first[below[0]]
    runs: list[tuple[int, int]] = []
    levels: list[tuple[int, int]] = []
    deepest = DEPTH if vertices > SMALL else 0
    for level in range(deepest, -1, -1):
        fronts = np.flatnonzero(depth == level).tolist()
        levels.append((len(runs), len(runs) + len(fronts)))
        runs += [(int(first[front]) if level == deepest else front, front + 1) for front in fronts]
    return runs, tuple(levels)


def _remainders(table: np.ndarray, tree: list[tuple[int, ...]], runs: list[tuple[int, int]]) -> int:
    """Puts the place of each front's remainder in the table; returns the vectors that all take.

    In a run, those of one depth have a place for each child of a parent: the parent has taken them up before the next ones come.
    """
    sizes = TILE * table[:, UPDATE].astype(np.int64) ** 2
    parent, which = np.full(len(tree), -1), np.zeros(len(tree), np.int64)
    for front, below in enumerate(tree):
        parent[list(below)], which[list(below)] = front, np.arange(len(below))
    spot: dict[tuple[int, int, int], int] = {}
    keys: dict[int, tuple[int, int, int]] = {}
    for run, (begin, end) in enumerate(runs):
        depths: dict[int, int] = {}
        for front in reversed(range(begin, end)):
            depth = depths.get(int(parent[front]), -1) + 1
            depths[front] = depth
            keys[front] = run, depth, int(which[front])
            spot[keys[front]] = max(spot.get(keys[front], 0), int(sizes[front]))
    at, room = {}, 0
    for key, size in spot.items():
        at[key], room = room, room + size
    for front, key in keys.items():
        table[front, REMAINDER] = at[key]
    return room
