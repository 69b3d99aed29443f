"""Several threads go through the phases of one kernel together.

A phase is a number of tasks. Every worker takes tasks until none are left, and then waits until the others have finished theirs, turning
on the spot: waking threads that sleep takes as long as a substep of two hundred particles. Nobody ever waits for a task that no one
has taken, so it makes no difference how many of the workers really run at once.
"""
# The compiler reads the annotations of functions at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import numpy as np

from ..compiler import ti

_LINE = 16
"""Integers in a line of a cache: no two counters share one."""


counters = ti.types.ndarray(dtype=ti.i32, ndim=2)
"""A roster, as a kernel's argument."""


def roster(phases: int, workers: int) -> np.ndarray:
    """Counters of the tasks taken and done in each phase, (phases, numbers); zero in all that a kernel is to go through."""
    return np.zeros((phases, _LINE * (1 + workers)), np.int32)


@ti.func
def share(part, parts, count):
    """First and last (exclusive) of a part of `count` things."""
    each = (count + parts - 1) // parts
    return ti.min(part * each, count), ti.min((part + 1) * each, count)


@ti.func
def take(roster: ti.template(), phase, worker, workers, tasks):
    """A task of the phase for this worker alone; `tasks` when none is left.

    A worker takes those of its own share first, the same in every phase, as what they need may still be in its core's cache.
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
    """This worker has done a task of the phase."""
    ti.atomic_add(roster[phase, 0], 1)


@ti.func
def await_all(roster: ti.template(), phase, tasks):
    """Returns when all tasks of the phase are done, and what they wrote can be read."""
    while ti.atomic_add(roster[phase, 0], 0) < tasks:
        pass
