"""Arrays for kernels whose vectors stay vectors of the processor (`compiler.settings.native_vectors`): at addresses that these can be
loaded from."""

from __future__ import annotations

import numpy as np
import numpy.typing

_LARGEST = 64
"""Bytes of the largest vectors used: sixteen numbers in single precision, eight in double."""


def aligned(shape: tuple[int, ...], real: np.typing.DTypeLike) -> np.ndarray:
    """An array of dtype `real`, not filled, at an address that vectors can be loaded from; NumPy's own may lie between."""
    kind = np.dtype(real)
    size = int(np.prod(shape))
    raw = np.empty(size + _LARGEST // kind.itemsize, kind)
    first = -raw.ctypes.data % _LARGEST // kind.itemsize
    return raw[first : first + size].reshape(shape)


def aligned_zeros(shape: tuple[int, ...], real: np.typing.DTypeLike) -> np.ndarray:
    """`aligned`, filled with zeros."""
    array = aligned(shape, real)
    array[...] = 0.0
    return array


def aligned_copy(array: np.ndarray) -> np.ndarray:
    """A copy of the array that is `aligned`."""
    copy = aligned(array.shape, array.dtype)
    copy[...] = array
    return copy
