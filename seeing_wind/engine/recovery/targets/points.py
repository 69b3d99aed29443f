"""Points in 3D as channels: a few smooth modes of their displacement, whose noise, shared by neighbours, can be measured, not assumed."""

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
"""Reweighted fits of the smooth motion, which reduce the influence of wild points."""


@dataclass(frozen=True)
class Curve:
    """Arc lengths along a bent body; see `arc`."""

    operator: np.ndarray
    """(T+1, modes, N, 3) linear map from particles to mode amplitudes."""
    observed: np.ndarray
    """(T+1, modes) observed amplitudes [m]."""
    axis: np.ndarray
    """(3,) axis of the body at rest."""
    lengthwise: Lengthwise


@dataclass(frozen=True)
class PointChannels:
    """Smooth displacement modes of points in 3D; channel 3 m + i is component i of mode m, in `frame`."""

    operator: np.ndarray
    """(T+1, modes, N) linear map from particles to mode amplitudes, by least squares over the points seen in that frame."""
    points: np.ndarray
    """(K, N) matrix from particles to points."""
    observed: np.ndarray
    """(T+1, modes, 3) amplitudes of the observed points [m], in world axes; interpolated in time where too few points were seen."""
    targets: PointTargets
    """The observations, with wild points marked as not visible."""
    wild: np.ndarray
    """(T+1, K) bool: observed, but wild."""
    used: np.ndarray
    """(T+1, channels) bool: observed, and not in frame 0, where the simulation starts."""
    sigma: np.ndarray
    """(channels,) standard deviation of the noise of one amplitude [m]."""
    mismatch: np.ndarray
    """(modes, 3, T+1, T+1) covariance of the solver's mismatch over the frames [m²], with components along `frame`."""
    inflation: np.ndarray
    """(T+1, channels) factor >= 1 on the variance of noise and mismatch."""
    turned: np.ndarray
    """(T+1, 3, 3) rotation of the body since frame 0, as the points show it, in the axes `frame`."""
    frame: np.ndarray
    """(3, 3) axes of the channels, in columns: those along which the points' errors are independent."""
    curve: Curve | None = None
    """For a body held at one side: component 0 is then measured along this curve."""
    mismatch_scale: float = 1.0
    """Factor on the mismatch's standard deviation."""

    @property
    def count(self) -> int:
        """Number of series."""
        return self.used.shape[1]

    def residual(self, x: np.ndarray, frame: int) -> np.ndarray:
        """Simulated minus observed amplitudes (B, channels) for particles (B, N, 3) in frame `frame`; 0 where not used."""
        amplitudes = np.tensordot(x, self.operator[frame], axes=([1], [1]))  # (B, 3, modes)
        difference = (amplitudes.transpose(0, 2, 1) - self.observed[frame]) @ self.frame
        if self.curve is not None:
            difference[..., 0] = np.tensordot(x, self.curve.operator[frame], axes=([1, 2], [1, 2])) - self.curve.observed[frame]
        return difference.reshape(len(x), -1) * self.used[frame]

    def covariance(self, channel: int) -> np.ndarray:
        """Covariance (T+1, T+1) [m²] of a channel's errors over the frames: noise, that of frame 0 included, and the solver's mismatch."""
        mode, component = divmod(channel, 3)
        marginal = np.sqrt(self.inflation[:, channel])
        # The body was built from frame 0, whose noise is therefore in every displacement, turned with the body.
        first = self.turned[:, component] * self.sigma[3 * mode : 3 * mode + 3]
        mismatch = self.mismatch_scale**2 * self.mismatch[mode, component]
        noise = self.sigma[channel] ** 2 * np.eye(len(marginal))
        return (noise + mismatch) * np.outer(marginal, marginal) + first @ first.T

    def variances(self) -> tuple[float, float]:
        """Median variances of one amplitude [m²]: of the noise, and of the mismatch in frame 0."""
        mismatch = self.mismatch_scale**2 * np.median(self.mismatch[:, :, 0, 0])
        return float(np.median(self.sigma) ** 2), float(mismatch + np.finfo(float).tiny)

    def mismatched(self, scale: float) -> PointChannels:
        """The same channels with the standard deviation of the mismatch at `scale` times its initial value."""
        return replace(self, mismatch_scale=scale)

    def reweighted(self, residual: np.ndarray) -> PointChannels:
        """The same channels, with more variance (Huber) for outliers of `residual` (T+1, channels); NaN in frames that were not solved."""
        return self  # wild points were left out at the start; the smooth modes of the others have no outliers

    def acceleration(self, x: np.ndarray, fps: float) -> float:
        """Root mean square observed acceleration [m/s²], at least what the errors alone would show of a body at rest; x: (N, 3) rest
        positions [m]."""
        curvature = second_derivative(self.observed.reshape(len(self.used), -1), fps)
        return max(float(np.sqrt(np.mean(np.sum(curvature**2, axis=1)))), self._apparent_acceleration(fps))

    def _apparent_acceleration(self, fps: float) -> float:
        """Root mean square acceleration [m/s²] that the errors alone would show."""
        rows = second_derivative(np.eye(len(self.used)), fps)
        variance = [np.einsum("wt,tu,wu->w", rows, self.covariance(channel), rows, optimize=True).mean() for channel in range(self.count)]
        return float(np.sqrt(np.sum(variance)))

    def speed(self, x: np.ndarray, fps: float) -> float:
        """Root mean square observed speed [m/s] at the first frame."""
        return first_speed(self.observed.reshape(len(self.used), -1, 3), fps)

    def distance(self, x: np.ndarray) -> np.ndarray:
        """Distances (T+1, K) [m] between simulated and observed points for a trajectory (T+1, N, 3); NaN where not seen."""
        points = np.einsum("kn,tnc->tkc", self.points, x)
        return np.where(self.targets.visible, np.linalg.norm(points - self.targets.x, axis=-1), np.nan)


def point_channels(particles: Particles, targets: PointTargets, plastic: bool) -> PointChannels:
    """Channels of points in 3D.

    Args:
        plastic: whether the body flows.

    Raises:
        UsageError: for wrong shapes, or values that are not finite where visible.
        ObjectError: for fewer than three frames in which something is visible.
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
        # If half the body is hidden, only its smoothest modes can be told apart; others would take over part of their amplitudes.
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
        # Covariances of single points do not contain errors that neighbours share; the measured noise does.
        sigma = np.maximum(sigma, [noise_of(series) for series in whole.reshape(len(whole), len(sigma)).T])
    elif targets.sigma is None:
        sigma = np.repeat([noise_of(whole[:, m]) for m in range(modes.shape[1])], 3)
    mismatch = point_mismatch(particles, moved, plastic, None if curve is None else curve.lengthwise)
    inflation = np.ones((frames, 3 * modes.shape[1]))
    used = np.repeat(known & (np.arange(frames) > 0)[:, None], 3, axis=1)
    return PointChannels(operator, points, observed, targets, astray, used, sigma, mismatch, inflation, turned, frame, curve)


def _curve(particles: Particles, targets: PointTargets, points: np.ndarray, weight: np.ndarray, modes: int) -> Curve | None:
    """Arc lengths along the bent body, in modes of its free part, from the points that are seen in every frame.

    None if these are fewer than half of the points, if the body is not held at one side, or if the points' errors depend on direction.
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
    """Amplitudes (T+1, modes, 3), interpolated in time where they are not `known` (T+1, modes)."""
    filled, time = observed.copy(), np.arange(len(observed))
    for mode in np.flatnonzero(known.any(axis=0) & ~known.all(axis=0)):
        at = np.flatnonzero(known[:, mode])
        filled[:, mode] = np.stack([np.interp(time, at, series) for series in observed[at, mode].T], axis=1)
    return filled


def _longest_run(whole: np.ndarray) -> slice:
    """The longest run of True in frames (T,) bool: differences in time across a gap would be taken for noise."""
    return slice(*max(runs_of(whole), key=lambda run: run[1] - run[0], default=(0, 0)))


def _weights(targets: PointTargets, count: int) -> np.ndarray:
    """(K,) weights of the points, smaller for points with larger stated errors.

    Raises:
        UsageError: for an invalid sigma or covariance.
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
    # If some points hardly counted, the least-squares fit would leave modes undetermined.
    return np.maximum(weight, NOISE.least_weight * weight.max())


def _inverse(modes: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Matrix (M, K) from displacements of points to amplitudes of the modes (K, M), by least squares with weights (K,)."""
    return np.linalg.pinv(weight[:, None] * modes, rcond=1e-3) * weight


def _propagate(covariance: np.ndarray, inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the amplitudes, `inverse` (M, K) times points, from the points' covariance (K, 3, 3) [m²].

    Returns:
        The principal axes (3, 3) of the mean covariance, in columns (one may be a camera's view), and the deviations (3 M,) [m] along them.
    """
    frame = np.linalg.eigh(covariance.mean(axis=0))[1]
    amplitudes = np.einsum("mk,kij->mij", inverse**2, covariance)
    return frame, np.sqrt(np.einsum("ia,mij,ja->ma", frame, amplitudes, frame)).ravel()


def rotations(x: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """(T+1, 3, 3) rotations that bring frame 0 of points x (T+1, K, 3) nearest to each frame (Kabsch 1976), from the points seen in both.

    Fewer than three points show no rotation; that of the frame before is then kept.
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
    """(T+1, K) bool: points whose displacement is not explained by a smooth displacement of the others.

    Args:
        start: (K, 3) the points at rest [m].
        modes: (K, M) smooth functions over them.
        spacing: spacing of the particles [m].
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

    Wild points would pull a least-squares fit towards themselves and so escape notice.
    """
    weight = np.ones((len(values), 1))
    for _ in range(WILD_ROUNDS):
        amplitudes = np.linalg.lstsq(weight * modes, weight * values, rcond=1e-3)[0]
        miss = np.linalg.norm(values - modes @ amplitudes, axis=1)
        weight = 1.0 / np.sqrt(np.maximum(miss, smallest))[:, None]
    return amplitudes
