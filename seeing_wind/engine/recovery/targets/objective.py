"""Residuals of a simulation, whitened to unit variance (paper, section 3.4: sparse tracking objective).

The observations come as *channels*, time series that the simulation must follow (`channels`). The residuals of a channel are correlated in
time (the simulator's own error drifts, and the rest state is as noisy as any frame), so each channel is whitened with the Cholesky factor
of its covariance over the frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np

from .constants import NOISE
from .points import PointChannels
from .tracks import TrackChannels

Channels = PointChannels | TrackChannels
"""One source of residuals: several time series over T + 1 frames."""


class Objective:
    """All channels together, over all frames or a part of them."""

    def __init__(self, channels: Sequence[Channels], first: int = 0, last: int | None = None) -> None:
        """`first` and `last`: use only these frames; the simulation starts in the first, which therefore gives no residuals."""
        self.channels, self.first = list(channels), first
        self.used = np.concatenate([one.used for one in self.channels], axis=1)[first : None if last is None else last + 1].copy()
        self.used[0] = False

    @cached_property
    def whitener(self) -> np.ndarray:
        """(channels, T+1, T+1) matrices that turn a channel's series into residuals of unit variance; rows of frames not used are 0."""
        out = np.zeros((self.used.shape[1], len(self.used), len(self.used)))
        for row, covariance in enumerate(self._covariances()):
            used = np.flatnonzero(self.used[:, row])
            if len(used):
                out[row][np.ix_(used, used)] = np.linalg.inv(np.linalg.cholesky(covariance[np.ix_(used, used)]))
        return out

    @cached_property
    def deviation(self) -> np.ndarray:
        """(T+1, channels) standard deviation of each raw residual alone."""
        return np.sqrt(np.stack([np.diag(covariance) for covariance in self._covariances()], axis=1))

    def _covariances(self) -> Iterator[np.ndarray]:
        rows = slice(self.first, self.first + len(self.used))
        for one in self.channels:
            for channel in range(one.count):
                yield one.covariance(channel)[rows, rows]

    def between(self, first: int, last: int) -> Objective:
        """The objective of the frames first ... last of these."""
        return Objective(self.channels, self.first + first, self.first + last)

    def until(self, frames: int) -> Objective:
        """The objective of the first frames only."""
        if frames == self.frames:
            return self
        part = self.between(0, frames)
        # Cholesky factors are causal: their first rows do not depend on later frames.
        part.__dict__["whitener"] = self.whitener[:, : frames + 1, : frames + 1]
        return part

    @property
    def unit(self) -> str:
        """The unit of distances."""
        return "px" if isinstance(self.channels[0], TrackChannels) else "m"

    @property
    def frames(self) -> int:
        """T, the number of intervals."""
        return len(self.used) - 1

    def residual(self, x: np.ndarray, first_frame: int = 0) -> np.ndarray:
        """Raw residuals (B, S, channels) of trajectories (B, S, N, 3) over the frames first_frame ... first_frame + S - 1."""
        rows = []
        for frame in range(first_frame, first_frame + x.shape[1]):
            parts = [one.residual(x[:, frame - first_frame], self.first + frame) for one in self.channels]
            rows.append(np.concatenate(parts, axis=1) * self.used[frame])
        return np.stack(rows, axis=1)

    def whiten(self, residual: np.ndarray) -> np.ndarray:
        """Whitened residuals (B, channels (T+1)) from raw ones (B, T+1, channels)."""
        white = np.matmul(self.whitener, residual.transpose(2, 1, 0))  # (channels, T+1, B)
        return white.reshape(-1, residual.shape[0]).T

    def misfit(self, white: np.ndarray) -> float:
        """Root mean square of whitened residuals (channels (T+1),) [standard deviations]."""
        return float(np.sqrt((white**2).sum() / max(int(self.used.sum()), 1)))

    def median_distance(self, white: np.ndarray) -> float:
        """Distance between simulation and observations [px or m], root mean square over the points and median over the frames.

        It is that of `root_mean_square`, but from whitened residuals (channels (T+1),), and for points in 3D that of their smooth motion.
        """
        square = (self.unwhitened(white[None])[0] ** 2).sum(axis=1)
        if isinstance(self.channels[0], TrackChannels):  # two channels per point; each mode extends over all points
            square = square / np.maximum(0.5 * self.used.sum(axis=1), 1.0)
        return float(np.median(np.sqrt(square[self.used.any(axis=1)]))) if self.used.any() else 0.0

    def unwhitened(self, white: np.ndarray) -> np.ndarray:
        """The inverse of `whiten`: raw residuals (B, T+1, channels) from whitened ones (B, channels (T+1)); 0 where not used."""
        count, frames = self.whitener.shape[:2]
        series = white.reshape(len(white), count, frames).transpose(1, 2, 0)
        raw = np.zeros((count, frames, len(white)), white.dtype)
        for channel in range(count):
            used = np.flatnonzero(self.used[:, channel])
            if len(used):
                raw[channel, used] = np.linalg.solve(self.whitener[channel][np.ix_(used, used)], series[channel, used])
        return raw.transpose(2, 1, 0)

    @property
    def log_volume(self) -> float:
        """Logarithm of the determinant of all whiteners, which is minus half the log determinant of the residuals' covariance."""
        diagonal = np.einsum("ctt->tc", self.whitener)[self.used]
        return float(np.log(diagonal).sum())

    def mismatched(self, scale: float) -> Objective:
        """The objective with the standard deviation of the mismatch at `scale` times its initial value."""
        return Objective([one.mismatched(scale) for one in self.channels], self.first, self.first + self.frames)

    def reweighted(self, residual: np.ndarray) -> Objective:
        """The objective with outliers of the raw residual (T+1, channels) weighted down (Huber)."""
        ends = np.cumsum([one.count for one in self.channels])
        whole = np.full((len(self.channels[0].used), residual.shape[1]), np.nan)
        whole[self.first : self.first + len(residual)] = residual
        parts = np.split(whole, ends[:-1], axis=1)
        channels = [one.reweighted(part) for one, part in zip(self.channels, parts, strict=True)]
        return Objective(channels, self.first, self.first + self.frames)

    def root_mean_square(self, x: np.ndarray) -> np.ndarray:
        """(T+1,) root mean square distance between simulated and observed points in each frame; 0 where nothing was seen."""
        distance = np.concatenate([one.distance(x) for one in self.channels], axis=1)
        seen = np.isfinite(distance)
        return np.sqrt(np.where(seen, distance, 0.0).__pow__(2).sum(axis=1) / np.maximum(seen.sum(axis=1), 1))

    def shown(self, pinned: np.ndarray) -> np.ndarray:
        """(T+1,) bool: frames in which something is seen that a force moves, so not only what rides on held particles, pinned (N,) bool."""
        shown = np.zeros(len(self.channels[0].used), bool)
        for one in self.channels:
            free = one.points @ pinned <= NOISE.clamp_rides
            if isinstance(one, TrackChannels):  # two channels a point; modes share all points
                shown |= one.used.reshape(len(shown), -1, 2)[:, free].any(axis=(1, 2))
            else:
                shown |= one.used.any(axis=1) & one.targets.visible[:, free].any(axis=1)
        return shown[self.first : self.first + len(self.used)] & self.used.any(axis=1)

    def points(self) -> np.ndarray:
        """(K, N) matrix from particles to the observed points of all channels."""
        return np.concatenate([one.points for one in self.channels])

    def wild_frames(self) -> np.ndarray:
        """(T,) bool: intervals whose end frame is wild in the tracks of any camera."""
        wild = np.zeros(self.frames, bool)
        for one in self.channels:
            if isinstance(one, TrackChannels) and one.wild is not None:
                wild |= one.wild[self.first + 1 :][: len(wild)]
        return wild
