"""From one block of a clip to the next: the block before provides the hyperparameters, and the force in the frames of the overlap.

A block with one before it is therefore not followed segment by segment (`first_field`): the receding horizon (`warm_start`) continues from
the overlap, and a coarse solve of the whole block starts there. A held body keeps returning to the same places, so its fine solve reuses
the modes and hyperparameters of the block before; for a free body they are learnt again.
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
from .first_field import DENSELY, USUAL, Pace
from .forward import Forward
from .gauss_newton import Solution
from .solver import Solver
from .warm_start import WarmStart, warm_start

WHAT = "Going on with the force so far"


@dataclass(frozen=True)
class Onward:
    """What a block hands on to the one after it."""

    kernel: Kernel
    """The learnt hyperparameters."""
    knot: float
    """Frames between knots that these hyperparameters require."""
    coefficients: np.ndarray
    """(overlap, modes, 3) coefficients of the force in the frames that the next block solves again [m/s²]."""
    misfit: float
    """Misfit of the block's solution, see `missed_by` [standard deviations]."""
    densely: bool = False
    """Whether the block was lost with sparse knots and found with denser ones, see `first_field.DENSELY`; a free body only."""


def continue_block(solver: Solver, before: Onward) -> tuple[Forward, Prior, Solution, int] | None:
    """Continue a held body from the block before, with at least as many modes.

    Returns:
        Forward model, prior, solution, and the number of Jacobians used; None if the solution strays or the body breaks down.
    """
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
    """Forward model, prior and coarse solution, with few modes and with knots as in the block before's own, starting from that block.

    Raises:
        SimulationError: when the body breaks down.
    """
    pace = pace_after(before)
    forward = solver.forward(pace.modes(solver.basis), solver.knot(pace.knot), solver.objective.frames)
    theta = forward.pack(_first_guess(solver, before)[:, : forward.shape[1]], np.zeros(0))
    prior = prior_along(before.kernel, forward, forward.trajectory(theta), solver.expected, solver.objective)
    most = min(max(1, solver.iterations - 1), pace.coarse_iterations)
    return forward, prior, solver.solve(forward, prior, theta, most, (0.02, 0.3), WHAT, tolerance=PACE.coarse_tolerance)


def pace_after(before: Onward | None) -> Pace:
    """The pace at which an elastic body is followed after the block `before`."""
    return DENSELY if before is not None and before.densely else USUAL


def astray(solver: Solver, before: Onward, found: Solution) -> bool:
    """Whether a solution's misfit is unusually large and clearly larger than that of the block before."""
    return missed_by(solver, found) >= max(PACE.refollow_misfit, PACE.refollow_worse * before.misfit)


def _first_guess(solver: Solver, before: Onward) -> np.ndarray:
    """(T, modes, 3) coefficients of the block's force: those known in the overlap, then those found by the receding horizon.

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
    """Misfit of a solution [standard deviations]: of the tracks projected on the body's modes, or of all targets, whichever is larger."""
    of_tracks = track_misfit(solver.objective, solver.basis.up_to(2).phi, found.residual)
    return max(of_tracks, solver.objective.misfit(found.residual))
