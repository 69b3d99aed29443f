"""One thread for NumPy's and SciPy's linear algebra while small matrices are factored.

OpenBLAS, which their wheels bring along, shares every product of matrices between all cores and waits in a loop for the slowest. The parts
of a mesh's matrix are too small for that, and where another program has a core, the wait costs ten to fifty times the work.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import scipy


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """One thread inside the block, as many as before after it. Does nothing where the libraries are not OpenBLAS."""
    before = [get() for get, _ in _controls()]
    for _, set_to in _controls():
        set_to(1)
    try:
        yield
    finally:
        for (_, set_to), count in zip(_controls(), before):
            set_to(count)


@cache
def _controls() -> list[tuple[Callable[[], int], Callable[[int], None]]]:
    """What tells and sets the number of threads, of each library."""
    found = []
    for package in (np, scipy):
        home = Path(str(package.__file__)).parent
        folders = home.parent / f"{package.__name__}.libs", home / ".dylibs"
        for path in (path for folder in folders if folder.is_dir() for path in folder.glob("*openblas*")):
            library = ctypes.CDLL(str(path))  # already loaded: this is the same one
            for suffix in ("64_", "", "_64"):
                names = [f"scipy_openblas_{verb}_num_threads{suffix}" for verb in ("get", "set")]
                if all(hasattr(library, name) for name in names):
                    found.append((getattr(library, names[0]), getattr(library, names[1])))
                    break
    return found
