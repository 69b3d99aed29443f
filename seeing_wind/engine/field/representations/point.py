"""Point forces: one vector per particle and frame, no field between them. A comparison, Table 2."""

from __future__ import annotations

from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from ..confidence import ConfidenceMap
from ..force_field import ForceField


class ForceFieldPoint(ForceField):
    """Every query returns the force of the particle nearest in that frame; the gradient is zero.

    Args:
        box, fps, frames: as in `ForceField`.
        x: (T, N, 3) particle positions [m].
        force_density: (T, N, 3) [N/m³].
        confidence: where the field can be trusted.
    """

    representation = "point"

    def __init__(
        self, box: np.ndarray, fps: float, frames: int, x: np.ndarray, force_density: np.ndarray, confidence: ConfidenceMap
    ) -> None:
        super().__init__(box, fps, frames)
        self.x, self.force_density, self.confidence = np.asarray(x, np.float64), np.asarray(force_density, np.float64), confidence
        if self.x.shape != self.force_density.shape or self.x.ndim != 3 or len(self.x) != self.frames or not self.x.size:
            raise ValueError(f"positions {self.x.shape} and forces {self.force_density.shape} do not fit {self.frames} frames")

    def _force(self, points: np.ndarray, frame: int) -> np.ndarray:
        return self.force_density[frame][cKDTree(self.x[frame]).query(points)[1]]

    def _gradient(self, points: np.ndarray, frame: int) -> np.ndarray:
        return np.zeros((len(points), 3, 3))

    def _tensors(self) -> dict[str, np.ndarray]:
        return {"x": self.x, "force_density": self.force_density}

    @classmethod
    def from_file(cls, tensors: dict[str, np.ndarray], metadata: dict[str, str], box: np.ndarray, fps: float, frames: int) -> Self:
        confidence = ConfidenceMap.from_file(tensors, metadata)
        return cls(box, fps, frames, tensors["x"], tensors["force_density"], confidence)
