"""What a window believes of the field, and how the clip changes that: sizes, stretch, how far the solver is from real bodies."""

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
from ..targets.objective import Objective
from ..targets.points import PointChannels
from ..targets.tracks import TrackChannels
from .evidence import FAITH, held_to, learn, mismatch_scale
from .kernel import MEASURED_STRETCH, PLASTIC_STRETCH, STRETCH, SWELLING, Kernel, Places, Prior

MISMATCH_SCALES = tuple(2.0**power for power in range(-9, 4))
"""Factors on the mismatch of points in 3D that are tried."""
ABSORBED = 4.0
"""How much of the mismatch looks like a force: what the residuals still show of it must be taken times this."""
STRAYED = 3.0
"""Misfit that all tracks of a mode show together, in standard deviations, beyond which a window is followed again, finely: 0.1 to 0.4 of
leaves, posts and plants, 1.4 of a banner that turns edge-on, 6 of a flag that was lost."""
UNEXPLAINED = 0.5
"""The same of a solution, beyond which the mismatch of tracks is larger than believed, as of soft sheets that swing far: 0.1 to 0.2 of the
sheet and the post of another solver, 0.3 of the banner."""


@dataclass(frozen=True)
class Expected:
    """What the clip as a whole says beforehand."""

    size: float
    """Root mean square acceleration of the field [m/s²]."""
    speed: np.ndarray
    """(V,) standard deviations of the initial velocities [m/s]."""
    component: np.ndarray
    """(3, 3) covariance of the force's components, trace at most 3, before anything is learnt."""


def one_camera(objective: Objective) -> bool:
    """Whether all that was seen are tracks of one camera."""
    return len(objective.channels) == 1 and isinstance(objective.channels[0], TrackChannels)


def prior_along(kernel: Kernel, forward: Forward, path: Trajectory, expected: Expected, objective: Objective) -> Prior:
    """The prior of these sizes along a simulation, with what cameras must believe of stretch."""
    prior = Prior(kernel, Places.along(forward.basis, path.x, forward.knot_spacing), expected.speed[: len(forward.velocity)])
    plastic = forward.model.plastic
    if plastic and any(isinstance(one, TrackChannels) for one in objective.channels):
        prior = prior.turning(forward.basis, forward.x, path.F, forward.knot_spacing, SWELLING, volume_only=True)
    if not one_camera(objective):
        return prior
    return prior.turning(forward.basis, forward.x, path.F, forward.knot_spacing, PLASTIC_STRETCH if plastic else STRETCH)


def learnt(
    prior: Prior, normal: np.ndarray, pull: np.ndarray, expected: Expected, check: Callable[[], None], journal: Journal = Journal()
) -> Kernel:
    """The prior's sizes learnt; a body that is seen as a point keeps the first ones, as it could only learn a depth that it has not."""
    if len(prior.places.project) == 1:
        return prior.kernel
    return journal.once("learn", Kernel, partial(learn, prior, normal, pull, expected.component, check), normal, pull)


def learn_all(
    prior: Prior,
    forward: Forward,
    solution: Solution,
    objective: Objective,
    expected: Expected,
    check: Callable[[], None],
    journal: Journal = Journal(),
) -> tuple[Prior, Linearisation, Objective]:
    """The prior's sizes, and how far the solver is from the real body; the linearisation with that known.

    Returns:
        the prior, the linearisation, and the objective with the mismatch learnt.
    """
    point = solution.point
    path = forward.nearby(solution.theta)
    prior = prior_along(learnt(prior, point.normal, solution.pull, expected, check, journal), forward, path, expected, objective)
    scale = _mismatch(prior, forward, solution, objective)
    if scale is not None:
        other = objective.mismatched(scale)
        white = other.whiten(objective.unwhitened(np.concatenate([point.jacobian, point.residual[None]])))
        point = Linearisation.at(point.theta, white[-1].astype(np.float64), white[:-1])
        pull = point.normal @ point.theta - point.jacobian @ point.residual
        objective = other
        prior = prior_along(learnt(prior, point.normal, pull, expected, check, journal), forward, path, expected, objective)
    return _believing(prior, forward, path, point, objective), point, objective


def _mismatch(prior: Prior, forward: Forward, solution: Solution, objective: Objective) -> float | None:
    """Factor on the mismatch that was believed; None leaves it.

    For pixels it is known better than it can be learnt, that of tracks which all lie on one slightly wrong body, unless even the solution
    does not come near them. That of a clamp, seen by points, cannot be learnt either: all of it looks like a force.
    """
    if all(isinstance(one, PointChannels) for one in objective.channels):
        if forward.model.pinned.any():
            return None
        return ABSORBED * mismatch_scale(prior, objective, solution.point, MISMATCH_SCALES)
    left = 0.0 if forward.model.plastic else strayed(objective, forward.basis.up_to(2).phi, solution.residual)
    return ABSORBED * left if left > UNEXPLAINED else None


def strayed(objective: Objective, modes: np.ndarray, white: np.ndarray) -> float:
    """How far a simulation is from what was seen of the modes, in standard deviations (root mean square); 0 without tracks.

    The mismatch with the real body is one of all tracks together, and spread over them, so only what they show together counts, less what
    the noise of each is expected to leave of it.

    Args:
        objective: that whitened the residuals.
        modes: (N, M) on the particles.
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


def _believing(prior: Prior, forward: Forward, path: Trajectory, point: Linearisation, objective: Objective) -> Prior:
    """The prior with a belief about stretch, unless the clip speaks against it; that of one camera is given."""
    if one_camera(objective) or forward.basis.phi.shape[1] == 1:
        return prior
    belief = prior.turning(forward.basis, forward.x, path.F, forward.knot_spacing, MEASURED_STRETCH)
    return held_to(belief, prior, point, FAITH * noise_share(objective))


def noise_share(objective: Objective) -> float:
    """Share of noise in what separates points in 3D from the simulation, 0..1; the rest is the mismatch of the solver. One for tracks.

    Stretch is believed to be none because noise looks like it. Points without noise need no such help.
    """
    shares = [1.0]
    if all(isinstance(one, PointChannels) for one in objective.channels):
        noise, mismatch = zip(*(one.variances() for one in objective.channels if isinstance(one, PointChannels)))
        shares = [a / (a + b) for a, b in zip(noise, mismatch)]
    return max(shares)
