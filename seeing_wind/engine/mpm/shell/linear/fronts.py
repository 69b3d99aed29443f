"""The dense parts ("fronts") in which a sparse matrix is eliminated: what depends on its pattern only.

Every group of the dissection becomes a small dense matrix, whose remainder (update matrix) is added to its parent's front (the
multifrontal method: Liu 1992, SIAM Review 34, 82). `front_kernels` describes the layout.
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
"""Halvings of the mesh before its parts, eight of them, are shared out to threads; the fronts above follow, level by level."""
SMALL = 2000
"""Up to this many vertices one thread does everything: waking another would take longer."""


@dataclass(frozen=True)
class Fronts:
    """The fronts of one pattern, children before parents, as the kernels read them."""

    table: np.ndarray
    """(fronts, LENGTH) int32; `front_kernels` names the columns."""
    slots: np.ndarray
    """(B, 2) int32 row and column of each block in its front."""
    children: np.ndarray
    """int32 the children of all fronts, one list after another."""
    places: np.ndarray
    """int32 where the columns of each front's remainder stand in its parent, one list after another."""
    runs: np.ndarray
    """(runs, 2) int32 the first front of each run and the one after its last."""
    levels: tuple[tuple[int, int], ...]
    """First and last (exclusive) of the runs that can be done at the same time, in the order in which the levels are done."""
    remainders: int
    """Vectors that the remainders take, in total."""

    @classmethod
    def of(cls, sizes: np.ndarray, tree: list[tuple[int, ...]], rows: np.ndarray, columns: np.ndarray) -> Fronts:
        """The fronts that eliminate `sizes` vertices each; (rows, columns): places of the blocks in the order, sorted by column."""
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
            """The row of a front that holds the first coordinate of each vertex, given the vertex's place in the order."""
            later = TILE * table[front, OWN] + 3 * np.searchsorted(updates[front], rank)
            return np.where(rank < ends[front], 3 * (rank - starts[front]), later)

        slots, places = [], [np.zeros(0, np.int64) for _ in tree]
        for front, below in enumerate(tree):
            inside = slice(begin[front], stop[front])
            slots.append(np.stack([row_in(front, columns[inside]), row_in(front, rows[inside])], axis=1))
            for child in below:
                own = (row_in(front, updates[child])[:, None] + np.arange(3)).ravel()
                # The padding of a tile is zero and may be added anywhere: here to the last column, which all rows have.
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
        """How many vectors the rows of all fronts take, and in a solve their own numbers and those of the later rows (`BELOW`)."""
        own, update = (self.table[:, k].astype(np.int64) for k in (OWN, UPDATE))
        return int((TILE * own * (own + update)).sum()), int(own.sum()), int(update.sum()) + 1


def _offsets(sizes: np.ndarray) -> np.ndarray:
    """Where each of some lists of these sizes begins if they are put one after another."""
    return np.cumsum(sizes) - sizes


def _updates(ends: np.ndarray, tree: list[tuple[int, ...]], rows: np.ndarray, begin: np.ndarray, stop: np.ndarray) -> list[np.ndarray]:
    """For each front, the later vertices that it touches, as increasing places in the order."""
    updates: list[np.ndarray] = []
    for front, end in enumerate(ends):
        touched = np.unique(np.concatenate([rows[begin[front] : stop[front]], *(updates[child] for child in tree[front])]))
        updates.append(touched[touched >= end])
    return updates


def _runs(tree: list[tuple[int, ...]], vertices: int) -> tuple[list[tuple[int, int]], tuple[tuple[int, int], ...]]:
    """Runs of fronts: whole subtrees first, then single fronts above them, deepest first; and the range of runs of each level."""
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
    """Write the place of each front's remainder into the table; returns the number of vectors that all remainders take.

    Within a run, the fronts of one depth share one place per child of a parent: a parent has added its children's remainders before
    the next ones are written.
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
