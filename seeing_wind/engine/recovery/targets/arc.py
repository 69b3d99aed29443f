"""Where a bent body's points lie along it: by the length of the body up to them, which bending leaves as it is.

A force along a held body stretches it by a hundredth of what one across it bends it. Along a fixed axis, that drowns in the shortening by
bending and in whatever is wrong with the bending. Along the body's own curve neither is seen.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import legvander

from .constants import NOISE


def along_the_curve(x: np.ndarray, axis: np.ndarray, spacing: float, inverse: np.ndarray) -> np.ndarray | None:
    """Places along a body as linear functions of where its points are, near where they were seen.

    The centres of slices across the body are joined to a curve. A point lies as far along it as its place in the slices says, and a
    little before or after where it is off their centres in the direction of the curve. This is linear in the points, as the directions
    are those of the observed curve, smoothed: a small error of the bending changes it in second order only, and noise does not turn the
    curve from slice to slice. What noise turns is longer when it is measured along itself than along another such curve, and that would
    look like a stretch.

    Args:
        x: (T+1, K, 3) points as observed [m]; axis: (3,) from what is held to what is not; spacing: of the particles [m].
        inverse: (M, K), amplitudes of M modes from values at the points.

    Returns:
        (T+1, M, K, 3): the modes' amplitudes in frame t are the sum of [t] times the points; None for a body of too few slices.
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
    # The curve begins at the first centre, as far along the axis as that is, and a point has so much of each step before it.
    first = inverse.sum(axis=1)[:, None] * mean[0]
    before, apart = inverse @ blend @ np.tri(count, count - 1, -1), np.diff(mean, axis=0)
    aside = np.eye(len(height)) - blend @ mean
    out = np.empty((len(x), *inverse.shape, 3))
    for t in range(len(x)):
        for c in range(3):
            out[t, ..., c] = axis[c] * first + (before * steps[t, :, c]) @ apart + (inverse * own[t, :, c]) @ aside
    return out
