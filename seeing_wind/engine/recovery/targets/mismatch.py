"""The solver's mismatch: how far the simulated body strays from the filmed one under the true force.

Residuals within the mismatch are not attributed to a force. For each channel the mismatch is a Gaussian process over the clip: a white part
and a slow part, and for a held body also a drift, and motion that leaks from one direction into another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...records import Particles
from .constants import NOISE


def mismatch_covariance(frames: int, white: float, slow: float, tau: float, variance_factor: float, from_rest: bool = False) -> np.ndarray:
    """Covariance (frames, frames) of a white part and a slow part with a correlation time of `tau` frames.

    Args:
        white, slow: standard deviations of the two parts.
        variance_factor: factor on the whole covariance.
        from_rest: the slow part is zero in frame 0, in which the body was built, and grows from there.
    """
    time = np.arange(frames)
    slowly = np.exp(-np.abs(np.subtract.outer(time, time)) / tau)
    if from_rest:
        slowly -= np.exp(-np.add.outer(time, time) / tau)
    return variance_factor * (white**2 * np.eye(frames) + slow**2 * slowly)


@dataclass(frozen=True)
class Lengthwise:
    """The modes whose component 0 is measured along a held body's own curve; mode 0 is the common motion of all that is free."""

    modes: np.ndarray
    """(modes,) bool: modes that vary along the body only."""
    length: float
    """Length of the free part along the axis [m]."""

    @property
    def stretch(self) -> np.ndarray:
        """(modes,) bool: modes that show how the body is stretched."""
        return self.modes & (np.arange(len(self.modes)) > 0)


def point_mismatch(particles: Particles, moved: np.ndarray, plastic: bool, lengthwise: Lengthwise | None = None) -> np.ndarray:
    """Covariance (modes, 3, T+1, T+1) of the mismatch of points in 3D [m²].

    Args:
        moved: (T+1, modes, 3) observed amplitudes since frame 0 [m].
        plastic: whether the body flows.
        lengthwise: for a held body that is measured along its own curve, see `arc`.
    """
    white, slow = (np.full(moved.shape[1:], share * particles.spacing) for share in (NOISE.white, NOISE.slow))
    drift, held = np.zeros_like(slow), bool(particles.pinned.any())
    parts = [slice(0, 3)] if lengthwise is None else [slice(0, 1), slice(1, 3)]
    if held:
        size, whole = _sizes(moved, parts), _sizes(moved, [slice(0, 3)])
        motion, drift = NOISE.motion * size, NOISE.drift * whole
        if lengthwise is not None:
            swing, turned, stretch = whole[0, 0], ~lengthwise.modes, lengthwise.stretch
            # Bending shortens a swinging body along its axis by about this much, and an error of the bending makes it wrong.
            white[stretch, 0] = np.hypot(NOISE.stretch_least * particles.spacing, NOISE.stretch * swing**2 / lengthwise.length)
            motion[:, 0] = np.hypot(NOISE.along * size[:, 0], np.where(turned, NOISE.turned * swing, 0.0))
            drift[:, 0] = np.where(turned, NOISE.drift_turned * swing, NOISE.drift_stretch * swing)
            motion[0, 0], drift[0, 0] = NOISE.along_whole * swing, NOISE.drift_whole * swing
        slow = np.hypot(white, motion)
        white = NOISE.motion_white * slow
        if len(moved) >= NOISE.swift:
            from scipy.signal import savgol_filter  # slow to import, and not needed for edits and samples

            swift = _sizes(moved - savgol_filter(moved, NOISE.swift, 3, axis=0), parts)
            if lengthwise is not None:
                swift[lengthwise.stretch, 0] *= NOISE.swift_stretch
            white = np.hypot(white, swift)
    factor = NOISE.plastic_factor if plastic and not held else 1.0
    swings = [mismatch_covariance(len(moved), *one, NOISE.slow_time, factor) for one in zip(white.ravel(), slow.ravel())]
    walk = _integrated_walk(np.arange(len(moved)) / NOISE.drift_frames)
    covariance = np.stack(swings).reshape(*moved.shape[1:], len(moved), -1) + drift[..., None, None] ** 2 * walk
    if lengthwise is not None:
        covariance[0, 0] += NOISE.leak**2 * moved[:, 0, 1:] @ moved[:, 0, 1:].T
    return covariance


def _integrated_walk(time: np.ndarray) -> np.ndarray:
    """Covariance (n, n) of the integral of a random walk at times (n,), with variance 1 at time 1 (Rasmussen and Williams 2006, 6.3.1)."""
    early, late = np.minimum.outer(time, time), np.maximum.outer(time, time)
    return early**2 * (3.0 * late - early) / 2.0


def _sizes(amplitudes: np.ndarray, parts: list[slice]) -> np.ndarray:
    """(modes, 3) root mean square of amplitudes (T+1, modes, 3), over frames and over the components of each part."""
    sizes = np.empty(amplitudes.shape[1:])
    for part in parts:
        sizes[:, part] = np.sqrt((amplitudes[..., part] ** 2).mean(axis=(0, 2)))[:, None]
    return sizes
