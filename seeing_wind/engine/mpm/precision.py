"""Single and double precision from one source.

Taichi gives a literal, and the dtype `float`, the runtime's `default_fp` at the moment a kernel is traced. Functions therefore name no
precision, and the kernels are traced once in each: the first launch for a precision happens inside `compiled_in`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np
import taichi as ti
from taichi.lang import impl

from ..errors import UsageError

DTYPES = {"single": np.float32, "double": np.float64}
"""NumPy's names of the two precisions."""


def dtype_of(precision: str) -> np.dtype:
    """NumPy's dtype of a precision. UsageError for an unknown one."""
    if precision not in DTYPES:
        raise UsageError(f"There is no precision {precision!r}.", f"Choose {' or '.join(DTYPES)}.")
    return np.dtype(DTYPES[precision])


@contextlib.contextmanager
def compiled_in(real: object) -> Iterator[None]:
    """Kernels traced inside have literals and `float` of `real`: ti.f32, ti.f64, or NumPy's names for them."""
    runtime = impl.get_runtime()
    before = runtime.default_fp
    runtime.default_fp = ti.f32 if real in (ti.f32, np.float32, np.dtype(np.float32)) else ti.f64
    try:
        yield
    finally:
        runtime.default_fp = before


@contextlib.contextmanager
def contracted() -> Iterator[None]:
    """Kernels traced inside may join a product and a sum into one instruction, and take every number for finite."""
    config = impl.get_runtime().prog.config()
    before = config.fast_math
    config.fast_math = True
    try:
        yield
    finally:
        config.fast_math = before


def is_double() -> bool:
    """Whether the kernel being traced is in double precision; use inside `ti.static`."""
    return impl.get_runtime().default_fp == ti.f64


def epsilon() -> float:
    """Spacing of numbers at 1 in the precision being traced; use inside `ti.static`."""
    return float(np.finfo(np.float64 if is_double() else np.float32).eps)
