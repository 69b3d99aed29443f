"""Which compiler the kernels use: SEEING_WIND_COMPILER=quadrants or taichi. Both have the same language; their packages differ."""

from __future__ import annotations

import importlib
import os
from typing import Any

from ...errors import UsageError
from .tracing import declared_outside_classes, speed_up_tracing

NAMES = ("taichi", "quadrants")
DEFAULT = "taichi"
"""The one that requirements.txt installs; docs/notebook/solver.md gives the reasons."""
VARIABLE = "SEEING_WIND_COMPILER"


def chosen() -> str:
    """The compiler that the environment variable names, else the default.

    Raises:
        UsageError: for an unknown name.
    """
    name = os.environ.get(VARIABLE) or DEFAULT
    if name not in NAMES:
        raise UsageError(f"There is no compiler {name!r}.", f"Set {VARIABLE} to {' or '.join(NAMES)}, or not at all.")
    return name


NAME = chosen()
# Both print their versions on import, to stdout, where the worker's messages go; Taichi asks a server for a newer version when it starts.
# (stdout must not be redirected instead: both would then take the shell for a graphical one and print after every launch.)
for variable, value in (("ENABLE_TAICHI_HEADER_PRINT", "0"), ("TI_SKIP_VERSION_CHECK", "ON"), ("ENABLE_QUADRANTS_HEADER_PRINT", "0")):
    os.environ.setdefault(variable, value)
with declared_outside_classes():
    ti: Any = importlib.import_module(NAME)
if NAME == "taichi":
    speed_up_tracing()
_runtime = importlib.import_module(f"{NAME}.lang.impl").get_runtime


def default_real() -> Any:
    """The precision, ti.f32 or ti.f64, that literals and the dtype `float` have in a kernel traced now."""
    return _runtime().default_fp


def set_default_real(real: Any) -> None:
    """Give literals and `float` the precision ti.f32 or ti.f64 in kernels traced from now on. The compiler's public interface only allows
    one choice for all kernels, at its start."""
    _runtime().default_fp = real
