"""A first guess that tracks the body: receding-horizon control.

From the current simulated state, the few frames of the look-ahead are simulated under a field that is affine over the body and constant in
time. A damped Gauss-Newton step fits this field to the targets, the body is advanced, and the look-ahead begins again from there. The
simulation never strays far from the targets, whereas a solve over the whole clip from a mean acceleration does as soon as the body turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ...errors import SimulationError
from ...mpm.state import State, Trajectory
from ..prior.constants import PRIOR
from ..prior.stretch import stretch_rows, stretch_weights
from ..targets.objective import Objective
from .constants import PACE
from .forward import Forward

BROKEN = 1e6
"""Residual that stands for a simulation that broke down [m or px]."""
DAMPING = ((0.0, 1.0), (10.0, 100.0))
"""Candidates of the damping, tried a pair at a time until one lowers the cost: two cores simulate a pair in the time of one."""


@dataclass(frozen=True)
class WarmStart:
    """The result of the receding horizon in one part of the clip."""

    coefficients: np.ndarray
    """(frames, modes, 3) coefficients of the acceleration in each interval [m/s²]."""
    velocity: np.ndarray
    """(V,) initial velocities [m/s]; empty if the body's state at the beginning was given."""
    path: Trajectory
    """The simulated motion from the part's first frame on."""


def warm_start(
    forward: Forward,
    objective: Objective,
    size: np.ndarray,
    speed: np.ndarray,
    state: State | None,
    begin: int,
    end: int,
    last: np.ndarray | None,
) -> WarmStart:
    """Track the targets through the intervals begin ... end - 1.

    Args:
        forward: forward model with the few modes of the first guess.
        size: (3,) expected root mean square of each component of the field [m/s²].
        speed: (V,) prior standard deviations of the initial velocities [m/s].
        state: the body at frame `begin`; None to start from the rest shape in frame 0 and find the initial velocities too.
        last: (modes, 3) coefficients shortly before `begin` [m/s²], if they are known.

    Raises:
        SimulationError: when the body breaks down.
    """
    deviation = np.outer(forward.basis.size, size)
    count, velocity = deviation.size, np.zeros(0)
    coefficients = np.zeros(count)
    if state is None:
        spread = np.concatenate([deviation.ravel(), speed])
        ahead = min(PACE.first_horizon, objective.frames)
        unknown = _fit(forward, objective, None, 0, ahead, np.zeros(len(spread)), spread, PACE.first_horizon_steps)
        coefficients, velocity = unknown[:count], unknown[count:]
        state = forward.start(velocity)
    elif last is not None:
        coefficients = last.ravel()
    else:  # nothing is known of the field yet: let the first look-ahead find it
        ahead = min(PACE.horizon, objective.frames - begin)
        coefficients = _fit(forward, objective, state, begin, ahead, coefficients, deviation.ravel(), PACE.first_horizon_steps)

    found, states = [], [state]
    for t in range(begin, end):
        if (t - begin) % PACE.hop == 0:
            ahead = min(PACE.horizon, objective.frames - t)
            coefficients = _fit(forward, objective, state, t, ahead, coefficients, PRIOR.jump * deviation.ravel(), PACE.horizon_steps)
        state = forward.advance(state, coefficients.reshape(-1, 3), t)
        found.append(coefficients.reshape(-1, 3))
        states.append(state)
    return WarmStart(np.stack(found), velocity, Trajectory.of(states))


def _fit(
    forward: Forward, objective: Objective, state: State | None, frame: int, ahead: int, mean: np.ndarray, spread: np.ndarray, steps: int
) -> np.ndarray:
    """The unknowns (n,) fitted by damped Gauss-Newton to the targets in frames frame + 1 ... frame + ahead, starting from the prior's mean.

    The unknowns are the coefficients (3 modes), followed by the initial velocities if `state` is None. mean, spread: (n,) of the prior.
    """
    work = partial(_fitted, forward, objective, state, frame, ahead, mean, spread, steps)
    return forward.journal.array("fit", work, frame, mean, spread)


def _fitted(
    forward: Forward, objective: Objective, state: State | None, frame: int, ahead: int, mean: np.ndarray, spread: np.ndarray, steps: int
) -> np.ndarray:
    unknown, offset, precision = mean, 1e-3 * spread, np.diag(1.0 / spread**2) + _strain_precision(forward, state, spread)
    unexplained: float | None = None
    for _ in range(steps):
        unknown, x, changed = bearable(forward, state, unknown, offset, frame, ahead)
        white = _whiten(objective, np.concatenate([x[None], changed]), frame)
        if unexplained is None:  # were the data exact, what a constant force cannot explain would be made up for by squeezing the body
            unexplained = max(1.0, PACE.horizon_unexplained * float(np.sqrt((white[0] ** 2).mean())))
        white /= unexplained
        before = float((white[0] ** 2).sum() + _prior_cost(unknown - mean, precision))
        jacobian = (white[1:] - white[0]) / offset[:, None]
        gradient = jacobian @ white[0] + precision @ (unknown - mean)
        normal = jacobian @ jacobian.T
        for damping in DAMPING:
            candidates = unknown - np.stack([np.linalg.solve(normal + (1.0 + damp) * precision, gradient) for damp in damping])
            missed = _whiten(objective, forward.look_ahead(state, candidates, frame, ahead), frame) / unexplained
            costs = (missed**2).sum(axis=1) + _prior_cost(candidates - mean, precision)
            best = int(np.argmin(costs))
            if costs[best] < before:
                break
        if not costs[best] < before:
            break
        unknown = candidates[best]
        if before - costs[best] < 0.01 * before:
            break
    return unknown


def bearable(
    forward: Forward, state: State | None, unknown: np.ndarray, offset: np.ndarray, frame: int, ahead: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`unknown` (n,) scaled by the first of `horizon_shares` under which the body holds, and `Forward.look_ahead_changes` there.

    A force under which a soft body has held so far may tear it if it goes on for a whole look-ahead.

    Raises:
        SimulationError: when the body breaks down under each of them.
    """
    for share in PACE.horizon_shares:
        try:
            return share * unknown, *forward.look_ahead_changes(state, share * unknown, offset, frame, ahead)
        except SimulationError:
            if share == PACE.horizon_shares[-1] or not unknown.any():
                raise
    raise AssertionError


def _whiten(objective: Objective, x: np.ndarray, frame: int) -> np.ndarray:
    """Residuals (B, m) of trajectories (B, S, N, 3) that begin at `frame`, in the frames after it, each divided by its standard deviation.

    Correlations are left out: within a few frames the slow part of the mismatch is merely an offset. If a simulation broke down, all of its
    residuals are `BROKEN`.
    """
    rows = slice(frame + 1, frame + x.shape[1])
    broken = ~np.isfinite(x).all(axis=(1, 2, 3))
    raw = objective.residual(np.where(broken[:, None, None, None], 0.0, x)[:, 1:], frame + 1)
    raw[broken] = BROKEN
    return np.where(objective.used[rows], raw / objective.deviation[rows], 0.0).reshape(len(x), -1)


def _prior_cost(offset: np.ndarray, precision: np.ndarray) -> np.ndarray:
    return np.einsum("...i,ij,...j->...", offset, precision, offset)


def _strain_precision(forward: Forward, state: State | None, spread: np.ndarray) -> np.ndarray:
    """Precision (n, n) that limits the stretching part of the force to the share `PRIOR.strain` of what `spread` (n,) implies.

    It takes account of how the body has turned. A few frames show how a body turns, but hardly how it is stretched: within the noise, any
    stretch would do.
    """
    basis, count = forward.basis, 3 * forward.basis.phi.shape[1]
    F = np.broadcast_to(np.eye(3), (*forward.x.shape, 3)) if state is None else state.F
    rows = stretch_rows(basis, forward.x, np.stack([F, F]), np.zeros(1))[0].reshape(-1, count)
    implied = ((rows * spread[:count]) ** 2).sum(axis=1)
    weight = stretch_weights(implied, PRIOR.strain)
    full = np.zeros((len(spread), len(spread)))
    full[:count, :count] = rows.T @ (weight[:, None] * rows)
    return full
