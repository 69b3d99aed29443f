"""Declaring and tracing kernels in half the time. Both are repeated in every process, even if the compiled kernel is cached on disk.

Taichi reads the source around every decorator to see whether a kernel belongs to a class, which takes half as long as all other imports of
the engine. For each of the tens of thousands of nodes in a kernel's syntax tree, it formats the line of source with carets under the node,
in case there is an error in it. And for every call of a function, which is traced where it is called, it looks up that function's source
again. Here no kernel belongs to a class, a position is given as file, line and text, and each source is looked up once.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import inspect
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def declared_outside_classes() -> Iterator[None]:
    """For the import of Taichi, which declares a hundred functions and kernels of its own, all outside classes: `inspect.getframeinfo` does
    not look up the source. That takes longer the more modules are loaded: four fifths of the import, once torch is loaded.
    """
    usual = inspect.getframeinfo
    inspect.getframeinfo = _without_source  # type: ignore[assignment]
    try:
        yield
    finally:
        inspect.getframeinfo = usual


def _without_source(frame: Any, context: int = 1) -> inspect.Traceback:
    """`inspect.getframeinfo` of a frame, with an empty line in place of the source."""
    return inspect.Traceback(frame.f_code.co_filename, frame.f_lineno, frame.f_code.co_name, [""], 0)


def speed_up_tracing() -> None:
    """Replace the slow parts of Taichi; to be called once, before the first kernel is declared."""
    importlib.import_module("taichi.lang.ast.ast_transformer_utils").ASTTransformerContext.get_pos_info = _place
    kernels: Any = importlib.import_module("taichi.lang.kernel_impl")
    kernels._inside_class = lambda level_of_class_stackframe: False
    for name in ("getsourcefile", "getsourcelines"):
        setattr(kernels, name, functools.cache(getattr(kernels, name)))


def _place(context: Any, node: Any) -> str:
    """Position of a node of the syntax tree, for an error message."""
    line = context.src[node.lineno - 1].rstrip()
    return f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:\n{line}\n'
