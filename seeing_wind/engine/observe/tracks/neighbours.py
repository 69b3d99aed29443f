"""Predicting a point's motion from its neighbours: a surface moves nearly affinely over the reach of a dozen tracks."""

from __future__ import annotations

import numpy as np

NEIGHBOURS = 12

LEAST = 4
"""Least number of neighbours that can contradict a point."""


def predict(
    rest: np.ndarray, now: np.ndarray, trusted: np.ndarray, previous: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Robust local affine motion of every point from its trusted neighbours, the point itself left out.

    Args:
        rest: (K, 2) [px], positions in frame 0.
        now: (K, 2) [px], positions in the newest frame.
        trusted: (K,) bool, which points' `now` is used.
        previous: (K, 2, 2), each point's affine shape before; kept along directions that the neighbours do not span.
        reach: [px], largest distance of a neighbour.

    Returns:
        predicted (K, 2) [px], affine (K, 2, 2), and support (K,) int, the number of neighbours used.
    """
    count = len(rest)
    known = np.flatnonzero(trusted)
    if len(known) < 2:
        return now.copy(), previous.copy(), np.zeros(count, int)
    reach_count = min(NEIGHBOURS + 1, len(known))
    # For hundreds of points, a tree would take longer, and so would a norm over an axis of length two.
    across, down = (rest[:, None, side] - rest[known, side] for side in (0, 1))
    distance = np.sqrt(across**2 + down**2)
    near = np.argpartition(distance, reach_count - 1, axis=1)[:, :reach_count]
    distance, index = np.take_along_axis(distance, near, axis=1), known[near]
    weight = ((distance < reach) & (index != np.arange(count)[:, None])).astype(np.float64)
    weight *= 1.0 / (1.0 + (distance / (0.5 * reach)) ** 2)
    predicted, affine = _fit(rest, now, index, weight, previous)
    for _ in range(2):
        model = np.matmul(affine, np.swapaxes(rest[index] - rest[:, None, :], 1, 2)).swapaxes(1, 2) + predicted[:, None, :]
        off = np.linalg.norm(now[index] - model, axis=2)
        # Cauchy weights with a scale of one pixel, so that a lost neighbour hardly counts.
        predicted, affine = _fit(rest, now, index, weight / (1.0 + off**2), previous)
    return predicted, affine, (weight > 0).sum(axis=1)


def _fit(
    rest: np.ndarray, now: np.ndarray, index: np.ndarray, weight: np.ndarray, previous: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted ridge fit of now = affine (rest - rest_k) + predicted, with a pull to `previous` where the neighbours leave it open."""
    total = weight.sum(axis=1, keepdims=True) + 1e-12
    near, target = rest[index], now[index]
    near_mean = (weight[..., None] * near).sum(axis=1) / total
    target_mean = (weight[..., None] * target).sum(axis=1) / total
    a, b = near - near_mean[:, None, :], target - target_mean[:, None, :]
    weighted = np.swapaxes(weight[..., None] * a, 1, 2)
    # The ridge is negligible against spread-out neighbours; across neighbours in a line it keeps `previous`.
    ridge = 4.0 * total[:, :, None] * np.eye(2)
    normal, mixed = np.matmul(weighted, a) + ridge, np.matmul(weighted, b) + np.matmul(ridge, np.swapaxes(previous, 1, 2))
    affine = np.swapaxes(np.linalg.solve(normal, mixed), 1, 2)
    predicted = target_mean + np.matmul(affine, (rest - near_mean)[:, :, None])[:, :, 0]
    return predicted, affine


def disagreement(xy: np.ndarray, predicted: np.ndarray, support: np.ndarray) -> np.ndarray:
    """Distance (K,) [px] of points xy (K, 2) from their neighbours' prediction; 0 with fewer than `LEAST` neighbours."""
    return np.where(support >= LEAST, np.linalg.norm(xy - predicted, axis=1), 0.0)
