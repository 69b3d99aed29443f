"""How far a simulation is from what was observed, as numbers of unit variance (paper, section 3.4: sparse tracking objective).

What was observed comes as *channels*, time series that the simulation must follow (`channels`). The residuals of a channel are
correlated in time (the simulator's own error drifts, the rest state is as noisy as any picture), so each is whitened with the Cholesky
factor of its covariance over the pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np


class Channels(Protocol):
    """One source of residuals: some time series over T + 1 pictures."""

    @property
    def count(self) -> int:
        """Number of series."""

    @property
    def used(self) -> np.ndarray:
        """(T+1, count) bool: observed, and picture 0 left out (the simulation starts there)."""

    @property
    def points(self) -> np.ndarray:
        """(K, N): particles -> observed points."""

    def residual(self, x: np.ndarray, frame: int) -> np.ndarray:
        """Particles (B, N, 3) at picture `frame` -> simulated minus observed (B, count), 0 where not used."""

    def covariance(self, channel: int) -> np.ndarray:
        """(T+1, T+1) covariance of one channel over the pictures."""

    def reweighted(self, residual: np.ndarray) -> Channels:
        """The same channels, outliers of `residual` (T+1, count) given the variance that makes them Huber."""

    def distance(self, x: np.ndarray) -> np.ndarray:
        """(T+1, points) distances of the observed points for a trajectory (T+1, N, 3), NaN where not seen."""

    def acceleration(self, x: np.ndarray, fps: float) -> float:
        """Root mean square acceleration [m/s²] of what was observed, across the view; `x` (N, 3) is the rest state."""

    def speed(self, x: np.ndarray, fps: float) -> float:
        """Root mean square speed [m/s] of what was observed in the first pictures, across the view."""


class Objective:
    """All channels together."""

    def __init__(self, channels: Sequence[Channels], pictures: int | None = None) -> None:
        """`pictures`: look only at the first so many."""
        self.channels = list(channels)
        self.used = np.concatenate([one.used for one in self.channels], axis=1)
        self.whitener = np.concatenate([_whiteners(one) for one in self.channels])
        """(channels, T+1, T+1): times a channel's series gives residuals of unit variance, 0 rows where not used."""
        marginal = [np.diag(one.covariance(channel)) for one in self.channels for channel in range(one.count)]
        self.deviation = np.sqrt(np.stack(marginal, axis=1))
        """(T+1, channels) standard deviation of each raw residual alone."""
        if pictures is not None:  # Cholesky factors are causal: the first rows do not know of the later ones
            self.used, self.deviation = self.used[:pictures], self.deviation[:pictures]
            self.whitener = self.whitener[:, :pictures, :pictures]

    def until(self, frames: int) -> Objective:
        """The objective of the clip's first frames only."""
        return self if frames == self.frames else Objective(self.channels, frames + 1)

    @property
    def frames(self) -> int:
        """T."""
        return len(self.used) - 1

    def residual(self, x: np.ndarray, first_frame: int = 0) -> np.ndarray:
        """Trajectories (B, S, N, 3), pictures first_frame ... first_frame + S - 1 -> raw residuals (B, S, channels)."""
        rows = [np.concatenate([one.residual(x[:, s], first_frame + s) for one in self.channels], axis=1) for s in range(x.shape[1])]
        return np.stack(rows, axis=1)

    def whiten(self, residual: np.ndarray) -> np.ndarray:
        """Raw (B, T+1, channels) -> unit variance (B, channels (T+1))."""
        white = np.matmul(self.whitener, residual.transpose(2, 1, 0))  # (channels, T+1, B)
        return white.reshape(-1, residual.shape[0]).T

    def reweighted(self, residual: np.ndarray) -> Objective:
        """The objective with outliers of the raw residual (T+1, channels) weighted down (Huber)."""
        ends = np.cumsum([one.count for one in self.channels])
        parts = np.split(residual, ends[:-1], axis=1)
        return Objective([one.reweighted(part) for one, part in zip(self.channels, parts, strict=True)])

    def root_mean_square(self, x: np.ndarray) -> np.ndarray:
        """(T+1,) distance of simulated and observed points per picture, 0 where nothing was seen."""
        distance = np.concatenate([one.distance(x) for one in self.channels], axis=1)
        seen = np.isfinite(distance)
        return np.sqrt(np.where(seen, distance, 0.0).__pow__(2).sum(axis=1) / np.maximum(seen.sum(axis=1), 1))

    def points(self) -> np.ndarray:
        """(all K, N) of all observed points."""
        return np.concatenate([one.points for one in self.channels])


def _whiteners(channels: Channels) -> np.ndarray:
    """Inverse Cholesky factors over the used pictures of each channel, (channels, T+1, T+1)."""
    frames = len(channels.used)
    out = np.zeros((channels.count, frames, frames))
    for channel in range(channels.count):
        used = np.flatnonzero(channels.used[:, channel])
        if len(used):
            factor = np.linalg.cholesky(channels.covariance(channel)[np.ix_(used, used)])
            out[channel][np.ix_(used, used)] = np.linalg.inv(factor)
    return out
