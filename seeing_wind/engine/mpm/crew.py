"""Several threads go through the phases of one kernel together.

A phase is a number of tasks. Every worker takes tasks until none are left, and then waits until the others have finished theirs, turning
on the spot: waking threads that sleep takes as long as a substep of two hundred particles. Nobody ever waits for a task that no one
has taken, so it makes no difference how many of the workers really run at once.
"""
# Taichi reads the annotations of functions at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import numpy as np
import taichi as ti

_LINE = 16
"""Integers in a line of a cache: no two counters share one."""


def roster(phases: int) -> np.ndarray:
    """Counters of the tasks taken and done in each phase; those of the phases it goes through to be zero when a kernel is launched."""
    return np.zeros(2 * _LINE * phases, np.int32)


@ti.func
def taken(roster: ti.template(), phase):
    """A task of the phase for this worker alone; as many or more than there are when none is left."""
    return ti.atomic_add(roster[2 * _LINE * phase], 1)


@ti.func
def finish(roster: ti.template(), phase):
    """This worker has done a task of the phase."""
    ti.atomic_add(roster[2 * _LINE * phase + _LINE], 1)


@ti.func
def await_all(roster: ti.template(), phase, tasks):
    """Returns when all tasks of the phase are done, and what they wrote can be read."""
    while ti.atomic_add(roster[2 * _LINE * phase + _LINE], 0) < tasks:
        pass
