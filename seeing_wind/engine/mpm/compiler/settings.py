"""Settings of the compiler for the kernels that are traced inside a block."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from .choice import default_real, set_default_real, ti


@contextlib.contextmanager
def compiled_in(real: object) -> Iterator[None]:
    """In kernels traced inside, literals and `float` have the precision `real`: ti.f32, ti.f64, or the NumPy types of these.

    The compiler reads the setting when it traces a kernel, at the first launch with arguments of the given types.
    """
    before = default_real()
    set_default_real(ti.f32 if real in (ti.f32, np.float32, np.dtype(np.float32)) else ti.f64)
    try:
        yield
    finally:
        set_default_real(before)


@contextlib.contextmanager
def native_vectors() -> Iterator[None]:
    """Kernels compiled inside use SIMD vectors of the processor for their vectors. Arrays of such vectors must be `native.aligned`.

    By default the compiler splits its vectors into single numbers and leaves it to LLVM to vectorise again, which it seldom does.
    """
    with _set(real_matrix_scalarize=False):
        yield


@contextlib.contextmanager
def contracted() -> Iterator[None]:
    """Kernels traced inside may contract a product and a sum into one instruction, and assume that every number is finite."""
    with _set(fast_math=True):
        yield


@contextlib.contextmanager
def compiled_sooner() -> Iterator[None]:
    """Long kernels compiled inside compile in a fifth of the time, but may run a little slower.

    The compiler's own search for common subexpressions takes time with the square of a kernel's length, nine tenths of all compiling
    (docs/notebook/solver.md). Here it is left to LLVM, which finds common arithmetic but looks up an array's address again after every
    store. Without that search, one place in an array is computed by several statements, which `cache_loop_invariant_global_vars` would take
    for different places; so this is switched off, too.
    """
    with _set(opt_level=0, cache_loop_invariant_global_vars=False):
        yield


@contextlib.contextmanager
def _set(**values: object) -> Iterator[None]:
    before = {name: getattr(ti.cfg, name) for name in values}
    try:
        for name, value in values.items():
            setattr(ti.cfg, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(ti.cfg, name, value)
