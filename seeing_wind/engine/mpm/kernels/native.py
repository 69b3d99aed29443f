"""Arrays for kernels that use the processor's SIMD vectors (`compiler.settings.native_vectors`), at addresses aligned for these."""

from __future__ import annotations

import numpy as np
import numpy.typing

_LARGEST = 64
"""Bytes of the largest vectors used: sixteen numbers in single precision, or eight in double."""


def aligned(shape: tuple[int, ...], real: np.typing.DTypeLike) -> np.ndarray:
    """An uninitialised array of dtype `real` at an aligned address, which NumPy's own arrays need not have."""
    kind = np.dtype(real)
    size = int(np.prod(shape))
    raw = np.empty(size + _LARGEST // kind.itemsize, kind)
    first = -raw.ctypes.data % _LARGEST // kind.itemsize
    return raw[first : first + size].reshape(shape)


def aligned_zeros(shape: tuple[int, ...], real: np.typing.DTypeLike) -> np.ndarray:
    """An `aligned` array of zeros."""
    array = aligned(shape, real)
    array[...] = 0.0
    return array


def aligned_copy(array: np.ndarray) -> np.ndarray:
    """An `aligned` copy of the array."""
    copy = aligned(array.shape, array.dtype)
    copy[...] = array
    return copy
