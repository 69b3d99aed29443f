"""Points in 3D as channels: a few smooth modes of their displacement, so that noise shared by neighbours is measured, not assumed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..records import Particles, PointTargets
from .basis import spatial_basis
from .channels import PLASTIC_FACTOR, attachment_matrix, check, first_speed, mismatch_covariance, noise_of, second_derivative

MISMATCH_SPACINGS, MISMATCH_SPACINGS_TAU = (0.001, 0.002), 8.0
"""The same for points in 3D, in particle spacings."""
PINNED_FACTOR = 20.0
"""How much more variance the mismatch has on a held body, whose clamp moves all of it like a lever. The clamp's depth, the stiffness and
how it is spread over the section are unknowns (`stiffness`); this is for what they leave. In pixels, the mismatch of tracks covers it."""
MODES = 20
"""Most displacement modes that points in 3D are reduced to."""
WILD, WILD_SPACINGS, WILD_ROUNDS = 8.0, 0.2, 8
"""A point in 3D is wild when it misses the smooth motion of the others by more than so many medians and so many particle spacings."""


@dataclass(frozen=True)
class PointChannels:
    """Smooth displacement modes of points in 3D; channel 3 m + i is component i of mode m."""

    operator: np.ndarray
    """(T+1, modes, N): particles -> mode amplitudes, least squares over the points seen at that picture."""
    points: np.ndarray
    """(K, N): particles -> points."""
    observed: np.ndarray
    """(T+1, modes, 3) amplitudes of the observed points [m]."""
    targets: PointTargets
    used: np.ndarray
    sigma: np.ndarray
    """(modes,) noise of one amplitude [m]."""
    mismatch: np.ndarray
    """(T+1, T+1) covariance shared by all channels."""
    inflation: np.ndarray
    """(T+1, channels) factor >= 1 on the noise variance."""
    turned: np.ndarray
    """(T+1, 3, 3) how the body has turned since picture 0, as the points show it."""
    mismatch_scale: float = 1.0
    """Factor on the mismatch's standard deviation."""

    @property
    def count(self) -> int:
        return self.used.shape[1]

    def residual(self, x: np.ndarray, frame: int) -> np.ndarray:
        amplitudes = np.tensordot(x, self.operator[frame], axes=([1], [1]))  # (B, 3, modes)
        difference = amplitudes.transpose(0, 2, 1) - self.observed[frame]
        return difference.reshape(len(x), -1) * self.used[frame]

    def covariance(self, channel: int) -> np.ndarray:
        """(T+1, T+1) [m²] of a channel's errors over the pictures: noise, that of picture 0 included, and the solver's mismatch."""
        noise = self.sigma[channel // 3] ** 2
        marginal = np.sqrt(self.inflation[:, channel])
        # Picture 0 is where the body was built from: its noise is in every displacement, turned with the body.
        first = self.turned[:, channel % 3]
        mismatch = self.mismatch_scale**2 * self.mismatch
        return (noise * np.eye(len(marginal)) + mismatch) * np.outer(marginal, marginal) + noise * (first @ first.T)

    def variances(self) -> tuple[float, float]:
        """Of one amplitude in one picture [m²]: noise, of the middle mode, and mismatch."""
        return float(np.median(self.sigma) ** 2), float(self.mismatch_scale**2 * self.mismatch[0, 0] + np.finfo(float).tiny)

    def mismatched(self, scale: float) -> PointChannels:
        return replace(self, mismatch_scale=scale)

    def reweighted(self, residual: np.ndarray) -> PointChannels:
        return self  # wild points were left out at the start; the smooth modes of the others have no outliers

    def acceleration(self, x: np.ndarray, fps: float) -> float:
        curvature = second_derivative(self.observed.reshape(len(self.used), -1), fps)
        return float(np.sqrt(np.mean(np.sum(curvature**2, axis=1))))

    def speed(self, x: np.ndarray, fps: float) -> float:
        return first_speed(self.observed.reshape(len(self.used), -1, 3), fps)

    def distance(self, x: np.ndarray) -> np.ndarray:
        points = np.einsum("kn,tnc->tkc", self.points, x)
        return np.where(self.targets.visible, np.linalg.norm(points - self.targets.x, axis=-1), np.nan)


def point_channels(particles: Particles, targets: PointTargets, plastic: bool) -> PointChannels:
    """Channels of points in 3D.

    Raises:
        UsageError: wrong shapes, or values that are not finite where visible.
        ObjectError: fewer than three pictures, or nothing to follow.
    """
    check(targets.x, targets.visible, 3, targets.attachment, len(particles.x))
    pictures, count = targets.visible.shape
    points = attachment_matrix(targets.attachment, len(particles.x))
    start = points @ particles.x
    spread = np.linalg.norm(start - start.mean(axis=0), axis=1).max() if count > 1 else 0.0
    modes = np.ones((count, 1)) if spread < 0.1 * particles.spacing else spatial_basis(start, np.ones(count), MODES).phi
    modes = modes[:, : max(1, int(targets.visible.sum(axis=1).max()) // 2)]

    visible = targets.visible & ~wild(targets, start, modes, particles.spacing)
    operator, observed = np.zeros((pictures, modes.shape[1], len(particles.x))), np.zeros((pictures, modes.shape[1], 3))
    used = np.zeros((pictures, modes.shape[1]), bool)
    for t, seen in enumerate(visible):
        fitted = min(modes.shape[1], int(seen.sum()))
        if fitted:  # fewer points than modes still tell of the smoothest ones
            inverse = np.linalg.pinv(modes[seen, :fitted], rcond=1e-3)
            operator[t, :fitted] = inverse @ points[seen]
            observed[t, :fitted] = inverse @ targets.x[t, seen]
            used[t, :fitted] = t > 0
    white, slow = (share * particles.spacing for share in MISMATCH_SPACINGS)
    held = bool(particles.pinned.any())
    factor = (PLASTIC_FACTOR if plastic else 1.0) * (PINNED_FACTOR if held else 1.0)
    mismatch = mismatch_covariance(pictures, white, slow, MISMATCH_SPACINGS_TAU, factor)
    if targets.sigma is not None:
        sigma = np.full(modes.shape[1], targets.sigma / np.sqrt(count))
    else:
        whole = np.flatnonzero(used[1:].all(axis=1)) + 1
        sigma = np.array([noise_of(observed[whole, m]) for m in range(modes.shape[1])])
    inflation = np.ones((pictures, 3 * modes.shape[1]))
    turned = rotations(targets.x, visible)
    return PointChannels(operator, points, observed, targets, np.repeat(used, 3, axis=1), sigma, mismatch, inflation, turned)


def rotations(x: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """(T+1, 3, 3) rotations that bring points x (T+1, K, 3) of picture 0 nearest to each picture (Kabsch 1976), by those seen in both.

    Of fewer than three points, which show no turn, those of the picture before.
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
        targets: what was observed.
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
        out[t, seen] = miss > max(WILD * float(np.median(miss)), WILD_SPACINGS * spacing)
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
