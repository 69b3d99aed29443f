"""Where the points of a bent body lie along it, as arc lengths, which bending does not change.

A force along a held body stretches it a hundred times less than the same force across the body bends it. Measured along a fixed axis, the
stretch is hidden by the shortening due to bending, and by errors of the bending. Measured along the body's own curve, it is free of both.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import legvander

from .constants import NOISE


def along_the_curve(x: np.ndarray, axis: np.ndarray, spacing: float, inverse: np.ndarray) -> np.ndarray | None:
    """Arc lengths along a body as linear functions of its points' positions, valid near the observed positions.

    The centres of slices across the body are joined to a curve. A point's arc length follows from its place among the slices at rest, plus
    its offset from their centres in the direction of the curve. This is linear in the points because the directions are those of the
    observed curve, smoothed: a small error of the bending changes the arc length in second order only, and noise does not turn the curve
    from slice to slice. A curve with noisy directions is longer measured along itself than along another such curve, and the difference
    would look like a stretch.

    Args:
        x: (T+1, K, 3) points as observed [m].
        axis: (3,) direction from the pinned part to the free part.
        spacing: spacing of the particles [m].
        inverse: (M, K) matrix from values at the points to amplitudes of M modes.

    Returns:
        (T+1, M, K, 3): entry t times the points (K, 3), summed, gives the modes' amplitudes in frame t. None if there are too few slices.
    """
    height = x[0] @ axis
    low, high = float(height.min()), float(height.max())
    count = min(int((high - low) / (NOISE.slice * spacing)), NOISE.most_slices)
    if count < NOISE.fewest_slices:
        return None
    belongs = np.minimum((count * (height - low) / (high - low)).astype(int), count - 1) == np.arange(count)[:, None]
    if not belongs.any(axis=1).all():
        return None
    smooth = legvander(np.linspace(-1.0, 1.0, count), min(NOISE.curve_degree, count - 1))
    mean = smooth @ np.linalg.pinv(smooth) @ (belongs / belongs.sum(axis=1, keepdims=True))  # (S, K)
    between = np.abs(np.interp(height, mean @ height, np.arange(count))[:, None] - np.arange(count))
    blend = np.maximum(1.0 - between, 0.0)  # (K, S), linear between the centres
    steps = np.diff(mean @ x, axis=1)
    steps /= np.linalg.norm(steps, axis=2, keepdims=True)
    tangents = np.concatenate([steps[:, :1], steps[:, :-1] + steps[:, 1:], steps[:, -1:]], axis=1)
    own = blend @ (tangents / np.linalg.norm(tangents, axis=2, keepdims=True))  # (T+1, K, 3)
    # The curve begins at the first centre, at that centre's place along the axis; a point's arc length is the sum of the steps before it.
    first = inverse.sum(axis=1)[:, None] * mean[0]
    before, apart = inverse @ blend @ np.tri(count, count - 1, -1), np.diff(mean, axis=0)
    aside = np.eye(len(height)) - blend @ mean
    out = np.empty((len(x), *inverse.shape, 3))
    for t in range(len(x)):
        for c in range(3):
            out[t, ..., c] = axis[c] * first + (before * steps[t, :, c]) @ apart + (inverse * own[t, :, c]) @ aside
    return out
