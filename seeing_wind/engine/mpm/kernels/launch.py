"""Launching one kernel thousands of times: arguments are handed over again only where they changed.

Taichi looks at every argument of every launch in Python, which for a kernel of twenty arrays takes over a millisecond, as long as a
substep of five thousand particles. Taichi 1.7 has no interface for this; the four calls used here are those of its own
`Kernel.launch_kernel`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from taichi.lang import impl
from taichi.lang.matrix import MatrixType
from taichi.types import ndarray_type, template

from ..precision import compiled_in
from .native import native_vectors


class Launcher:
    """Launches a kernel whose arguments are compile-time constants, int32 numbers and contiguous NumPy arrays.

    The dtypes of the arrays and the compile-time constants must stay those of the first launch. An array that comes again is known by
    its identity: what is in it may change.
    """

    def __init__(self, kernel: Any, real: np.dtype) -> None:
        """kernel: a function decorated with ti.kernel; real: the precision to trace it in."""
        self.kernel, self.real = kernel._primal, real
        self.last: list[Any] = []

    def __call__(self, *args: Any) -> None:
        if not self.last:
            self._prepare(args)
        for slot, (old, new) in enumerate(zip(self.last, args)):
            if old is not new:
                self._set(slot, new)
        self.last = list(args)
        impl.get_runtime().prog.launch_kernel(self.compiled, self.context)

    def _prepare(self, args: tuple[Any, ...]) -> None:
        with native_vectors(), compiled_in(self.real):
            traced = self.kernel.compiled_kernels[self.kernel.ensure_compiled(*args)]
            program = impl.get_runtime().prog
            self.compiled = program.compile_kernel(program.config(), program.get_device_caps(), traced)
        self.context = traced.make_launch_context()
        self.last = [None] * len(args)
        annotations = [argument.annotation for argument in self.kernel.arguments]
        constant = [isinstance(annotation, template) or annotation is template for annotation in annotations]
        # Compile-time constants take no place among the arguments.
        self.places = [None if constant[i] else i - sum(constant[:i]) for i in range(len(args))]
        self.element_axes = [
            a.dtype.ndim if isinstance(a, ndarray_type.NdarrayType) and isinstance(a.dtype, MatrixType) else 0 for a in annotations
        ]

    def _set(self, slot: int, value: Any) -> None:
        place = self.places[slot]
        if place is None:
            return
        if isinstance(value, np.ndarray):
            assert value.flags.c_contiguous
            shape = value.shape[: value.ndim - self.element_axes[slot]]
            self.context.set_arg_external_array_with_shape((place,), value.ctypes.data, value.nbytes, shape, 0)
        else:
            self.context.set_arg_int((place,), int(value))
