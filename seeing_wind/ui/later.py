"""Modules that are read only when something of them is first used.

Most of this package works on results, and needs NumPy for it; to switch the extension on and draw its panels takes a third of the files.
So what is always needed writes `from . import results` and `results.build(...)`, and nothing is read before that call.
"""

from __future__ import annotations

import importlib.util
import sys


def declare(package: str, names: tuple[str, ...]) -> None:
    """Let modules of a package be read at the first use of one of their names. Those that are there already stay as they are."""
    for name in names:
        whole = f"{package}.{name}"
        spec = importlib.util.find_spec(whole)
        if whole in sys.modules or spec is None or spec.loader is None:
            continue
        spec.loader = importlib.util.LazyLoader(spec.loader)
        module = importlib.util.module_from_spec(spec)
        sys.modules[whole] = module
        spec.loader.exec_module(module)
        setattr(sys.modules[package], name, module)
