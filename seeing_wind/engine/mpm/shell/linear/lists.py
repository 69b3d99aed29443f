"""Lists of unequal length, one after the other, as compiled kernels read them."""

from __future__ import annotations

import numpy as np


def rows_by(row: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Where each row's list begins (rows + 1,), and the list of all (n,): the numbers of the entries of `row` (n,) that name it. int32."""
    first = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=rows))])
    return first.astype(np.int32), np.argsort(row, kind="stable").astype(np.int32)
