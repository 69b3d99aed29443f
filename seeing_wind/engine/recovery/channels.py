"""The two kinds of target as channels, time series that the simulation must follow.

    points in 3D   a few smooth modes of the displacement, so that noise shared by neighbouring points is measured, not assumed;
    tracks in 2D   projection(W x(t)) - p(t), two channels a track, never a lifted point: depth is what one view does not see.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from ..errors import ObjectError, UsageError
from ..records import Attachment, Camera, Particles, PointTargets, TrackTargets
from .basis import spatial_basis

MISMATCH_PIXELS, MISMATCH_PIXELS_TAU = (0.02, 0.33), 24.0
"""What no force should explain, for the solver is not the real body: standard deviation [px] of its white and of its slow part, and the
slow part's correlation time [frames]. It is an error of the whole body's motion (a stretch of a thousandth, a plate that bends too easily),
which more tracks see better but do not average out: its variance per track grows with their number. Chosen between two scenes: a plate
from another solver does best with a third of it, a plate whose layers and stiffness are guessed with three times as much."""
MISMATCH_SPACINGS, MISMATCH_SPACINGS_TAU = (0.001, 0.002), 8.0
"""The same for points in 3D, in particle spacings."""
PLASTIC_FACTOR = 10.0
"""How much more variance the mismatch has when the body flows plastically."""
PINNED_FACTOR = 1000.0
"""The same for points on a held body: a clamp is never exactly where it seems, and moves the whole body like a lever. In pixels, the
mismatch above covers it."""
LATE_OFFSET = 0.5
"""Standard deviation [px] of the attachment of a track that was not there in picture 0."""
MODES = 20
"""Most displacement modes that points in 3D are reduced to."""
HUBER = 2.0
"""Residuals beyond this many standard deviations pull with constant force."""
EDGE_ON = 0.25
"""A track is dropped while the picture of its neighbourhood is squeezed to less than this share of picture 0."""
NEIGHBOURS = 10


def attachment_matrix(attachment: Attachment, particles: int) -> np.ndarray:
    """Dense (K, N) matrix of an attachment."""
    matrix = np.zeros((len(attachment.index), particles))
    np.add.at(matrix, (np.arange(len(matrix))[:, None], attachment.index), attachment.weight)
    return matrix


def _mismatch(frames: int, white: float, slow: float, tau: float, variance_factor: float) -> np.ndarray:
    lag = np.abs(np.subtract.outer(np.arange(frames), np.arange(frames)))
    return variance_factor * (white**2 * np.eye(frames) + slow**2 * np.exp(-lag / tau))


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

    @property
    def count(self) -> int:
        return self.used.shape[1]

    def residual(self, x: np.ndarray, frame: int) -> np.ndarray:
        amplitudes = np.tensordot(x, self.operator[frame], axes=([1], [1]))  # (B, 3, modes)
        difference = amplitudes.transpose(0, 2, 1) - self.observed[frame]
        return difference.reshape(len(x), -1) * self.used[frame]

    def covariance(self, channel: int) -> np.ndarray:
        noise = self.sigma[channel // 3] ** 2
        marginal = np.sqrt(self.inflation[:, channel])
        # Picture 0 is where the body was built from: its noise is in every displacement, hence + 1 1'.
        return (noise * np.eye(len(marginal)) + self.mismatch) * np.outer(marginal, marginal) + noise

    def reweighted(self, residual: np.ndarray) -> PointChannels:
        return self  # smooth modes average outliers away; single wild points belong to whoever made the targets

    def acceleration(self, x: np.ndarray, fps: float) -> float:
        curvature = second_derivative(self.observed.reshape(len(self.used), -1), fps)
        return float(np.sqrt(np.mean(np.sum(curvature**2, axis=1))))

    def speed(self, x: np.ndarray, fps: float) -> float:
        return first_speed(self.observed.reshape(len(self.used), -1, 3), fps)

    def distance(self, x: np.ndarray) -> np.ndarray:
        points = np.einsum("kn,tnc->tkc", self.points, x)
        return np.where(self.targets.visible, np.linalg.norm(points - self.targets.x, axis=-1), np.nan)


@dataclass(frozen=True)
class TrackChannels:
    """Tracks of one camera; channel 2 k + i is image axis i of track k."""

    targets: TrackTargets
    points: np.ndarray
    """(K, N): particles -> points."""
    used: np.ndarray
    variance_factor: float
    """Factor on the mismatch (kappa)."""
    inflation: np.ndarray
    """(T+1, channels) factor >= 1 on the variance."""

    @property
    def count(self) -> int:
        return self.used.shape[1]

    @property
    def camera(self) -> Camera:
        return self.targets.camera

    def residual(self, x: np.ndarray, frame: int) -> np.ndarray:
        points = np.tensordot(x, self.points, axes=([1], [1])).transpose(0, 2, 1)  # (B, K, 3)
        pixels, depth = self.camera.project(points, frame)
        used = self.used[frame].reshape(-1, 2)
        difference = np.where(used, pixels - np.where(used, self.targets.xy[frame], 0.0), 0.0)
        # A point at or behind the camera has no pixel; a large finite miss lets the damped solver step back.
        return np.where((depth > 1e-6)[..., None] | ~used, difference, 1e4).reshape(len(x), -1)

    def covariance(self, channel: int) -> np.ndarray:
        frames, track = len(self.used), channel // 2
        sigma = np.where(self.targets.visible[:, track], self.targets.sigma[:, track], 1.0)
        total = np.diag(sigma**2) + _mismatch(frames, *MISMATCH_PIXELS, MISMATCH_PIXELS_TAU, self.variance_factor)
        marginal = np.sqrt(self.inflation[:, channel])
        late = 0.0 if self.targets.visible[0, track] else LATE_OFFSET**2
        return total * np.outer(marginal, marginal) + late

    def reweighted(self, residual: np.ndarray) -> TrackChannels:
        """The same tracks, those that the raw residual (T+1, channels) [px] shows to spike or drift given more variance (Huber)."""
        white, slow = MISMATCH_PIXELS
        used = self.used.reshape(len(self.used), -1, 2)
        series = np.where(used, residual.reshape(used.shape), np.nan)
        sigma = np.where(self.targets.visible, self.targets.sigma, 1.0)
        # A spike stands out from its own track a few pictures before and after; a lost track from what the mismatch allows.
        spike = np.linalg.norm(series - _running_median(series), axis=-1) / np.sqrt(sigma**2 + self.variance_factor * white**2)
        drift = np.linalg.norm(series, axis=-1) / np.sqrt(sigma**2 + self.variance_factor * (white**2 + slow**2))
        inflation = np.repeat(np.fmax(1.0, np.fmax(spike, drift) / HUBER), 2, axis=1)
        return TrackChannels(self.targets, self.points, self.used, self.variance_factor, inflation)

    def acceleration(self, x: np.ndarray, fps: float) -> float:
        metres = self._across(x)
        curvature = second_derivative(metres.reshape(len(metres), -1), fps).reshape(-1, *metres.shape[1:])
        return float(np.sqrt(np.mean(np.sum(curvature**2, axis=-1))))

    def speed(self, x: np.ndarray, fps: float) -> float:
        return first_speed(self._across(x), fps)

    def _across(self, x: np.ndarray) -> np.ndarray:
        """(T+1, tracks, 2) of the longest tracks, in metres across the view at their first depth; what is hidden is drawn in between."""
        seen = self.targets.visible.all(axis=0)
        if not seen.any():
            seen = self.targets.visible.sum(axis=0) == self.targets.visible.sum(axis=0).max()
        depth = self.camera.project(self.points[seen] @ x, 0)[1]
        metres = self.targets.xy[:, seen] * (depth / self.camera.fx)[:, None]
        frames = np.arange(len(metres))
        for track, visible in enumerate(self.targets.visible[:, seen].T):
            for axis in range(2):
                metres[:, track, axis] = np.interp(frames, frames[visible], metres[visible, track, axis])
        return metres

    def distance(self, x: np.ndarray) -> np.ndarray:
        used = self.used.reshape(len(self.used), -1, 2)[..., 0]
        rows = [self.residual(x[None, t], t)[0].reshape(-1, 2) for t in range(len(x))]
        distance = np.where(used, np.linalg.norm(np.stack(rows), axis=-1), np.nan)
        pixels, _ = self.camera.project(self.points @ x[0], 0)
        at_start = np.linalg.norm(pixels - np.where(self.targets.visible[0][:, None], self.targets.xy[0], np.nan), axis=-1)
        distance[0] = at_start
        return distance


def _running_median(series: np.ndarray) -> np.ndarray:
    """Median over five pictures round each, of series (T+1, ...) with NaN where nothing was seen."""
    padded = np.concatenate([np.full((2, *series.shape[1:]), np.nan), series, np.full((2, *series.shape[1:]), np.nan)])
    windows = np.stack([padded[shift : shift + len(series)] for shift in range(5)])
    seen = np.isfinite(windows).any(axis=0)
    return np.nanmedian(np.where(seen, windows, 0.0), axis=0)


def noise_of(series: np.ndarray) -> float:
    """Standard deviation of the noise in smooth series (frames, ...), from differences of order 3 to 7 in time.

    Each order bounds the noise from above (what is left of the motion adds to it), so the smallest counts. Zero for fewer than eight
    frames: there, motion and noise cannot be told apart.
    """
    if len(series) < 8:
        return 0.0
    orders = range(3, min(7, len(series) - 3) + 1)
    return min(float(np.sqrt(np.mean(np.diff(series, order, axis=0) ** 2) / comb(2 * order, order))) for order in orders)


def second_derivative(series: np.ndarray, fps: float) -> np.ndarray:
    """Accelerations of series (frames, n) from parabolas through windows of seven pictures (or all, if fewer), (windows, n)."""
    if len(series) < 3:
        return np.zeros((1, series.shape[1]))
    width = min(7, len(series))
    time = (np.arange(width) - (width - 1) / 2.0) / fps
    row = 2.0 * np.linalg.pinv(np.stack([np.ones(width), time, time**2], axis=1))[2]
    return np.stack([row @ series[i : i + width] for i in range(len(series) - width + 1)])


def first_speed(series: np.ndarray, fps: float) -> float:
    """Root mean square speed [m/s] at the first picture of series (frames, points, coordinates) [m], by a parabola through six pictures."""
    first = series[: min(6, len(series))]
    flat = first.reshape(len(first), -1)
    slope = np.polyfit(np.arange(len(first)) / fps, flat, min(2, len(first) - 1))[-2]
    return float(np.sqrt(np.mean(np.sum(slope.reshape(first.shape[1:]) ** 2, axis=-1))))


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

    operator, observed = np.zeros((pictures, modes.shape[1], len(particles.x))), np.zeros((pictures, modes.shape[1], 3))
    used = np.zeros((pictures, modes.shape[1]), bool)
    for t, seen in enumerate(targets.visible):
        fitted = min(modes.shape[1], int(seen.sum()))
        if fitted:  # fewer points than modes still tell of the smoothest ones
            inverse = np.linalg.pinv(modes[seen, :fitted], rcond=1e-3)
            operator[t, :fitted] = inverse @ points[seen]
            observed[t, :fitted] = inverse @ targets.x[t, seen]
            used[t, :fitted] = t > 0
    white, slow = (share * particles.spacing for share in MISMATCH_SPACINGS)
    held = bool(particles.pinned.any())
    factor = (PLASTIC_FACTOR if plastic else 1.0) * (PINNED_FACTOR if held else 1.0)
    mismatch = _mismatch(pictures, white, slow, MISMATCH_SPACINGS_TAU, factor)
    if targets.sigma is not None:
        sigma = np.full(modes.shape[1], targets.sigma / np.sqrt(count))
    else:
        whole = np.flatnonzero(used[1:].all(axis=1)) + 1
        sigma = np.array([noise_of(observed[whole, m]) for m in range(modes.shape[1])])
    inflation = np.ones((pictures, 3 * modes.shape[1]))
    return PointChannels(operator, points, observed, targets, np.repeat(used, 3, axis=1), sigma, mismatch, inflation)


def track_channels(particles: Particles, targets: TrackTargets, plastic: bool) -> TrackChannels:
    """Channels of one camera's tracks, points that turned edge-on left out.

    Raises:
        UsageError, ObjectError: as `point_channels`.
    """
    check(targets.xy, targets.visible, 2, targets.attachment, len(particles.x))
    if not (targets.sigma[targets.visible] > 0.0).all():
        raise UsageError("A track has no positive standard deviation.", "Give sigma (T+1,K) in pixels, about 0.2 for a good tracker.")
    visible = targets.visible & ~edge_on(targets.xy, targets.visible)
    used = np.repeat(visible, 2, axis=1)
    used[0] = False
    factor = (PLASTIC_FACTOR if plastic else 1.0) * max(1.0, visible.sum(axis=1).mean())
    return TrackChannels(targets, attachment_matrix(targets.attachment, len(particles.x)), used, factor, np.ones(used.shape))


def check(values: np.ndarray, visible: np.ndarray, width: int, attachment: Attachment, particles: int) -> None:
    """Refuse targets that cannot be right, with the reason."""
    if visible.ndim != 2 or values.shape != (*visible.shape, width) or len(attachment.index) != visible.shape[1]:
        raise UsageError(
            f"Targets {values.shape}, visible {visible.shape} and attachment {attachment.index.shape} do not belong together.",
            f"Expected (T+1,K,{width}), (T+1,K) and (K,J).",
        )
    if len(visible) < 3:
        raise ObjectError(f"{len(visible)} pictures show no acceleration.", "Give a clip of at least three pictures.")
    if not np.isfinite(values[visible]).all():
        raise UsageError("A target that is marked visible is not a number.", "Mark it not visible, or give its position.")
    if attachment.index.min(initial=0) < 0 or attachment.index.max(initial=0) >= particles:
        raise UsageError("A target is attached to a particle that is not there.", "Build the body again.")


def edge_on(xy: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """(T+1, K) bool: the neighbourhood of the track is seen edge-on, its pixels say little and a tracker slips.

    The local affine map from picture 0 to each picture is fitted to the nearest tracks; its smaller singular value tells.
    """
    flagged = np.zeros(visible.shape, bool)
    known = np.flatnonzero(visible[0])
    if len(known) <= NEIGHBOURS:
        return flagged
    start = xy[0, known]
    near = np.argsort(((start[:, None] - start[None]) ** 2).sum(axis=-1), axis=1)[:, : NEIGHBOURS + 1]
    for row, neighbours in enumerate(near):
        group = known[neighbours]
        for t in range(1, len(xy)):
            here = group[visible[t, group]]
            if len(here) < 6:
                continue
            affine = _affine(xy[0, here], xy[t, here])
            flagged[t, known[row]] = np.linalg.svd(affine, compute_uv=False)[1] < EDGE_ON
    return flagged


def _affine(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(2, 2) linear part of the map between points (n, 2), fitted twice: then without the worst third, which may be lost tracks."""
    keep = np.arange(len(before))
    for _ in range(2):
        source, target = before[keep] - before[keep].mean(axis=0), after[keep] - after[keep].mean(axis=0)
        affine = np.linalg.lstsq(source, target, rcond=1e-2)[0]
        miss = np.linalg.norm(before @ affine - after - (before @ affine - after)[keep].mean(axis=0), axis=1)
        keep = np.argsort(miss)[: max(4, 2 * len(before) // 3)]
    return affine
