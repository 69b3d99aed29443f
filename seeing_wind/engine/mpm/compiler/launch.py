"""Launching one kernel thousands of times: only arguments that have changed are passed again.

Both compilers process every argument of every launch in Python. For a kernel with twenty arrays this takes Taichi over a millisecond, as
long as a substep of five thousand particles (docs/notebook/solver.md has both times). Neither has an interface to avoid it; the calls used
here are those of its own `Kernel.launch_kernel`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from typing import Any

import numpy as np

from .choice import NAME, _runtime, ti
from .settings import compiled_in, compiled_sooner, native_vectors


class Launcher:
    """Launches a kernel whose arguments are compile-time constants, int32 numbers and contiguous NumPy arrays.

    The dtypes of the arrays and the compile-time constants must stay those of the first launch. Arrays are compared by identity: their
    contents may change between launches.
    """

    def __init__(self, kernel: Any, real: np.dtype, native: bool = True, keeps: bool = True, sooner: bool = False) -> None:
        """kernel: a function decorated with ti.kernel; real: the precision to trace it in; native: compile it with `native_vectors`.

        keeps: keep references to the arrays, to compare them at the next launch. Better not for a launcher that lives as long as the
            process and gets each array only once.
        sooner: compile it with `compiled_sooner`.
        """
        self.kernel, self.keeps = kernel, keeps
        self.settings: list[Callable[[], AbstractContextManager[None]]] = [partial(compiled_in, real)]
        self.settings += [setting for setting, wanted in ((native_vectors, native), (compiled_sooner, sooner)) if wanted]
        self.last: list[Any] = []

    def __call__(self, *args: Any) -> None:
        if not self.last:
            self._prepare(args)
        for slot, (old, new) in enumerate(zip(self.last, args)):
            if old is not new:
                self._set(slot, new)
        if self.keeps:
            self.last = list(args)
        self.program.launch_kernel(self.compiled, self.context)

    def _prepare(self, args: tuple[Any, ...]) -> None:
        self.program = _runtime().prog
        with ExitStack() as settings:
            for setting in self.settings:
                settings.enter_context(setting())
            self.compiled, self.context = _compiled(self.program, self.kernel._primal, args)
        self.last = [None] * len(args)
        annotations = [parameter.annotation for parameter in inspect.signature(self.kernel).parameters.values()]
        constant = [isinstance(annotation, ti.template) or annotation is ti.template for annotation in annotations]
        # Compile-time constants have no place among the arguments of a launch.
        places = [i - sum(constant[:i]) for i in range(len(args))]
        self.places = [None if constant[i] else _place(place) for i, place in enumerate(places)]
        self.element_axes = [getattr(a.dtype, "ndim", 0) if isinstance(a, ti.types.ndarray) else 0 for a in annotations]

    def _set(self, slot: int, value: Any) -> None:
        place = self.places[slot]
        if place is None:
            return
        if isinstance(value, np.ndarray):
            assert value.flags.c_contiguous
            shape = value.shape[: value.ndim - self.element_axes[slot]]
            self.context.set_arg_external_array_with_shape(place, value.ctypes.data, value.nbytes, shape, 0)
        else:
            self.context.set_arg_int(place, int(value))


def _compiled(program: Any, kernel: Any, args: tuple[Any, ...]) -> tuple[Any, Any]:
    """The kernel compiled for arguments such as these, and the context that holds the arguments of its launches."""
    if NAME == "quadrants":
        kernel.raise_on_templated_floats = ti.cfg.raise_on_templated_floats  # as its own launch does before it looks up the kernel
        traced = kernel.materialized_kernels[kernel.ensure_compiled(*args)]
        compiled = program.compile_kernel(program.config(), program.get_device_caps(), traced).compiled_kernel_data
    else:
        traced = kernel.compiled_kernels[kernel.ensure_compiled(*args)]
        compiled = program.compile_kernel(program.config(), program.get_device_caps(), traced)
    return compiled, traced.make_launch_context()


def _place(number: int) -> Any:
    """Argument `number` as the launch context wants it identified."""
    return number if NAME == "quadrants" else (number,)
