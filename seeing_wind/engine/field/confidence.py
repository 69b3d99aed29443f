"""How well a force is known: a confidence in 0..1 for every query, from where mass passed and how well the force is determined there.

Confidence is the product of two factors:

- coverage: 1 where particles are in that frame, falling like a Gaussian within a few particle spacings from them;
- signal to noise: s² / (s² + d²), where d² is the sum of the posterior variances of the force's three components, and s² the mean of the
  local squared force and the clip's mean squared force (a force that is known to be small is known, too).
"""

from __future__ import annotations

from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from ..conventions import FARTHEST
from ..records import Particles, Recovery

SUPPORTS = 2000
"""Support points per frame, at most, that stand for the particles; this keeps the file small. For a body of many more particles, confidence
reaches farther than the three spacings mentioned below, because its support points are farther apart."""

NEIGHBOURS = 6

FALL = 0.25
"""Standard deviation of the fall of coverage beyond half the reach, over the reach: under a tenth is left three spacings off the body."""

NEAREST = 1e-9
"""Least reach [m]."""

FAR = 1e12
"""Distance [m] beyond which nothing is known in any clip."""

ZERO = np.zeros(3)


class ConfidenceMap:
    """Support points with values, per frame.

    Args:
        points: (T, K, 3) [m] from `origin`; kept as float32, as in the file.
        value: (T, K) signal to noise factor, 0..1.
        reach: distance [m] over which confidence falls off.
        origin: (3,) [m], near the points, because in map coordinates float32 would resolve no more than half a metre.

    Raises:
        ValueError: for shapes that do not fit, values outside 0..1, or a reach beyond all bodies.
    """

    def __init__(self, points: np.ndarray, value: np.ndarray, reach: float, origin: np.ndarray = ZERO) -> None:
        self.points, self.value, self.reach = np.asarray(points, np.float32), np.asarray(value, np.float32), float(reach)
        self.origin = np.asarray(origin, np.float64)
        if self.points.shape != (*self.value.shape, 3) or not self.value.size or self.origin.shape != (3,):
            raise ValueError(f"confidence points {self.points.shape}, values {self.value.shape} and origin {self.origin.shape} do not fit")
        if not NEAREST <= self.reach <= FARTHEST or not ((self.value >= 0) & (self.value <= 1)).all():
            raise ValueError(f"confidence values outside 0..1, or a reach of {self.reach} m")
        self._trees: dict[int, cKDTree] = {}

    def at(self, points: np.ndarray, frame: int) -> np.ndarray:
        """Confidence (M,) at points (M, 3) [m] in frame interval `frame`."""
        distance, index = self._nearest(points, frame, min(NEIGHBOURS, self.value.shape[1]))
        # relative to the nearest point, so that the weights do not all vanish far away
        weight = np.exp(-(distance**2 - distance[:, :1] ** 2) / self.reach**2)
        value = (weight * self.value[frame].astype(np.float64)[index]).sum(axis=1) / weight.sum(axis=1)
        return value * np.exp(-0.5 * (self._beyond(distance[:, 0]) / (FALL * self.reach)) ** 2)

    def away(self, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Distance (M,) [m] of points (M, 3) [m] from the object in frame interval `frame`, 0 on it, and the distance's gradient (M, 3)."""
        distance, index = self._nearest(points, frame, 1)
        beyond = self._beyond(distance[:, 0])
        outwards = (points - self.origin - self.points[frame].astype(np.float64)[index[:, 0]]) / np.maximum(distance, NEAREST)
        return beyond, np.where(beyond[:, None] > 0.0, outwards, 0.0)

    def _nearest(self, points: np.ndarray, frame: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Distances (M, count) [m] to the nearest support points, the nearest first, and their indices."""
        if frame not in self._trees:
            self._trees[frame] = cKDTree(self.points[frame].astype(np.float64))
        # Squared distances beyond 1e150 overflow, and the tree then finds no point.
        distance, index = self._trees[frame].query(np.clip(points, -FAR, FAR) - self.origin, k=count)
        return distance.reshape(len(points), count), index.reshape(len(points), count)

    def _beyond(self, distance: np.ndarray) -> np.ndarray:
        """Distance outside the object, from the distance to the nearest support point: the object fills the gaps between these points."""
        return np.maximum(distance - self.reach / 2, 0.0)

    def tensors(self) -> dict[str, np.ndarray]:
        """The arrays that the field's file must hold; `reach` is stored as metadata."""
        return {"confidence.points": self.points, "confidence.value": self.value, "confidence.origin": self.origin}

    @classmethod
    def from_file(cls, tensors: dict[str, np.ndarray], metadata: dict[str, str]) -> Self:
        """The map from a field's file. Raises KeyError or ValueError for what is missing or does not fit."""
        origin = tensors.get("confidence.origin", ZERO)  # files of version 1 have none
        return cls(tensors["confidence.points"], tensors["confidence.value"], float(metadata["reach"]), origin)


def confidence_map(recovery: Recovery, particles: Particles) -> ConfidenceMap:
    """Confidence of a recovery's force, with at most `SUPPORTS` of the particles as support points."""
    frames, count = recovery.deviation.shape[:2]
    x = recovery.x[:frames]
    chosen = farthest_points(x[0], min(SUPPORTS, count))
    squared = (recovery.force_density**2).sum(axis=-1)
    signal = 0.5 * (squared + squared.mean())
    value = signal / (signal + (recovery.deviation**2).sum(axis=-1) + np.finfo(float).tiny)
    # support points are sparser than particles, so the reach must cover the gaps between them
    gap = float(cKDTree(x[0][chosen]).query(x[0])[0].max())
    origin = x[0].mean(axis=0)
    return ConfidenceMap(x[:, chosen] - origin, value[:, chosen], 2 * max(particles.spacing, gap), origin)


def farthest_points(x: np.ndarray, count: int) -> np.ndarray:
    """Indices (count,) of points spread evenly over the points x (N, 3), chosen greedily: each is the farthest from those before."""
    chosen = np.zeros(count, dtype=np.int64)
    distance = np.full(len(x), np.inf)
    for k in range(1, count):
        distance = np.minimum(distance, ((x - x[chosen[k - 1]]) ** 2).sum(axis=1))
        chosen[k] = distance.argmax()
    return chosen
