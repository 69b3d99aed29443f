"""How far a simulation is from what was observed, as numbers of unit variance (paper, section 3.4: sparse tracking objective).

What was observed comes as *channels*, time series that the simulation must follow (`channels`). The residuals of a channel are
correlated in time (the simulator's own error drifts, the rest state is as noisy as any frame), so each is whitened with the Cholesky
factor of its covariance over the frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np

from .constants import NOISE
from .points import PointChannels
from .tracks import TrackChannels

Channels = PointChannels | TrackChannels
"""One source of residuals: some time series over T + 1 frames."""


class Objective:
    """All channels together."""

    def __init__(self, channels: Sequence[Channels], first: int = 0, last: int | None = None) -> None:
        """`first` and `last`: look only at these frames; the simulation starts in the first, which therefore shows nothing."""
        self.channels, self.first = list(channels), first
        self.used = np.concatenate([one.used for one in self.channels], axis=1)[first : None if last is None else last + 1].copy()
        self.used[0] = False

    @cached_property
    def whitener(self) -> np.ndarray:
        """(channels, T+1, T+1): times a channel's series gives residuals of unit variance, 0 rows where not used."""
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
        # Cholesky factors are causal: the first rows do not know of the later ones.
        part.__dict__["whitener"] = self.whitener[:, : frames + 1, : frames + 1]
        return part

    @property
    def unit(self) -> str:
        """Of distances."""
        return "px" if isinstance(self.channels[0], TrackChannels) else "m"

    @property
    def frames(self) -> int:
        """T."""
        return len(self.used) - 1

    def residual(self, x: np.ndarray, first_frame: int = 0) -> np.ndarray:
        """Trajectories (B, S, N, 3), frames first_frame ... first_frame + S - 1 -> raw residuals (B, S, channels)."""
        rows = []
        for frame in range(first_frame, first_frame + x.shape[1]):
            parts = [one.residual(x[:, frame - first_frame], self.first + frame) for one in self.channels]
            rows.append(np.concatenate(parts, axis=1) * self.used[frame])
        return np.stack(rows, axis=1)

    def whiten(self, residual: np.ndarray) -> np.ndarray:
        """Raw (B, T+1, channels) -> unit variance (B, channels (T+1))."""
        white = np.matmul(self.whitener, residual.transpose(2, 1, 0))  # (channels, T+1, B)
        return white.reshape(-1, residual.shape[0]).T

    def misfit(self, white: np.ndarray) -> float:
        """Root mean square of whitened residuals (channels (T+1),): in the observations' standard deviations."""
        return float(np.sqrt((white**2).sum() / max(int(self.used.sum()), 1)))

    def median_distance(self, white: np.ndarray) -> float:
        """Of the simulation from what was seen, root mean square over the points and median over the frames [px or m], by whitened
        residuals (channels (T+1),): what `root_mean_square` tells of a trajectory, of points in 3D that of their smooth motion."""
        square = (self.unwhitened(white[None])[0] ** 2).sum(axis=1)
        if isinstance(self.channels[0], TrackChannels):  # two channels a point; modes share all points
            square = square / np.maximum(0.5 * self.used.sum(axis=1), 1.0)
        return float(np.median(np.sqrt(square[self.used.any(axis=1)]))) if self.used.any() else 0.0

    def unwhitened(self, white: np.ndarray) -> np.ndarray:
        """What `whiten` made of it: (B, channels (T+1)) -> raw (B, T+1, channels), 0 where not used."""
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
        """Logarithm of the determinant of all whiteners: minus half that of the residuals' covariance."""
        diagonal = np.einsum("ctt->tc", self.whitener)[self.used]
        return float(np.log(diagonal).sum())

    def mismatched(self, scale: float) -> Objective:
        """The objective with `scale` times the mismatch that the channels were given at first."""
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
        """(T+1,) distance of simulated and observed points per frame, 0 where nothing was seen."""
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
        """(all K, N) of all observed points."""
        return np.concatenate([one.points for one in self.channels])

    def wild_frames(self) -> np.ndarray:
        """(T,) bool: frames whose later frame is wild in the tracks of any camera."""
        wild = np.zeros(self.frames, bool)
        for one in self.channels:
            if isinstance(one, TrackChannels) and one.wild is not None:
                wild |= one.wild[self.first + 1 :][: len(wild)]
        return wild
