"""From one block of a clip to the next: how the force varies in space and time is known, and what it is in the frames that both solve.

So a block that has one before it needs no coarse field (`first_field`): the receding horizon (`warm_start`) leads the body on from the
frames that are known, and Gauss-Newton goes on from there with all modes and knots.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...errors import SimulationError
from ..prior.constants import PRIOR
from ..prior.kernel import Kernel, Prior, modes_for_variance
from ..prior.learning import prior_along, track_misfit
from .constants import PACE
from .forward import Forward
from .gauss_newton import Solution
from .solver import Solver
from .warm_start import WarmStart, warm_start


@dataclass(frozen=True)
class Onward:
    """What a block knows of the one after it."""

    kernel: Kernel
    """The hyperparameters learnt."""
    knot: float
    """Frames between knots that they ask for."""
    coefficients: np.ndarray
    """(overlap, modes, 3) of the force in the frames that the next block solves again [m/s²]."""
    misfit: float
    """What the solution missed [standard deviations]."""


def continue_block(solver: Solver, before: Onward) -> tuple[Forward, Prior, Solution, int] | None:
    """Forward model, prior, solution with the modes of the block before, or more, and the Jacobians used; None where the body strays so.

    One Jacobian is taken at the first guess, and others where that leads, with outliers weighed.
    """
    what, objective, frames = "Going on with the force so far", solver.objective, solver.objective.frames
    modes = before.coefficients.shape[1]
    worth = modes_for_variance(before.kernel, solver.basis, solver.particles.x, PRIOR.unexpected)
    forward = solver.forward(solver.basis.first(max(modes, worth)), solver.knot(before.knot), frames)
    try:
        theta = forward.pack(_first_guess(solver, forward, before), np.zeros(0))
        prior = prior_along(before.kernel, forward, forward.trajectory(theta), solver.expected, solver.objective)
        first = solver.solve(forward, prior, theta, 1, (0.02, 0.5), what, tolerance=PACE.coarse_tolerance)
        path = forward.trajectory(first.theta)
        solver.objective = objective.reweighted(objective.residual(path.x[None])[0])
        prior = prior_along(before.kernel, forward, path, solver.expected, solver.objective)
        most = min(PACE.onward_iterations, solver.iterations - 1)
        found = solver.solve(forward, prior, first.theta, most, (0.5, 0.8), what)
    except SimulationError:
        misfit = math.inf
    else:
        misfit = missed_by(solver, found)
    if misfit >= max(PACE.refollow_misfit, PACE.refollow_worse * before.misfit):
        solver.objective = objective
        return None
    return forward, prior, found, first.iterations + found.iterations


def _first_guess(solver: Solver, forward: Forward, before: Onward) -> np.ndarray:
    """(T, modes, 3) coefficients of the block's force: those known, and after them what leads the body on.

    Raises:
        SimulationError: when the body breaks down.
    """
    frames, known = solver.objective.frames, before.coefficients[: solver.objective.frames]
    overlap = len(known)
    if frames == overlap:
        return known
    affine, early = solver.basis.up_to(1), solver.early_model()
    so_far = solver.forward(forward.basis, 1.0, overlap, early)
    state = so_far.trajectory(so_far.pack(known, np.zeros(0))).state(overlap)
    leader = solver.forward(affine, 1.0, frames, early)
    size = solver.expected.size * np.sqrt(np.diag(solver.expected.component))
    few = affine.phi.shape[1]
    lead = partial(warm_start, leader, solver.objective, size, solver.expected.speed, state, overlap, frames, known[-1, :few])
    led = solver.journal.once("lead", WarmStart, lead, overlap, frames, known)
    after = np.zeros((frames - overlap, *known.shape[1:]))
    after[:, : led.coefficients.shape[1]] = led.coefficients
    return np.concatenate([known, after])


def missed_by(solver: Solver, found: Solution) -> float:
    """By how much a solution misses the tracks, projected on the body's modes, or all targets, if that is more [standard deviations]."""
    of_tracks = track_misfit(solver.objective, solver.basis.up_to(2).phi, found.residual)
    return max(of_tracks, solver.objective.misfit(found.residual))
