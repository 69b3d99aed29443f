"""Which compiler makes the kernels: SEEING_WIND_COMPILER=quadrants or taichi. The two are one language; their libraries differ."""

from __future__ import annotations

import importlib
import os
from typing import Any

from ...errors import UsageError
from .tracing import declared_outside_classes, hasten

NAMES = ("taichi", "quadrants")
DEFAULT = "taichi"
"""What requirements.txt installs; docs/notebook/solver.md says why."""
VARIABLE = "SEEING_WIND_COMPILER"


def chosen() -> str:
    """The compiler that the environment asks for, else the default.

    Raises:
        UsageError: for any other name.
    """
    name = os.environ.get(VARIABLE) or DEFAULT
    if name not in NAMES:
        raise UsageError(f"There is no compiler {name!r}.", f"Set {VARIABLE} to {' or '.join(NAMES)}, or not at all.")
    return name


NAME = chosen()
# Both print their versions on import, to stdout, where the worker's messages go; Taichi asks a server for a newer one when it starts.
# (Nor may stdout be another one meanwhile: they then take the shell for a graphical one and print after every launch.)
for variable, value in (("ENABLE_TAICHI_HEADER_PRINT", "0"), ("TI_SKIP_VERSION_CHECK", "ON"), ("ENABLE_QUADRANTS_HEADER_PRINT", "0")):
    os.environ.setdefault(variable, value)
with declared_outside_classes():
    ti: Any = importlib.import_module(NAME)
if NAME == "taichi":
    hasten()
_runtime = importlib.import_module(f"{NAME}.lang.impl").get_runtime


def default_real() -> Any:
    """What literals and the dtype `float` mean in a kernel that is traced now: ti.f32 or ti.f64."""
    return _runtime().default_fp


def set_default_real(real: Any) -> None:
    """Kernels traced from now on have literals and `float` of ti.f32 or ti.f64; the interface allows one choice for all, at the start."""
    _runtime().default_fp = real
