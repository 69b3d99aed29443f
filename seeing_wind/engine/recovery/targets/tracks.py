"""Tracks of one camera as channels: projection(W x(t)) - p(t). Points are never lifted, as a single view does not show depth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...errors import UsageError
from ...records import Camera, Particles, TrackTargets
from .channels import check, first_speed, second_derivative
from .constants import NOISE
from .mismatch import mismatch_covariance


@dataclass(frozen=True)
class TrackChannels:
    """Tracks of one camera, with the same interface as `PointChannels`; channel 2 k + i is image axis i of track k."""

    targets: TrackTargets
    points: np.ndarray
    """(K, N) matrix from particles to points."""
    used: np.ndarray
    """(T+1, channels) bool: visible, not edge-on, and not in frame 0, where the simulation starts."""
    variance_factor: float
    """Factor on the mismatch's variance (kappa)."""
    inflation: np.ndarray
    """(T+1, channels) factor >= 1 on the variance."""
    mismatch_scale: float = 1.0
    """Factor on the mismatch's standard deviation."""
    mismatch: tuple[float, float] = (NOISE.track_white, NOISE.track_slow)
    """Standard deviations of the white and the slow part of the mismatch [px]."""
    wild: np.ndarray | None = None
    """(T+1,) bool: frames at the clip's ends that count little, as all their tracks leave the motion of the other frames; None before the
    first solve."""

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
        """Covariance (T+1, T+1) [px²] of a channel's errors over the frames: noise, the solver's mismatch, a late track's attachment."""
        frames, track = len(self.used), channel // 2
        sigma = np.where(self.targets.visible[:, track], self.targets.sigma[:, track], 1.0)
        total = np.diag(sigma**2) + mismatch_covariance(
            frames, *self.mismatch, NOISE.track_slow_time, self.variance_factor * self.mismatch_scale**2, from_rest=True
        )
        marginal = np.sqrt(self.inflation[:, channel])
        offset = NOISE.late_offset if self.targets.offset is None else self.targets.offset[track]
        late = 0.0 if self.targets.visible[0, track] else offset**2
        return total * np.outer(marginal, marginal) + late

    def reweighted(self, residual: np.ndarray) -> TrackChannels:
        """The same tracks, with more variance (Huber) for those that spike or drift in the raw residual (T+1, channels) [px]."""
        white, slow = self.mismatch
        used = self.used.reshape(len(self.used), -1, 2)
        series = np.where(used, residual.reshape(used.shape), np.nan)
        sigma = np.where(self.targets.visible, self.targets.sigma, 1.0)
        # A spike stands out from its own track in the frames around it; a lost track exceeds what the mismatch allows.
        spike = np.linalg.norm(series - _running_median(series), axis=-1) / np.sqrt(sigma**2 + self.variance_factor * white**2)
        drift = np.linalg.norm(series, axis=-1) / np.sqrt(sigma**2 + self.variance_factor * (white**2 + slow**2))
        inflation = np.repeat(np.fmax(1.0, np.fmax(spike, drift) / NOISE.huber), 2, axis=1)
        ends = self._ends(np.linalg.norm(series, axis=-1) / np.sqrt(sigma**2 + self.variance_factor * white**2))
        return replace(self, inflation=np.fmax(inflation, ends[:, None]), wild=ends > 1.0)

    def _ends(self, miss: np.ndarray) -> np.ndarray:
        """(T+1,) factor on the variance of each frame, given the misses of its tracks (T+1, K) [deviations]; NaN for no residual."""
        factor, looked = np.ones(len(miss)), np.flatnonzero(np.isfinite(miss).any(axis=1))
        if len(looked) < NOISE.end_fewest:
            return factor
        off = np.nanmedian(miss[looked], axis=1)
        usual = max(float(np.median(off)), NOISE.end_usual)
        shown = np.flatnonzero(self.used.any(axis=1))
        for order, last in ((slice(None), shown[0]), (slice(None, None, -1), shown[-1])):
            frames, end = looked[order], off[order][: int(NOISE.end_part * len(off))]
            run = end[: np.argmin(np.append(end > NOISE.end_odd * usual, False))]
            if frames[0] == last and run.max(initial=0.0) > max(NOISE.end_wild * usual, NOISE.end_least):
                # The errors of the tracks are common to all, so their number does not reduce them.
                factor[frames[: len(run)]] = self.variance_factor * (run.max() / usual) ** 2
        return factor

    def mismatched(self, scale: float) -> TrackChannels:
        return replace(self, mismatch_scale=scale)

    def acceleration(self, x: np.ndarray, fps: float) -> float:
        metres = self._across(x)
        curvature = second_derivative(metres.reshape(len(metres), -1), fps).reshape(-1, *metres.shape[1:])
        return float(np.sqrt(np.mean(np.sum(curvature**2, axis=-1))))

    def speed(self, x: np.ndarray, fps: float) -> float:
        return first_speed(self._across(x), fps)

    def _across(self, x: np.ndarray) -> np.ndarray:
        """(T+1, tracks, 2) positions of the longest tracks across the view, at their first depth [m]; interpolated where hidden."""
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
    """Median over five frames round each, of series (T+1, ...) with NaN where nothing was seen."""
    padded = np.concatenate([np.full((2, *series.shape[1:]), np.nan), series, np.full((2, *series.shape[1:]), np.nan)])
    shifted = np.stack([padded[shift : shift + len(series)] for shift in range(5)])
    seen = np.isfinite(shifted).any(axis=0)
    return np.nanmedian(np.where(seen, shifted, 0.0), axis=0)


def track_channels(particles: Particles, targets: TrackTargets, plastic: bool) -> TrackChannels:
    """Channels of one camera's tracks, without tracks where the surface is seen edge-on.

    Raises:
        UsageError, ObjectError: as in `point_channels`.
    """
    check(targets.xy, targets.visible, 2, targets.attachment, len(particles.x))
    if targets.sigma.shape != targets.visible.shape or not np.isfinite(targets.sigma[targets.visible]).all():
        raise UsageError("The tracks' sigma is not a finite number of pixels for every track and frame.", "Give (T+1, K).")
    if not (targets.sigma[targets.visible] > 0.0).all():
        raise UsageError("A track has no positive standard deviation.", "Give sigma (T+1,K) in pixels, about 0.2 for a good tracker.")
    visible = targets.visible & ~edge_on(targets.xy, targets.visible)
    used = np.repeat(visible, 2, axis=1)
    used[0] = False
    points, factor = targets.attachment.matrix(len(particles.x)), max(1.0, float(visible.sum(axis=1).mean()))
    mismatch = (NOISE.flowing_white, NOISE.flowing_slow) if plastic else (NOISE.track_white, NOISE.track_slow)
    return TrackChannels(targets, points, used, factor, np.ones(used.shape), mismatch=mismatch)


def edge_on(xy: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """(T+1, K) bool: whether the neighbourhood of a track is seen edge-on; its pixels then show little, and a tracker slips.

    The criterion is the smaller singular value of the local affine map from frame 0 to each frame, fitted to the nearest tracks.
    """
    flagged = np.zeros(visible.shape, bool)
    known = np.flatnonzero(visible[0])
    if len(known) <= NOISE.neighbours:
        return flagged
    start = xy[0, known]
    near = np.argsort(((start[:, None] - start[None]) ** 2).sum(axis=-1), axis=1)[:, : NOISE.neighbours + 1]
    for t in range(1, len(xy)):
        seen = visible[t, known[near]]
        rows = np.flatnonzero(seen.sum(axis=1) >= 6)
        group = known[near[rows]]
        slopes = _affine(xy[0, group], xy[t, group], seen[rows])
        flagged[t, known[rows]] = np.linalg.svd(slopes, compute_uv=False)[:, 1] < NOISE.edge_on
    return flagged


def _affine(before: np.ndarray, after: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(R, 2, 2) linear parts of the affine maps between groups of points (R, n, 2), fitted to the points `seen` (R, n) bool.

    Each map is fitted twice, the second time without the worst third of its group, which may be lost tracks.
    """
    before, after, keep = np.where(seen[..., None], before, 0.0), np.where(seen[..., None], after, 0.0), seen
    most = np.maximum(4, 2 * seen.sum(axis=1) // 3)[:, None]
    for _ in range(2):
        weight = keep[..., None]
        source, target = (weight * (points - _mean(points, weight)) for points in (before, after))
        affine = np.linalg.pinv(source, rcond=1e-2) @ target
        off = before @ affine - after
        miss = np.where(seen, np.linalg.norm(off - _mean(off, weight), axis=2), np.inf)
        keep = np.argsort(np.argsort(miss, axis=1), axis=1) < most
    return affine


def _mean(points: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Means (R, 1, 2) of points (R, n, 2) with weights (R, n, 1)."""
    return (weight * points).sum(axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True)
