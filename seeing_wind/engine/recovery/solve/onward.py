"""From one block of a clip to the next: a held body's first field is the one that the block before ended with.

A body that is held comes back to where it was seen, so a field that is wrong for a few frames does not lose it, and Gauss-Newton finds
the right one without the receding horizon (`first_field`). How the force varies in space and time is known from the block before, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...errors import SimulationError
from ..prior.constants import PRIOR
from ..prior.kernel import Kernel, Prior, modes_for_variance
from ..prior.learning import prior_along, track_misfit
from .constants import PACE
from .forward import Forward
from .gauss_newton import Solution
from .solver import Solver


@dataclass(frozen=True)
class Onward:
    """What a block knows of the one after it."""

    kernel: Kernel
    """The hyperparameters learnt."""
    knot: float
    """Frames between knots that they ask for."""
    coefficients: np.ndarray
    """(overlap, modes, 3) of the force in the frames that the next block solves again [m/s²]."""


def continue_block(solver: Solver, before: Onward) -> tuple[Forward, Prior, Solution, int] | None:
    """Forward model, prior, solution with the modes of the block before, or more, and the Jacobians used; None where the body strays so.

    The force of the last frame that was solved is held to the block's end, as the first guess. Takes two Jacobians: one there, and one
    where that leads, with outliers weighed.
    """
    what, objective, frames = "Going on with the force so far", solver.objective, solver.objective.frames
    overlap, modes = before.coefficients.shape[:2]
    worth = modes_for_variance(before.kernel, solver.basis, solver.particles.x, PRIOR.unexpected)
    forward = solver.forward(solver.basis.first(max(modes, worth)), solver.knot(before.knot), frames)
    held_on = np.concatenate([before.coefficients, np.repeat(before.coefficients[-1:], max(0, frames - overlap), axis=0)])[:frames]
    theta = forward.pack(held_on, np.zeros(0))
    try:
        prior = prior_along(before.kernel, forward, forward.trajectory(theta), solver.expected, solver.objective)
        first = solver.solve(forward, prior, theta, 1, (0.02, 0.5), what, tolerance=PACE.coarse_tolerance)
        path = forward.trajectory(first.theta)
        solver.objective = objective.reweighted(objective.residual(path.x[None])[0])
        prior = prior_along(before.kernel, forward, path, solver.expected, solver.objective)
        found = solver.solve(forward, prior, first.theta, 1, (0.5, 0.8), what)
    except SimulationError:
        misfit = math.inf
    else:
        of_tracks = track_misfit(solver.objective, solver.basis.up_to(2).phi, found.residual)
        misfit = max(of_tracks, solver.objective.misfit(found.residual))
    if misfit >= PACE.refollow_misfit:
        solver.objective = objective
        return None
    return forward, prior, found, first.iterations + found.iterations
