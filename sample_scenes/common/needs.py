"""Where a package of the engine is missing, a script ends with the engine's sentence on it in place of a traceback."""

from __future__ import annotations

import sys
from types import TracebackType

from seeing_wind.engine.errors import unloaded


def tell_missing_packages() -> None:
    """Call it in a script before anything is imported that is not in Python's standard library."""
    sys.excepthook = _end


def _end(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if isinstance(error, ImportError) and not (error.name or "").startswith("seeing_wind"):
        print(unloaded(error), file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)
