"""Points in 3D as channels: a few smooth modes of their displacement, so that noise shared by neighbours is measured, not assumed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...errors import UsageError
from ...records import Particles, PointTargets
from ..prior.basis import held_axis, runs_of, spatial_basis, told_apart
from .arc import along_the_curve
from .channels import check, first_speed, noise_of, second_derivative
from .constants import NOISE
from .mismatch import Lengthwise, point_mismatch

WILD_ROUNDS = 8
"""Fits of the smooth motion without what is wild, at most."""


@dataclass(frozen=True)
class Curve:
    """Places along a bent body; see `arc`."""

    operator: np.ndarray
    """(T+1, modes, N, 3): particles -> mode amplitudes."""
    observed: np.ndarray
    """(T+1, modes) [m]."""
    axis: np.ndarray
    """(3,) at rest."""
    lengthwise: Lengthwise


@dataclass(frozen=True)
class PointChannels:
    """Smooth displacement modes of points in 3D; channel 3 m + i is component i of mode m, in `frame`."""

    operator: np.ndarray
    """(T+1, modes, N): particles -> mode amplitudes, least squares over the points seen at that frame."""
    points: np.ndarray
    """(K, N): particles -> points."""
    observed: np.ndarray
    """(T+1, modes, 3) amplitudes of the observed points [m], in the world's axes; where too few were seen, between those of the frames
    before and after."""
    targets: PointTargets
    """What was observed, wild points marked as not visible."""
    wild: np.ndarray
    """(T+1, K) bool, observed but wild."""
    used: np.ndarray
    """(T+1, channels) bool: observed, and frame 0 left out (the simulation starts there)."""
    sigma: np.ndarray
    """(channels,) noise of one amplitude [m]."""
    mismatch: np.ndarray
    """(modes, 3, T+1, T+1) covariance of the solver's mismatch over the frames [m²], components as in `frame`."""
    inflation: np.ndarray
    """(T+1, channels) factor >= 1 on the noise variance."""
    turned: np.ndarray
    """(T+1, 3, 3) how the body has turned since frame 0, as the points show it; in `frame`."""
    frame: np.ndarray
    """(3, 3) axes of the channels in its columns: those in which the points' errors are independent."""
    curve: Curve | None = None
    """Of a body held at one side: component 0 is that along it."""
    mismatch_scale: float = 1.0
    """Factor on the mismatch's standard deviation."""

    @property
    def count(self) -> int:
        """Number of series."""
        return self.used.shape[1]

    def residual(self, x: np.ndarray, frame: int) -> np.ndarray:
        """Particles (B, N, 3) at frame `frame` -> simulated minus observed (B, channels), 0 where not used."""
        amplitudes = np.tensordot(x, self.operator[frame], axes=([1], [1]))  # (B, 3, modes)
        difference = (amplitudes.transpose(0, 2, 1) - self.observed[frame]) @ self.frame
        if self.curve is not None:
            difference[..., 0] = np.tensordot(x, self.curve.operator[frame], axes=([1, 2], [1, 2])) - self.curve.observed[frame]
        return difference.reshape(len(x), -1) * self.used[frame]

    def covariance(self, channel: int) -> np.ndarray:
        """(T+1, T+1) [m²] of a channel's errors over the frames: noise, that of frame 0 included, and the solver's mismatch."""
        mode, component = divmod(channel, 3)
        marginal = np.sqrt(self.inflation[:, channel])
        # Frame 0 is where the body was built from: its noise is in every displacement, turned with the body.
        first = self.turned[:, component] * self.sigma[3 * mode : 3 * mode + 3]
        mismatch = self.mismatch_scale**2 * self.mismatch[mode, component]
        noise = self.sigma[channel] ** 2 * np.eye(len(marginal))
        return (noise + mismatch) * np.outer(marginal, marginal) + first @ first.T

    def variances(self) -> tuple[float, float]:
        """Of one amplitude in one frame [m²]: noise, of the middle mode, and mismatch."""
        mismatch = self.mismatch_scale**2 * np.median(self.mismatch[:, :, 0, 0])
        return float(np.median(self.sigma) ** 2), float(mismatch + np.finfo(float).tiny)

    def mismatched(self, scale: float) -> PointChannels:
        """The same channels with `scale` times the mismatch's standard deviation that they are given at first."""
        return replace(self, mismatch_scale=scale)

    def reweighted(self, residual: np.ndarray) -> PointChannels:
        """The same channels, outliers of `residual` (T+1, channels), NaN in frames that were not solved, given the variance that makes
        them Huber."""
        return self  # wild points were left out at the start; the smooth modes of the others have no outliers

    def acceleration(self, x: np.ndarray, fps: float) -> float:
        """Root mean square acceleration [m/s²] of what was observed, and no less than errors would show of a body that stays still; `x`
        (N, 3) is the rest state."""
        curvature = second_derivative(self.observed.reshape(len(self.used), -1), fps)
        return max(float(np.sqrt(np.mean(np.sum(curvature**2, axis=1)))), self._apparent_acceleration(fps))

    def _apparent_acceleration(self, fps: float) -> float:
        """Root mean square acceleration [m/s²] that errors of this covariance alone would show."""
        rows = second_derivative(np.eye(len(self.used)), fps)
        variance = [np.einsum("wt,tu,wu->w", rows, self.covariance(channel), rows, optimize=True).mean() for channel in range(self.count)]
        return float(np.sqrt(np.sum(variance)))

    def speed(self, x: np.ndarray, fps: float) -> float:
        """Root mean square speed [m/s] of what was observed in the first frames, across the view."""
        return first_speed(self.observed.reshape(len(self.used), -1, 3), fps)

    def distance(self, x: np.ndarray) -> np.ndarray:
        """(T+1, K) distances of the observed points for a trajectory (T+1, N, 3), NaN where not seen."""
        points = np.einsum("kn,tnc->tkc", self.points, x)
        return np.where(self.targets.visible, np.linalg.norm(points - self.targets.x, axis=-1), np.nan)


def point_channels(particles: Particles, targets: PointTargets, plastic: bool) -> PointChannels:
    """Channels of points in 3D.

    Raises:
        UsageError: wrong shapes, or values that are not finite where visible.
        ObjectError: fewer than three frames, or nothing to follow.
    """
    check(targets.x, targets.visible, 3, targets.attachment, len(particles.x))
    frames, count = targets.visible.shape
    points = targets.attachment.matrix(len(particles.x))
    start = points @ particles.x
    spread = np.linalg.norm(start - start.mean(axis=0), axis=1).max() if count > 1 else 0.0
    modes = np.ones((count, 1)) if spread < 0.1 * particles.spacing else spatial_basis(start, np.ones(count), NOISE.point_modes).phi
    modes = modes[:, : max(1, int(targets.visible.sum(axis=1).max()) // 2)]

    astray = wild(targets, start, modes, particles.spacing)
    targets = replace(targets, visible=targets.visible & ~astray)
    weight = _weights(targets, count)
    operator, observed = np.zeros((frames, modes.shape[1], len(particles.x))), np.zeros((frames, modes.shape[1], 3))
    known = np.zeros((frames, modes.shape[1]), bool)
    for t, seen in enumerate(targets.visible):
        # Where half the body is hidden, only its smoothest modes are told apart; the others would take part of their amplitudes.
        even = weight[seen, None] / np.sqrt((weight[seen] ** 2).mean()) if seen.any() else 1.0
        fitted = told_apart(even * modes[seen], NOISE.told)
        if fitted:
            inverse = _inverse(modes[seen, :fitted], weight[seen])
            operator[t, :fitted] = inverse @ points[seen]
            observed[t, :fitted] = inverse @ targets.x[t, seen]
            known[t, :fitted] = True
    observed = _between(observed, known)
    curve = _curve(particles, targets, points, weight, modes.shape[1])
    inverse = _inverse(modes, weight)
    frame, sigma = np.eye(3), np.full(3 * modes.shape[1], (targets.sigma or 0.0) / np.sqrt(count))
    if targets.covariance is not None:
        frame, sigma = _propagate(targets.covariance, inverse)
    elif curve is not None:
        frame = np.linalg.svd(curve.axis[None])[2].T
    moved, turned = (observed - observed[0]) @ frame, frame.T @ rotations(targets.x, targets.visible) @ frame
    if curve is not None:
        moved[..., 0], turned[:, 0] = curve.observed - curve.observed[0], [1.0, 0.0, 0.0]
    whole = moved[1:][_longest_run(known[1:].all(axis=1))]
    if targets.covariance is not None:
        # A covariance of each point alone knows nothing of errors that neighbours share; what is measured does.
        sigma = np.maximum(sigma, [noise_of(series) for series in whole.reshape(len(whole), len(sigma)).T])
    elif targets.sigma is None:
        sigma = np.repeat([noise_of(whole[:, m]) for m in range(modes.shape[1])], 3)
    mismatch = point_mismatch(particles, moved, plastic, None if curve is None else curve.lengthwise)
    inflation = np.ones((frames, 3 * modes.shape[1]))
    used = np.repeat(known & (np.arange(frames) > 0)[:, None], 3, axis=1)
    return PointChannels(operator, points, observed, targets, astray, used, sigma, mismatch, inflation, turned, frame, curve)


def _curve(particles: Particles, targets: PointTargets, points: np.ndarray, weight: np.ndarray, modes: int) -> Curve | None:
    """Along the bent body, in modes of what is free, by the points that are seen in every frame.

    None where these are fewer than half, and of a body that is not held at one side, or whose points have errors with a direction.
    """
    axis = held_axis(particles.x, particles.pinned) if particles.pinned.any() else None
    always = targets.visible.all(axis=0)
    free = (points @ ~particles.pinned)[always] > 0.5
    if axis is None or targets.covariance is not None or 2 * always.sum() < len(always) or free.sum() < modes:
        return None
    rest = points[always][free] @ particles.x
    smooth, count = spatial_basis(rest, np.ones(len(rest)), modes).phi, len(rest)
    inverse, lengthwise = np.zeros((modes, len(free))), np.zeros(modes, bool)
    inverse[: smooth.shape[1], free] = _inverse(smooth, weight[always][free])
    along = spatial_basis(np.outer(rest @ axis, axis), np.ones(count), modes).phi
    across = smooth - along @ (along.T @ smooth) / count
    lengthwise[: smooth.shape[1]] = (across**2).mean(axis=0) < NOISE.lengthwise
    found = along_the_curve(targets.x[:, always], axis, particles.spacing, inverse)
    if found is None:
        return None
    observed = np.einsum("tmkc,tkc->tm", found, targets.x[:, always])
    operator = np.einsum("tmkc,kn->tmnc", found, points[always], optimize=True)
    return Curve(operator, observed, axis, Lengthwise(lengthwise, float(np.ptp(rest @ axis))))


def _between(observed: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Amplitudes (T+1, modes, 3), those that are not known (T+1, modes) put between the nearest that are, in time."""
    filled, time = observed.copy(), np.arange(len(observed))
    for mode in np.flatnonzero(known.any(axis=0) & ~known.all(axis=0)):
        at = np.flatnonzero(known[:, mode])
        filled[:, mode] = np.stack([np.interp(time, at, series) for series in observed[at, mode].T], axis=1)
    return filled


def _longest_run(whole: np.ndarray) -> slice:
    """The most frames (T,) bool in a row: differences in time across a gap would be taken for noise."""
    return slice(*max(runs_of(whole), key=lambda run: run[1] - run[0], default=(0, 0)))


def _weights(targets: PointTargets, count: int) -> np.ndarray:
    """(K,) how much each point counts: less, the larger its errors are said to be.

    Raises:
        UsageError: a sigma or a covariance that is none.
    """
    sigma, covariance = targets.sigma, targets.covariance
    if sigma is not None and (np.ndim(sigma) != 0 or not 0.0 <= sigma < np.inf):
        raise UsageError(f"The noise of the points, sigma, is {sigma}.", "Give one number [m], zero or more, or none: it is measured.")
    if covariance is None:
        return np.ones(count)
    if covariance.shape != (count, 3, 3) or not np.isfinite(covariance).all():
        raise UsageError(f"Covariances {covariance.shape} of {count} points.", f"Give finite ones ({count}, 3, 3) in square metres.")
    slack = 1e-6 * float(np.abs(covariance).max())
    if not np.allclose(covariance, covariance.transpose(0, 2, 1), rtol=0.0, atol=slack) or not (np.linalg.eigvalsh(covariance) > 0.0).all():
        raise UsageError("A point's covariance is not symmetric and positive definite.", "Give every direction some uncertainty.")
    weight = 1.0 / np.sqrt(np.trace(covariance, axis1=1, axis2=2))
    # Of points that hardly count, the least-squares fit would leave modes to chance.
    return np.maximum(weight, NOISE.least_weight * weight.max())


def _inverse(modes: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(M, K): displacements of points -> amplitudes of modes (K, M), least squares with weights (K,)."""
    return np.linalg.pinv(weight[:, None] * modes, rcond=1e-3) * weight


def _propagate(covariance: np.ndarray, inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of amplitudes = inverse (M, K) points, from the points' covariance (K, 3, 3) [m²].

    Returns:
        axes (3, 3), in columns, those of the mean covariance, as of one camera's depth; deviations (3 M,) [m] along them.
    """
    frame = np.linalg.eigh(covariance.mean(axis=0))[1]
    amplitudes = np.einsum("mk,kij->mij", inverse**2, covariance)
    return frame, np.sqrt(np.einsum("ia,mij,ja->ma", frame, amplitudes, frame)).ravel()


def rotations(x: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """(T+1, 3, 3) rotations that bring points x (T+1, K, 3) of frame 0 nearest to each frame (Kabsch 1976), by those seen in both.

    Of fewer than three points, which show no turn, those of the frame before.
    """
    turned = np.tile(np.eye(3), (len(x), 1, 1))
    for t in range(1, len(x)):
        both = visible[0] & visible[t]
        if both.sum() < 3:
            turned[t] = turned[t - 1]
            continue
        before, after = x[0, both] - x[0, both].mean(axis=0), x[t, both] - x[t, both].mean(axis=0)
        left, _, right = np.linalg.svd(after.T @ before)
        turned[t] = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return turned


def wild(targets: PointTargets, start: np.ndarray, modes: np.ndarray, spacing: float) -> np.ndarray:
    """(T+1, K) bool: points that a smooth displacement of the others cannot explain.

    Args:
        start: (K, 3) the points at rest [m].
        modes: (K, M) smooth functions over them.
        spacing: of the particles [m].
    """
    out = np.zeros(targets.visible.shape, bool)
    for t, seen in enumerate(targets.visible):
        if seen.sum() <= 2:
            continue
        smooth, moved = modes[seen, : max(1, int(seen.sum()) // 3)], (targets.x[t] - start)[seen]
        miss = np.linalg.norm(moved - smooth @ _least_absolute(smooth, moved, 1e-3 * spacing), axis=1)
        out[t, seen] = miss > max(NOISE.wild * float(np.median(miss)), NOISE.wild_spacings * spacing)
    return out


def _least_absolute(modes: np.ndarray, values: np.ndarray, smallest: float) -> np.ndarray:
    """Amplitudes (M, 3) that minimise the sum of the distances |values - modes amplitudes|, by reweighted least squares.

    A least-squares fit would be dragged along by the wild points, which then hide in it.
    """
    weight = np.ones((len(values), 1))
    for _ in range(WILD_ROUNDS):
        amplitudes = np.linalg.lstsq(weight * modes, weight * values, rcond=1e-3)[0]
        miss = np.linalg.norm(values - modes @ amplitudes, axis=1)
        weight = 1.0 / np.sqrt(np.maximum(miss, smallest))[:, None]
    return amplitudes
