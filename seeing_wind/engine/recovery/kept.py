"""What a block contributes to the clip: its frames before the next block begins, and what the next block takes over."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..mpm.state import Trajectory
from .diagnostics.posterior import posterior_deviation, unseen_variation
from .prior.constants import PRIOR
from .prior.kernel import knots_for_variance
from .solve.block import BlockSolver
from .solve.constants import PACE
from .solve.onward import Onward
from .solve.stiffness import Stiffness, covariance_with
from .targets.points import PointChannels


@dataclass(frozen=True)
class Kept:
    """What a block contributes to the clip: its frames before the next block begins."""

    acceleration: np.ndarray
    """(T, N, 3) acceleration by the force [m/s²]."""
    deviation: np.ndarray
    """(T, N, 3) posterior standard deviation of the acceleration [m/s²]."""
    trajectory: Trajectory
    """The motion up to the next block's first frame."""
    iterations: int
    converged: bool
    knot_spacing: float
    """Frames between knots."""
    stiffness: Stiffness
    wild: np.ndarray
    """(T,) bool, see `solve.block.Found`."""
    onward: Onward
    """What the next block takes over."""


def kept_of(solver: BlockSolver, frames: int) -> Kept:
    """Solve a block, and keep the first `frames` of its solution, with the posterior deviation."""
    found = solver.run()
    # The stretch penalty is an assumption, not knowledge, so the deviation does not include it.
    covariance = covariance_with(found.last.point.normal + replace(found.prior, stretch=None).precision(), found.joint)
    path, acceleration = found.trajectory, found.forward.acceleration(found.last.theta)[:frames]
    deviation = posterior_deviation(found.forward, covariance)[:frames]
    points = all(isinstance(one, PointChannels) for one in solver.objective.channels)
    if solver.start is not None and solver.particles.pinned.any() and points:
        deviation *= PRIOR.later_optimism
    knot = knots_for_variance(found.prior.kernel, found.forward.basis, path.x, PACE.knot, PRIOR.between_knots)
    if found.forward.shape[1] == 1:
        deviation = np.hypot(deviation, unseen_variation(acceleration))
    return Kept(
        acceleration,
        deviation,
        Trajectory(path.x[: frames + 1], path.v[: frames + 1], path.C[: frames + 1], path.F[: frames + 1], path.substeps[:frames]),
        found.iterations,
        found.last.converged,
        found.forward.knots.spacing,
        found.stiffness,
        found.wild[:frames],
        Onward(found.prior.kernel, knot, found.forward.per_frame(found.last.theta)[frames:], found.misfit, found.densely),
    )
