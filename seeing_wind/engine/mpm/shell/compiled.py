"""The kernels of this room, ready to launch."""

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
