"""The kernels of this room, ready to launch, and lists of unequal length as they read them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from ..compiler import device
from ..compiler.launch import Launcher

DOUBLE = np.dtype(np.float64)


@cache
def launcher(kernel: Any, real: np.dtype = DOUBLE) -> Launcher:
    """What launches a kernel, traced in a precision; one for all sheets."""
    device.start()
    return Launcher(kernel, real)


def rows_by(row: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Where each row's list begins (rows + 1,), and the list of all (n,): the numbers of the entries of `row` (n,) that name it. int32."""
    first = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=rows))])
    return first.astype(np.int32), np.argsort(row, kind="stable").astype(np.int32)
