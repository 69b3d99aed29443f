"""What was seen of a sheet: where its vertices went, between frames as well, and its shape at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from ....records import Measured
from ...targets.channels import noise_of

FLAT = 0.02
"""A sheet that in frame 0 leaves a plane by less than this part of its size, root mean square, or by three times its noise, is flat
at rest: noise of half a millimetre would otherwise be creases."""
STILL = 3.0
"""What is held and moves by less than this many deviations of its noise stands still."""
SMOOTH = 7
"""Frames over which a parabola smooths the path of what is held and moves."""


@dataclass(frozen=True)
class Observed:
    """A sheet in T+1 frames."""

    x: np.ndarray
    """(T+1, V, 3) [m]."""
    faces: np.ndarray
    """(F, 3)."""
    pinned: np.ndarray
    """(V,) bool."""
    fps: float
    deviation: np.ndarray
    """Standard deviation of a coordinate [m], one number or (T+1, V)."""
    measured: Measured | None = None
    """What each frame says by itself, where a camera saw the sheet."""

    @property
    def noise(self) -> float:
        """Root mean square of the deviation [m]."""
        return float(np.sqrt((self.deviation**2).mean()))

    @property
    def frames(self) -> int:
        """T."""
        return len(self.x) - 1

    @cached_property
    def rest(self) -> np.ndarray:
        """(V, 3) the shape at rest [m]: that of frame 0, without what noise there is across a flat sheet."""
        first = self.x[0]
        centre = first.mean(axis=0)
        across = np.linalg.svd(first - centre, full_matrices=False)[2][2]
        off = (first - centre) @ across
        size = float(np.linalg.norm(first - centre, axis=1).max())
        if float(np.sqrt((off**2).mean())) > max(FLAT * size, 3.0 * self.noise):
            return first
        return first - off[:, None] * across

    @cached_property
    def pins(self) -> np.ndarray:
        """(T+1, P, 3) where the pinned vertices are [m], from their places at rest on."""
        path = self.x[:, self.pinned]
        begun = self.rest[self.pinned]
        if not path.size:
            return path
        if float(np.abs(path - path.mean(axis=0)).max()) < 1e-9 or float(path.std(axis=0).mean()) < STILL * self.noise:
            return np.broadcast_to(begun, path.shape)
        if self.noise and len(path) >= SMOOTH:
            from scipy.signal import savgol_filter  # slow to import, and edits and samples need none

            path = savgol_filter(path, SMOOTH, 2, axis=0)
        return path - path[0] + begun

    @cached_property
    def spline(self) -> CubicSpline:
        """Places (V, 3) [m] at a time [frames]."""
        return CubicSpline(np.arange(len(self.x)), self.x, axis=0)

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Places [m] and velocities [m/s] (V, 3) at a time [frames]."""
        return self.spline(time), self.fps * self.spline(time, 1)

    def plainly_at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """The same by another interpolation, Catmull and Rom's: by how much it differs tells how well either is known."""
        path = CubicHermiteSpline(np.arange(len(self.x)), self.x, np.gradient(self.x, axis=0))
        return path(time), self.fps * path(time, 1)


def observe_sheet(
    x: np.ndarray,
    faces: np.ndarray,
    pinned: np.ndarray,
    fps: float,
    sigma: float | np.ndarray | None,
    measured: Measured | None = None,
) -> Observed:
    """Of points x (T+1, V, 3) [m]; sigma: their noise [m], one number or (T+1, V), None to measure it; measured: see `Observed`."""
    deviation = np.asarray(_noise(x, faces) if sigma is None else sigma, np.float64)
    return Observed(np.asarray(x, np.float64), faces, pinned, fps, deviation, measured)


def _noise(x: np.ndarray, faces: np.ndarray) -> float:
    """Standard deviation of a coordinate [m]: what differences in time leave of it, or, where a sheet flaps too fast for the frames,
    how much its edges change their lengths, which they hardly do."""
    lengths = np.linalg.norm(x[:, np.roll(faces, -1, axis=1)] - x[:, faces], axis=-1)
    return min(noise_of(x[1:].reshape(len(x) - 1, -1)), float(np.median(lengths.std(axis=0))) / math.sqrt(2.0))
