"""Trilinear interpolation on a regular lattice that fills a box; outside the box, the value at the nearest place of the box."""

from __future__ import annotations

import numpy as np


def value_at(values: np.ndarray, box: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values (P, ...) at points (P, 3), from `values` (A, B, C, ...) at the nodes of a box (2, 3)."""
    corner, t, _ = _cells(values, box, points)
    found = np.zeros((len(points), *values.shape[3:]))
    for offset in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(offset, t, 1.0 - t), axis=1)
        found += weight.reshape(-1, *(1,) * (values.ndim - 3)) * values[tuple((corner + offset).T)]
    return found


def slope_at(values: np.ndarray, box: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivatives (P, ..., 3) of `value_at` with respect to the point; zero along an axis on which the point lies outside the box."""
    corner, t, size = _cells(values, box, points)
    found = np.zeros((len(points), *values.shape[3:], 3))
    within = (points >= box[0]) & (points <= box[1])
    for offset in np.ndindex(2, 2, 2):
        weight = np.where(offset, t, 1.0 - t)
        node = values[tuple((corner + offset).T)]
        for axis in range(3):
            along = np.prod(np.delete(weight, axis, axis=1), axis=1) * (1.0 if offset[axis] else -1.0) / size[axis] * within[:, axis]
            found[..., axis] += along.reshape(-1, *(1,) * (values.ndim - 3)) * node
    return found


def _cells(values: np.ndarray, box: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First node (P, 3) of each point's cell, the point's place (P, 3) in the cell, 0..1, and the size (3,) of a cell."""
    counts = np.array(values.shape[:3])
    where = np.clip((points - box[0]) / (box[1] - box[0]), 0.0, 1.0) * (counts - 1)
    corner = np.minimum(where.astype(int), counts - 2)
    return corner, where - corner, (box[1] - box[0]) / (counts - 1)
