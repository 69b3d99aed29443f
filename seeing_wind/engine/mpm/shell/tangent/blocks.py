"""Sparse matrices over the 3 V coordinates of a sheet's vertices, out of a small block for each face."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from ..bending import Bending


class Corners:
    """Which corners the faces (F, 3) of a mesh of V vertices have: row 9 f + 3 c + i of `gather` is coordinate i of corner c of face f."""

    def __init__(self, faces: np.ndarray, vertices: int) -> None:
        self.count = len(faces)
        column = (3 * faces[:, :, None] + np.arange(3)).ravel()
        entries = np.ones(len(column)), column.astype(np.int32), np.arange(len(column) + 1, dtype=np.int32)
        self.gather = csr_array(entries, shape=(len(column), 3 * vertices))

    @cached_property
    def scatter(self) -> csr_array:
        """The transpose: sums over the corners at each vertex."""
        return csr_array(self.gather.T)

    def assembled(self, blocks: np.ndarray) -> csr_array:
        """(3 V, 3 V) sum over faces of blocks (F, 9, 9) between the coordinates of their corners."""
        return csr_array(self.scatter @ (diagonal(blocks) @ self.gather))


def diagonal(blocks: np.ndarray) -> csr_array:
    """Block-diagonal matrix of blocks (F, m, n)."""
    count, rows, columns = blocks.shape
    column = np.broadcast_to(np.arange(count * columns, dtype=np.int32).reshape(count, 1, columns), blocks.shape)
    begin = columns * np.arange(count * rows + 1, dtype=np.int32)
    return csr_array((blocks.ravel(), column.ravel(), begin), shape=(count * rows, count * columns))


def curvatures(b: Bending) -> csr_array:
    """(9 F, 3 V): row 9 f + 3 k + i is coordinate i of the curvature vector k of face f (`bending`), of the vertices' coordinates."""
    entries = b.curvature.tocoo()
    (row, vertex), count = entries.coords, len(b.faces)
    rows = (9 * (row % count) + 3 * (row // count))[:, None] + np.arange(3)
    columns = 3 * vertex[:, None] + np.arange(3)
    values = np.repeat(entries.data, 3)
    return csr_array((values, (rows.ravel(), columns.ravel())), shape=(9 * count, 3 * b.curvature.shape[1]))

