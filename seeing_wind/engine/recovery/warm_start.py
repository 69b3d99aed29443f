"""A first guess that tracks the body: receding-horizon control.

From the simulated state, a window of a few frames is simulated with a field that is affine over the body and constant over the window;
one or two damped Gauss-Newton steps fit it, the body is moved on by one frame, and the window follows. The simulation never strays far
from what was seen, which a solve over the whole clip from a mean acceleration does as soon as the body turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .basis import SpatialBasis
from .forward import Forward
from .objective import Objective

WINDOW = 3
"""Frames looked ahead."""
FIRST_WINDOW = 6
"""Frames of the first window, which finds the initial velocity too."""
STEPS = 2
FIRST_STEPS = 5
JUMP = 0.5
"""Standard deviation of the change of the field from frame to frame, relative to its expected size."""
DAMPING = (0.0, 1.0, 10.0, 100.0)


@dataclass(frozen=True)
class WarmStart:
    """What the receding horizon found."""

    coefficients: np.ndarray
    """(T, modes, 3) accelerations per frame [m/s²]."""
    velocity: np.ndarray
    """(V,) initial velocities [m/s]."""
    x: np.ndarray
    """(T+1, N, 3) where it took the body [m]."""


def warm_start(forward: Forward, objective: Objective, size: float, speed: np.ndarray) -> WarmStart:
    """Track the targets from picture 0 to the last.

    Args:
        forward: simulations with the few modes of the start.
        objective: what to follow.
        size: expected root mean square of the field [m/s²].
        speed: (V,) standard deviations of the initial velocities [m/s].
    """
    frames, basis = objective.frames, forward.basis
    deviation = _deviations(basis, size)
    found, positions = [], [forward.x]
    coefficients = np.zeros((basis.phi.shape[1], 3))

    window = min(FIRST_WINDOW, frames)
    unknown = np.zeros(coefficients.size + len(speed))
    spread = np.concatenate([deviation.ravel(), speed])
    unknown = _fit(forward, objective, None, 0, window, unknown, np.zeros_like(unknown), spread, FIRST_STEPS)
    coefficients, velocity = unknown[: coefficients.size].reshape(-1, 3), unknown[coefficients.size :]

    state = forward.start(velocity)
    for t in range(frames):
        forward.progress.update(0.05 + 0.15 * t / frames, f"Following the object, frame {t + 1} of {frames}")
        window = min(WINDOW, frames - t)
        fitted = _fit(forward, objective, state, t, window, coefficients.ravel(), coefficients.ravel(), JUMP * deviation.ravel(), STEPS)
        coefficients = fitted.reshape(-1, 3)
        state = forward.advance(state, coefficients, t)
        found.append(coefficients)
        positions.append(state.x)
    return WarmStart(np.stack(found), velocity, np.stack(positions))


def _deviations(basis: SpatialBasis, size: float) -> np.ndarray:
    """(modes, 3) prior standard deviations [m/s²]."""
    return np.repeat(size * basis.size[:, None], 3, axis=1)


def _fit(forward, objective, state, frame, window, unknown, mean, spread, steps):  # type: ignore[no-untyped-def]
    """Damped Gauss-Newton over pictures frame + 1 ... frame + window; the unknowns beyond the coefficients are initial velocities."""
    for _ in range(steps):
        offset = 1e-3 * spread
        trials = np.concatenate([unknown[None], unknown + np.diag(offset)])
        raw = objective.residual(forward.window(state, trials, window)[:, 1:], frame + 1)
        white = _whiten(objective, raw, frame + 1)
        jacobian = (white[1:] - white[0]) / offset[:, None]
        precision = np.diag(1.0 / spread**2)
        gradient = jacobian @ white[0] + precision @ (unknown - mean)
        steps_tried = np.stack([np.linalg.solve(jacobian @ jacobian.T + (1 + damp) * precision, gradient) for damp in DAMPING])
        candidates = unknown - steps_tried
        missed = _whiten(objective, objective.residual(forward.window(state, candidates, window)[:, 1:], frame + 1), frame + 1)
        costs = (missed**2).sum(axis=1) + (((candidates - mean) / spread) ** 2).sum(axis=1)
        before = (white[0] ** 2).sum() + (((unknown - mean) / spread) ** 2).sum()
        best = int(np.nanargmin(costs))
        if not costs[best] < before:
            break
        unknown = candidates[best]
        if before - costs[best] < 0.01 * before:
            break
    return unknown


def _whiten(objective: Objective, raw: np.ndarray, first: int) -> np.ndarray:
    """Residuals over the marginal deviation of each channel and picture: within a few frames the slow mismatch is a plain offset."""
    scaled = raw / objective.deviation[first : first + raw.shape[1]]
    return np.where(objective.used[first : first + raw.shape[1]], scaled, 0.0).reshape(len(raw), -1)
