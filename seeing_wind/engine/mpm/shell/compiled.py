"""Launchers for the kernels of this room, and lists of unequal length in the form that kernels read."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from ..compiler import device
from ..compiler.launch import Launcher

DOUBLE = np.dtype(np.float64)


@cache
def launcher(kernel: Any, real: np.dtype = DOUBLE) -> Launcher:
    """The launcher of a kernel, compiled for the precision `real`; all sheets share it."""
    device.start()
    return Launcher(kernel, real)


def rows_by(row: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Groups the entries of `row` (n,) by value: where each row's list begins (rows + 1,), and the entries' indices (n,). Both int32."""
    first = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=rows))])
    return first.astype(np.int32), np.argsort(row, kind="stable").astype(np.int32)
