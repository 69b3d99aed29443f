"""The prior of one block, and what the clip determines of it: hyperparameters, the stretch penalty, the solver's mismatch."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...mpm.state import Trajectory
from ...progress import Journal
from ..solve.forward import Forward
from ..solve.gauss_newton import Linearisation, Solution
from ..targets.constants import NOISE
from ..targets.objective import Objective
from ..targets.points import PointChannels
from ..targets.tracks import TrackChannels
from .constants import PRIOR
from .evidence import maximise_evidence, mismatch_scale, prefer_belief
from .kernel import Kernel, Places, Prior


@dataclass(frozen=True)
class Expected:
    """Scales estimated from the whole clip before the solve."""

    size: float
    """Root mean square acceleration of the field [m/s²]."""
    speed: np.ndarray
    """(V,) prior standard deviations of the initial velocities [m/s]."""
    component: np.ndarray
    """(3, 3) initial shape of the covariance of the force's components, with a trace of at most 3."""


def one_camera(objective: Objective) -> bool:
    """Whether the only targets are the tracks of one camera."""
    return len(objective.channels) == 1 and isinstance(objective.channels[0], TrackChannels)


def prior_along(kernel: Kernel, forward: Forward, path: Trajectory, expected: Expected, objective: Objective) -> Prior:
    """The prior with these hyperparameters along a simulated `path`, with the stretch penalty that the targets need."""
    prior = Prior(kernel, Places.along(forward.basis, path.x, forward.knots.at), expected.speed[: len(forward.velocity)])
    plastic = forward.model.plastic
    if plastic and any(isinstance(one, TrackChannels) for one in objective.channels):
        prior = prior.with_stretch_penalty(forward.basis, forward.x, path.F, PRIOR.stretch, volume_only=True)
    if not one_camera(objective):
        return prior
    return prior.with_stretch_penalty(forward.basis, forward.x, path.F, PRIOR.loose_stretch if plastic else PRIOR.stretch)


def learn_kernel(
    prior: Prior, normal: np.ndarray, pull: np.ndarray, expected: Expected, check: Callable[[], None], journal: Journal
) -> Kernel:
    """The kernel of greatest evidence.

    The present kernel stays for a body that is seen as one point, whose data cannot determine a length in space, and for a block in which
    the air is still throughout, whose data do not depend on the force.
    """
    if len(prior.places.project) == 1 or not normal.any():
        return prior.kernel
    return journal.once("learn", Kernel, partial(maximise_evidence, prior, normal, pull, expected.component, check), normal, pull)


def learn_hyperparameters(
    prior: Prior,
    forward: Forward,
    solution: Solution,
    objective: Objective,
    expected: Expected,
    check: Callable[[], None],
    journal: Journal,
) -> tuple[Prior, Linearisation, Objective]:
    """Learn the prior's hyperparameters and the size of the solver's mismatch.

    Returns:
        The prior, the linearisation whitened with the learnt mismatch, and the objective with it.
    """
    point = solution.point
    path = forward.trajectory(solution.theta)
    prior = prior_along(learn_kernel(prior, point.normal, solution.pull, expected, check, journal), forward, path, expected, objective)
    scale = _mismatch_factor(prior, forward, solution, objective)
    if scale is not None:
        other = objective.mismatched(scale)
        white = other.whiten(objective.unwhitened(np.concatenate([point.jacobian, point.residual[None]])))
        point = Linearisation.at(point.theta, white[-1].astype(np.float64), white[:-1])
        objective = other
        prior = prior_along(learn_kernel(prior, point.normal, point.pull, expected, check, journal), forward, path, expected, objective)
    return _with_stretch_belief(prior, forward, path, point, objective), point, objective


def _mismatch_factor(prior: Prior, forward: Forward, solution: Solution, objective: Objective) -> float | None:
    """Factor on the assumed mismatch; None to keep it.

    The mismatch of tracks is assumed beforehand and raised only if the solution clearly misses them: all tracks lie on the same slightly
    wrong body, so their residuals are not independent samples of the mismatch. With 3D points on a held body the mismatch cannot be
    learnt, as that of the clamp looks like a force.
    """
    if all(isinstance(one, PointChannels) for one in objective.channels):
        if forward.model.pinned.any():
            return None
        return NOISE.absorbed_factor * mismatch_scale(prior, objective, solution.point)
    left = 0.0 if forward.model.plastic else track_misfit(objective, forward.basis.up_to(2).phi, solution.residual)
    return NOISE.absorbed_factor * left if left > NOISE.track_misfit else None


def track_misfit(objective: Objective, modes: np.ndarray, white: np.ndarray) -> float:
    """Root mean square misfit of a simulation to the tracks, projected on the modes [standard deviations]; 0 without tracks.

    A mismatch of the body moves many tracks together, while noise is independent. So the residuals are projected on the body's modes, and
    the noise expected in the projection is subtracted.

    Args:
        objective: the objective that whitened the residuals.
        modes: (N, M) values of the modes at the particles.
        white: (channels (T+1),) whitened residuals.
    """
    series = white.reshape(objective.used.shape[1], -1)
    squares, count, at = 0.0, 0.0, 0
    seen = slice(objective.first, objective.first + len(objective.used))
    for one in objective.channels:
        rows = slice(at, at + one.count)
        at += one.count
        if isinstance(one, TrackChannels):
            directions = np.linalg.qr(one.points @ modes)[0]  # (K, M)
            together = np.einsum("km,kct->mct", directions, series[rows].reshape(len(directions), 2, -1))
            share = directions.shape[1] / len(directions)
            variance = np.where(one.targets.visible, one.targets.sigma, 0.0)[seen] ** 2  # (T+1, K)
            noise = np.einsum("ktu,uk->", objective.whitener[rows] ** 2, np.repeat(variance, 2, axis=1))
            squares += float((together**2).sum()) - share * float(noise)
            count += share * float(objective.used[:, rows].sum())
    return math.sqrt(max(squares, 0.0) / count) if count else 0.0


def _with_stretch_belief(prior: Prior, forward: Forward, path: Trajectory, point: Linearisation, objective: Objective) -> Prior:
    """The prior with a stretch penalty, unless the evidence rejects it. Under one camera, `prior_along` has already added the penalty."""
    if one_camera(objective) or forward.basis.phi.shape[1] == 1:
        return prior
    belief = prior.with_stretch_penalty(forward.basis, forward.x, path.F, PRIOR.loose_stretch)
    return prefer_belief(belief, prior, point, PRIOR.stretch_log_odds * noise_share(objective))


def noise_share(objective: Objective) -> float:
    """Variance of the noise of 3D points, relative to noise plus mismatch, 0..1; 1 for tracks.

    Noise looks like stretch, and therefore stretch is penalised. Points without noise do not need the penalty.
    """
    shares = [1.0]
    if all(isinstance(one, PointChannels) for one in objective.channels):
        noise, mismatch = zip(*(one.variances() for one in objective.channels if isinstance(one, PointChannels)))
        shares = [a / (a + b) for a, b in zip(noise, mismatch)]
    return max(shares)
