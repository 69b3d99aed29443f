"""Cholesky factors of a mesh's matrix, with a 3 x 3 block per pair of vertices.

`dissection` gives the order of elimination, `fronts` what depends on the pattern only, and `front_kernels` does the arithmetic.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from ...compiler.settings import contracted
from ...kernels.native import aligned, aligned_zeros
from ..compiled import launcher
from . import front_kernels, solve_kernels
from .dissection import nested_dissection
from .fronts import Fronts


class BlockCholesky:
    """The order of elimination for one pattern; `factor` for each matrix of it.

    Args:
        pattern: (V, V), symmetric, diagonal included; its values are not used.
        places: (V, 3) where the vertices lie, for halving them.

    `pairs` (B, 2) has the vertices (row, column) of each block; the other half of the matrix follows by symmetry.
    """

    def __init__(self, pattern: csr_array, places: np.ndarray) -> None:
        groups, tree = nested_dissection(pattern, places)
        self.order = np.concatenate(groups)
        self._rank = np.empty(len(places), dtype=np.int64)
        self._rank[self.order] = np.arange(len(places))
        row, column = pattern.tocoo().coords
        lower = self._rank[row] >= self._rank[column]
        by_column = np.lexsort((self._rank[row[lower]], self._rank[column[lower]]))
        self.pairs = np.stack([row[lower][by_column], column[lower][by_column]], axis=1)
        self.fronts = Fronts.of(np.array([len(group) for group in groups]), tree, *self._rank[self.pairs].T)

    def slots(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Numbers of the blocks (row, column); no row may come before its column in the order of elimination."""
        size = len(self.order)
        key = self._rank[self.pairs[:, 1]] * size + self._rank[self.pairs[:, 0]]
        return np.searchsorted(key, self._rank[column] * size + self._rank[row])

    def later(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Whether the matrix stores the block (row, column) rather than its transpose."""
        return self._rank[row] >= self._rank[column]

    @cached_property
    def _single(self) -> Factors:
        return Factors(self, np.float32)

    @cached_property
    def _double(self) -> Factors:
        return Factors(self, np.float64)

    def factor(self, blocks: np.ndarray) -> Factors:
        """Factors of the positive definite matrix with the blocks (B, 3, 3) of `pairs`, in the blocks' precision, single or double.

        They overwrite the factors made before in the same precision.

        Raises:
            numpy.linalg.LinAlgError: for a matrix that is not positive definite, or not finite.
        """
        factors = self._single if blocks.dtype == np.float32 else self._double
        factors.make(blocks)
        return factors


class Factors:
    """Solves with one matrix."""

    def __init__(self, plan: BlockCholesky, real: type[np.floating]) -> None:
        self._fronts, self._order = plan.fronts, plan.order.astype(np.int32)
        self.precision: np.dtype[np.floating] = np.dtype(real)
        rows, own, below = self._fronts.vectors
        self._rows, self._remainder = aligned((rows, 8), real), aligned((self._fronts.remainders, 8), real)
        self._own, self._below = aligned_zeros((own, 8), real), aligned_zeros((below, 8), real)
        self._failed = np.zeros(len(self._fronts.table), np.int32)
        kernels = front_kernels.factor, solve_kernels.forward, solve_kernels.there_and_back, solve_kernels.backward
        self._factor, self._forward, self._there_and_back, self._backward = (launcher(kernel, self.precision) for kernel in kernels)

    def make(self, blocks: np.ndarray) -> None:
        """Compute the factors; see `BlockCholesky.factor`."""
        if not np.isfinite(blocks).all():
            raise np.linalg.LinAlgError("the matrix is not finite")
        f, rows, rest = self._fronts, self._rows, self._remainder
        with contracted():
            for begin, end in f.levels:
                self._factor(
                    begin, end, f.runs, f.table, f.slots, blocks, f.children, f.places, rows.reshape(-1), rows, rest.reshape(-1), rest,
                    self._failed,
                )  # fmt: skip
        if self._failed.any():
            front = int(np.argmax(self._failed))
            vertex = self._order[f.table[front, front_kernels.FIRST]]
            raise np.linalg.LinAlgError(f"the matrix is not positive definite at vertex {vertex}")

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The solution x (V, 3) of matrix x = right (V, 3), both float64."""
        f, result = self._fronts, np.empty_like(right)
        around = f.runs, f.table, f.children, f.places, self._order
        room = self._rows, self._own.reshape(-1), self._own, self._below.reshape(-1), self._below
        split, end = f.levels[0][1] if len(f.levels) > 1 else 0, len(f.runs)
        with contracted():
            if split:
                self._forward(0, split, *around, right, *room)
            self._there_and_back(split, end, *around, right, result, *room)
            if split:
                self._backward(0, split, *around, result, *room)
        return result
