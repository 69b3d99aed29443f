"""Single and double precision from one source: functions name no precision, and kernels are traced in each (`compiler.settings`)."""

from __future__ import annotations

import numpy as np

from ...errors import UsageError
from . import default_real, ti

DTYPES = {"single": np.float32, "double": np.float64}
"""The NumPy types of the two precisions."""


def dtype_of(precision: str) -> np.dtype:
    """NumPy's dtype of a precision. UsageError for an unknown one."""
    if precision not in DTYPES:
        raise UsageError(f"There is no precision {precision!r}.", f"Choose {' or '.join(DTYPES)}.")
    return np.dtype(DTYPES[precision])


def is_double() -> bool:
    """Whether the kernel being traced is in double precision; use inside `ti.static`."""
    return default_real() == ti.f64


def epsilon() -> float:
    """Machine epsilon in the precision being traced; use inside `ti.static`."""
    return float(np.finfo(np.float64 if is_double() else np.float32).eps)
