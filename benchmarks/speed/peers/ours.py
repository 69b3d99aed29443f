"""This solver on the problem of the benchmark."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from seeing_wind.engine.materials import PLASTIC_LAWS
from seeing_wind.engine.mpm.lattice.boundary import FREE
from seeing_wind.engine.mpm.laws.constitutive import LAWS as NUMBERS
from seeing_wind.engine.mpm.model import Model
from seeing_wind.engine.mpm.state import State

from .problem import Problem


def model_of(problem: Problem, substeps: int) -> Model:
    """The problem for this solver: one frame of that many substeps."""
    n, p = len(problem.x), problem
    # No peer has the viscous stress that elastic laws have here.
    viscosity = p.viscosity if p.law_name in PLASTIC_LAWS else 0.0
    return Model(
        mass=np.full(n, p.mass), volume=np.full(n, p.volume), mu=np.full(n, p.mu), lam=np.full(n, p.lam),
        yield_stress=np.full(n, p.yield_stress), viscosity=np.full(n, viscosity), law=np.full(n, NUMBERS[p.law_name], np.int32),
        role=np.full(n, FREE, np.int32), clamp_lo=np.zeros(3, np.int32), clamp=np.zeros((1, 1, 1), np.int32), offset=np.zeros(3),
        dx=p.dx, frame_dt=substeps * p.dt, substeps=substeps, gravity=np.array(p.gravity),
    )  # fmt: skip


def state_of(problem: Problem) -> State:
    return State(problem.x, problem.v, problem.C, problem.F)


def seconds(action: Callable[[], object]) -> float:
    """That the action takes."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start
