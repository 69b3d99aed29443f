"""This solver on the problem of the benchmark."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from seeing_wind.engine.mpm.lattice.boundary import FREE
from seeing_wind.engine.mpm.laws.constitutive import LAWS as NUMBERS
from seeing_wind.engine.mpm.model import Model
from seeing_wind.engine.mpm.state import State

from .problem import Problem


def model_of(problem: Problem, substeps: int) -> Model:
    """The problem for this solver: one frame of that many substeps."""
    n = len(problem.x)
    p = problem
    columns = [np.full(n, value) for value in (p.mass, p.volume, p.mu, p.lam, p.yield_stress, p.viscosity)]
    return Model(
        *columns, np.full(n, NUMBERS[problem.law_name], np.int32), np.full(n, FREE, np.int32), np.zeros(3, np.int32),
        np.zeros((1, 1, 1), np.int32), offset=np.zeros(3), dx=problem.dx, frame_dt=substeps * problem.dt, substeps=substeps,
        gravity=np.array(problem.gravity),
    )  # fmt: skip


def state_of(problem: Problem) -> State:
    return State(problem.x, problem.v, problem.C, problem.F)


def seconds(action: Callable[[], object]) -> float:
    """That the action takes."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start
