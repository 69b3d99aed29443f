"""Settings of the compiler that hold for the kernels traced inside a block."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from .choice import default_real, set_default_real, ti


@contextlib.contextmanager
def compiled_in(real: object) -> Iterator[None]:
    """Kernels traced inside have literals and `float` of `real`: ti.f32, ti.f64, or NumPy's names for them.

    The compiler looks these up when a kernel is traced, at its first launch for arguments of these types.
    """
    before = default_real()
    set_default_real(ti.f32 if real in (ti.f32, np.float32, np.dtype(np.float32)) else ti.f64)
    try:
        yield
    finally:
        set_default_real(before)


@contextlib.contextmanager
def native_vectors() -> Iterator[None]:
    """Kernels compiled inside have vectors that stay vectors of the processor. Arrays of them must be `native.aligned`.

    By default the compiler takes its vectors apart into loose numbers, and leaves it to LLVM to find vectors again, which it seldom does.
    """
    with _set(real_matrix_scalarize=False):
        yield


@contextlib.contextmanager
def contracted() -> Iterator[None]:
    """Kernels traced inside may join a product and a sum into one instruction, and take every number for finite."""
    with _set(fast_math=True):
        yield


@contextlib.contextmanager
def compiled_sooner() -> Iterator[None]:
    """Kernels compiled inside are ready in a fifth of the time where they are long, and may take a little longer to run.

    The compiler's own search for terms that occur twice takes time with the square of a kernel's length, nine tenths of all compiling
    (docs/notebook/solver.md). Here that is left to LLVM, which finds the arithmetic but looks up anew, after every store, where an array
    is. Without it one place in an array is computed by several statements, which `cache_loop_invariant_global_vars` takes for several.
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
