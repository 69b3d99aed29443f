"""Solutions of the sparse systems of a sheet, whose matrices are banded once the vertices are ordered along it."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded
from scipy.sparse import csr_matrix


class Banded:
    """Symmetric positive definite systems over the coordinates of V vertices, of which only neighbours are coupled."""

    def __init__(self, flat: np.ndarray) -> None:
        """flat: the vertices (V, 2) of the sheet laid flat."""
        along = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][0]
        order = np.argsort(flat @ along, kind="stable")
        self._order = (3 * order[:, None] + np.arange(3)).ravel()
        self._place = np.empty(self._order.size, int)
        self._place[self._order] = np.arange(self._order.size)

    def solve(self, matrix: csr_matrix, right: np.ndarray) -> np.ndarray:
        """The solution (3V,) or (3V, K) of matrix (3V, 3V) times it = right.

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        entries = matrix.tocoo()
        row, column = self._place[entries.row], self._place[entries.col]
        below = row >= column
        row, column, value = row[below], column[below], entries.data[below]
        band = np.zeros((int((row - column).max()) + 1, self._place.size))
        band[row - column, column] = value
        return solveh_banded(band, right[self._order], lower=True, check_finite=False)[self._place]
