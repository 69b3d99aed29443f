"""From one block of a clip to the next: how the force varies in space and time is known, and what it is in the frames that both solve.

So a block that has one before it is not followed segment by segment (`first_field`): the receding horizon (`warm_start`) leads the body on
from the frames that are known, and a coarse solve of the whole block begins there. A body that is held comes back to where it was seen, so
its fine solve takes the modes and the sizes of the block before; those of a free one are learnt again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ...errors import SimulationError
from ..prior.constants import PRIOR
from ..prior.kernel import Kernel, Prior, modes_for_variance
from ..prior.learning import prior_along, track_misfit
from .constants import PACE
from .first_field import USUAL
from .forward import Forward
from .gauss_newton import Solution
from .solver import Solver
from .warm_start import WarmStart, warm_start

WHAT = "Going on with the force so far"


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
    """Forward model, prior, solution of a held body with the modes of the block before, or more, and the Jacobians used; None where the
    body strays so."""
    objective, frames, modes = solver.objective, solver.objective.frames, before.coefficients.shape[1]
    worth = modes_for_variance(before.kernel, solver.basis, solver.particles.x, PRIOR.unexpected)
    forward = solver.forward(solver.basis.first(max(modes, worth)), solver.knot(before.knot), frames)
    try:
        coarse, _, first = lead_on(solver, before)
        theta, path = forward.pack(coarse.per_frame(first.theta), np.zeros(0)), coarse.trajectory(first.theta)
        solver.objective = objective.reweighted(objective.residual(path.x[None])[0])
        prior = prior_along(before.kernel, forward, path, solver.expected, solver.objective)
        most = min(PACE.onward_iterations, solver.iterations - 1)
        found = solver.solve(forward, prior, theta, most, (0.3, 0.8), WHAT)
    except SimulationError:
        found = None
    if found is None or astray(solver, before, found):
        solver.objective = objective
        return None
    return forward, prior, found, first.iterations + found.iterations


def lead_on(solver: Solver, before: Onward) -> tuple[Forward, Prior, Solution]:
    """Forward model, prior and solution with few modes and sparse knots.

    Raises:
        SimulationError: when the body breaks down.
    """
    forward = solver.forward(USUAL.modes(solver.basis), solver.knot(USUAL.knot), solver.objective.frames)
    theta = forward.pack(_first_guess(solver, before)[:, : forward.shape[1]], np.zeros(0))
    prior = prior_along(before.kernel, forward, forward.trajectory(theta), solver.expected, solver.objective)
    return forward, prior, solver.solve(forward, prior, theta, 1, (0.02, 0.3), WHAT, tolerance=PACE.coarse_tolerance)


def astray(solver: Solver, before: Onward, found: Solution) -> bool:
    """Whether a solution misses more than a usual one does, and clearly more than that of the block before."""
    return missed_by(solver, found) >= max(PACE.refollow_misfit, PACE.refollow_worse * before.misfit)


def _first_guess(solver: Solver, before: Onward) -> np.ndarray:
    """(T, modes, 3) coefficients of the block's force: those known, and after them what leads the body on.

    Raises:
        SimulationError: when the body breaks down.
    """
    frames, known = solver.objective.frames, before.coefficients[: solver.objective.frames]
    overlap = len(known)
    if frames == overlap:
        return known
    affine, early = solver.basis.up_to(1), solver.early_model()
    so_far = solver.forward(solver.basis.first(known.shape[1]), 1.0, overlap, early)
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
