"""What was seen of a sheet: the path of its vertices, interpolated between frames, and its shape at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from ....records import Measured
from ...targets.channels import noise_of

FLAT = 0.02
"""A sheet is flat at rest if in frame 0 its root mean square distance from a plane is less than this share of its size, or than three times
its noise: noise of half a millimetre would otherwise become creases."""
STILL = 3.0
"""Pinned vertices stand still if they move by less than this many standard deviations of the noise."""
SMOOTH = 7
"""Frames over which a parabola is fitted to smooth the path of pinned vertices that move."""


@dataclass(frozen=True)
class Observed:
    """An observed sheet in T+1 frames."""

    x: np.ndarray
    """(T+1, V, 3) positions of the vertices [m]."""
    faces: np.ndarray
    """(F, 3) vertex indices."""
    pinned: np.ndarray
    """(V,) bool."""
    fps: float
    deviation: np.ndarray
    """Standard deviation of a coordinate [m], one number or (T+1, V)."""
    measured: Measured | None = None
    """The measurement of each frame by itself, not smoothed in time, if a camera saw the sheet."""

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
        """(V, 3) the shape at rest [m]: that of frame 0, projected onto a plane if the sheet is flat but for noise."""
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
        """(T+1, P, 3) path of the pinned vertices [m], which begins at their places at rest."""
        path = self.x[:, self.pinned]
        begun = self.rest[self.pinned]
        if not path.size:
            return path
        if float(np.abs(path - path.mean(axis=0)).max()) < 1e-9 or float(path.std(axis=0).mean()) < STILL * self.noise:
            return np.broadcast_to(begun, path.shape)
        if self.noise and len(path) >= SMOOTH:
            from scipy.signal import savgol_filter  # slow to import, and not needed for edits and samples

            path = savgol_filter(path, SMOOTH, 2, axis=0)
        return path - path[0] + begun

    @cached_property
    def spline(self) -> CubicSpline:
        """Interpolated positions (V, 3) [m] as a function of time [frames]."""
        return CubicSpline(np.arange(len(self.x)), self.x, axis=0)

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions [m] and velocities [m/s], (V, 3) each, at a time [frames]."""
        return self.spline(time), self.fps * self.spline(time, 1)

    def catmull_rom_at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """The same by Catmull and Rom's interpolation: the difference between the two estimates the error of either."""
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
    """An observed sheet from points x (T+1, V, 3) [m].

    Args:
        sigma: standard deviation of the points' coordinates [m], one number or (T+1, V); None to estimate it.
        measured: see `Observed`.
    """
    deviation = np.asarray(_noise(x, faces) if sigma is None else sigma, np.float64)
    return Observed(np.asarray(x, np.float64), faces, pinned, fps, deviation, measured)


def _noise(x: np.ndarray, faces: np.ndarray) -> float:
    """Standard deviation of a coordinate [m], estimated from differences in time or from the changes of edge lengths, which cloth hardly
    allows; the smaller of the two, as a sheet that flaps too fast for the frame rate spoils the first."""
    lengths = np.linalg.norm(x[:, np.roll(faces, -1, axis=1)] - x[:, faces], axis=-1)
    return min(noise_of(x[1:].reshape(len(x) - 1, -1)), float(np.median(lengths.std(axis=0))) / math.sqrt(2.0))
