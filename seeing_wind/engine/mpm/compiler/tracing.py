"""Kernels declared and traced in half the time: that is done anew in every process, also where the compiled kernel is kept on the disk.

Taichi reads the source round every decorator to see whether a kernel belongs to a class, which takes it half as long as all other imports
of the engine do. For every node of a kernel's syntax tree, of tens of thousands, it lays out the line of source with carets under the
place, in case that there is an error in it. And for every call of a function, which is traced where it is called, it looks that function's
source up again. Here no kernel belongs to a class, a place is a file, a line and its text, and a source is looked up once.
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
    """For the import of Taichi, which declares a hundred functions and kernels of its own, all outside classes: frames are told without
    their source. To find that takes longer the more modules there are: four fifths of the import, once torch is there.
    """
    usual = inspect.getframeinfo
    inspect.getframeinfo = _without_source  # type: ignore[assignment]
    try:
        yield
    finally:
        inspect.getframeinfo = usual


def _without_source(frame: Any, context: int = 1) -> inspect.Traceback:
    """`inspect.getframeinfo` of a frame, with an empty line for that of the source."""
    return inspect.Traceback(frame.f_code.co_filename, frame.f_lineno, frame.f_code.co_name, [""], 0)


def hasten() -> None:
    """Once, before the first kernel is declared."""
    importlib.import_module("taichi.lang.ast.ast_transformer_utils").ASTTransformerContext.get_pos_info = _place
    kernels: Any = importlib.import_module("taichi.lang.kernel_impl")
    kernels._inside_class = lambda level_of_class_stackframe: False
    for name in ("getsourcefile", "getsourcelines"):
        setattr(kernels, name, functools.cache(getattr(kernels, name)))


def _place(context: Any, node: Any) -> str:
    """Where a node of the syntax tree stands, for an error's message."""
    line = context.src[node.lineno - 1].rstrip()
    return f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:\n{line}\n'
