"""The solver's mismatch: how far the simulated body strays from the filmed one under the very force that moved it.

What is taken for mismatch is not taken for a force. It is a Gaussian process over the clip for each channel: a white part, a slow one, and
on a held body a drift and what leaks from one direction into another.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from ...records import Particles

PLASTIC_FACTOR = 10.0
"""How much more variance the mismatch has when the body flows plastically."""
MISMATCH_SPACINGS, MISMATCH_SPACINGS_TAU = (0.001, 0.002), 8.0
"""White and slow part of the mismatch of points in 3D [particle spacings], and how long the slow one lasts [frames]."""
MISMATCH_MOTION, MISMATCH_WHITE = 0.02, 0.2
"""On a held body: the mismatch in each mode in its own motion, beside the first of `MISMATCH_SPACINGS`, and how much of it is white.
It is what stiffness, section and clamp (`stiffness`) leave of how the body bends: of another simulator's posts that move by the true force,
with the three fitted to their motion, 0.4 to 0.9 % of the motion in the modes of degree 0 and 1, 1 to 2.3 % in those of degree 2 and 3.
In pixels, the mismatch of tracks covers it."""
MISMATCH_DRIFT, DRIFT_PICTURES = 0.05, 90.0
"""How far a held body strays from the solver's in so many pictures, in its own motion, as the integral of a random walk: a clamp gives way
under a lasting force. After 4 s of gusts another simulator's posts stood 4 to 8 % of their motion away from where their bending put them,
in step with the sum of the force; this solver's, 0.1 to 3 %. Taken for bending, it asked for a force that grew through the clip. Where
points show how the clamp moves (`clamp_motion`), this is for what is left: d_stalk 12.2 % with it, 13.7 % without."""
MISMATCH_ALONG, DRIFT_ALONG = 0.1, 0.005
"""The same two along the body's own curve (`arc`): in the motion along it, and, of the drift, in all motion. Nothing of the bending is
seen there, so what moves along it is small, and tells the force along the body, which bending does not."""
LEAK = 0.01
"""How far a held body as a whole moves along its axis in step with what it does across it, of that: a clamp turns about a place beside
the axis. Another simulator's post did so by 1 %, and stretched in step with its swing by 0.05 and 0.25 %."""
SWIFT = 7
"""Pictures over which a cubic is fitted to a held body's motion in each mode. What swings faster, as after a strike, is in step with the
solver's body for a few periods only and beyond the force's knots, so all of it is taken for mismatch, too."""


def mismatch_covariance(frames: int, white: float, slow: float, tau: float, variance_factor: float, from_rest: bool = False) -> np.ndarray:
    """(frames, frames) of a white part and a slow one that is forgotten in `tau` frames.

    Args:
        from_rest: the slow part is zero in picture 0, where the body is in the place in which it was built, and grows from there.
    """
    time = np.arange(frames)
    slowly = np.exp(-np.abs(np.subtract.outer(time, time)) / tau)
    if from_rest:
        slowly -= np.exp(-np.add.outer(time, time) / tau)
    return variance_factor * (white**2 * np.eye(frames) + slow**2 * slowly)


def point_mismatch(particles: Particles, moved: np.ndarray, plastic: bool, along: bool) -> np.ndarray:
    """(modes, 3, T+1, T+1) covariance of the mismatch of points in 3D [m²].

    Args:
        moved: (T+1, modes, 3) amplitudes observed, since picture 0 [m].
        along: component 0 is that along a held body's curve, of which mode 0 is what all that is free has in common.
    """
    white, slow = (np.full(moved.shape[1:], share * particles.spacing) for share in MISMATCH_SPACINGS)
    drift, held = np.zeros_like(slow), bool(particles.pinned.any())
    parts = [slice(0, 1), slice(1, 3)] if along else [slice(0, 3)]
    if held:
        size, whole = _sizes(moved, parts), _sizes(moved, [slice(0, 3)])
        first = np.array([along, False, False])
        slow = np.hypot(white, np.where(first, MISMATCH_ALONG, MISMATCH_MOTION) * size)
        drift = np.where(first, DRIFT_ALONG, MISMATCH_DRIFT) * whole
        white = MISMATCH_WHITE * slow
        if len(moved) >= SWIFT:
            white = np.hypot(white, _sizes(moved - savgol_filter(moved, SWIFT, 3, axis=0), parts))
    factor = PLASTIC_FACTOR if plastic and not held else 1.0
    swings = [mismatch_covariance(len(moved), *one, MISMATCH_SPACINGS_TAU, factor) for one in zip(white.ravel(), slow.ravel())]
    walk = _integrated_walk(np.arange(len(moved)) / DRIFT_PICTURES)
    covariance = np.stack(swings).reshape(*moved.shape[1:], len(moved), -1) + drift[..., None, None] ** 2 * walk
    if along:
        covariance[0, 0] += LEAK**2 * moved[:, 0, 1:] @ moved[:, 0, 1:].T
    return covariance


def _integrated_walk(time: np.ndarray) -> np.ndarray:
    """(n, n) covariance of a random walk's integral at these times (n,), of variance 1 at time 1 (Rasmussen and Williams 2006, 6.3.1)."""
    early, late = np.minimum.outer(time, time), np.maximum.outer(time, time)
    return early**2 * (3.0 * late - early) / 2.0


def _sizes(amplitudes: np.ndarray, parts: list[slice]) -> np.ndarray:
    """(modes, 3) root mean square of amplitudes (T+1, modes, 3), over all components of the same part."""
    sizes = np.empty(amplitudes.shape[1:])
    for part in parts:
        sizes[:, part] = np.sqrt((amplitudes[..., part] ** 2).mean(axis=(0, 2)))[:, None]
    return sizes
