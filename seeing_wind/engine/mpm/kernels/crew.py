"""Several threads ("workers") go through the phases of one kernel together.

A phase is a number of tasks. Every worker takes tasks until none are left, and then spins until the others have finished theirs, because
waking a sleeping thread takes as long as a substep of two hundred particles. No worker ever waits for a task that has not been taken, so
it does not matter how many of the workers really run at once.
"""
# The compiler reads the annotations of functions at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import numpy as np

from ..compiler import ti

_LINE = 16
"""Integers in a cache line: no two counters share a line."""


counters = ti.types.ndarray(dtype=ti.i32, ndim=2)
"""Type of a roster as a kernel's argument."""


def roster(phases: int, workers: int) -> np.ndarray:
    """Counters of the tasks taken and done in each phase, (phases, numbers) int32; they must be zero when a kernel begins."""
    return np.zeros((phases, _LINE * (1 + workers)), np.int32)


@ti.func
def share(part, parts, count):
    """First and last (exclusive) of the things in a part, if `count` things are divided into `parts` parts."""
    each = (count + parts - 1) // parts
    return ti.min(part * each, count), ti.min((part + 1) * each, count)


@ti.func
def take(roster: ti.template(), phase, worker, workers, tasks):
    """A task of the phase for this worker alone; `tasks` when none is left.

    A worker takes the tasks of its own share first, the same in every phase, because their data may still be in its core's cache.
    """
    found, k = tasks, 0
    while k < workers and found == tasks:
        whose = (worker + k) % workers
        begin, end = share(whose, workers, tasks)
        task = begin + ti.atomic_add(roster[phase, _LINE * (1 + whose)], 1)
        if task < end:
            found = task
        k += 1
    return found


@ti.func
def finish(roster: ti.template(), phase):
    """Count a task of the phase as done."""
    ti.atomic_add(roster[phase, 0], 1)


@ti.func
def await_all(roster: ti.template(), phase, tasks):
    """Wait until all tasks of the phase are done and what they wrote can be read."""
    while ti.atomic_add(roster[phase, 0], 0) < tasks:
        pass
