"""A field as values on a lattice: the form that a field object in Blender carries when its take is not available."""

from __future__ import annotations

from typing import Self

import numpy as np

from ..force_field import ForceField
from ..trilinear import slope_at, value_at


class ForceFieldLattice(ForceField):
    """Linear between the nodes of a lattice that fills the box.

    Args:
        box, fps, frames: as in `ForceField`.
        force: (N, A, B, C, 3) [N/m³], two nodes or more along each axis.
        row: (T,) which of the N lattices acts in each frame; a wind that repeats itself is stored only once.
    """

    representation = "lattice"

    def __init__(self, box: np.ndarray, fps: float, frames: int, force: np.ndarray, row: np.ndarray) -> None:
        super().__init__(box, fps, frames)
        self.force, self.row = np.asarray(force), np.asarray(row)
        if self.force.ndim != 5 or self.force.shape[4] != 3 or min(self.force.shape[1:4]) < 2 or self.row.shape != (self.frames,):
            raise ValueError(f"force and row have shapes {self.force.shape} and {self.row.shape}, for {self.frames} frames")
        if not np.issubdtype(self.row.dtype, np.integer) or self.row.min() < 0 or self.row.max() >= len(self.force):
            raise ValueError(f"row refers to lattices other than the {len(self.force)} that there are")

    def _force(self, points: np.ndarray, frame: int) -> np.ndarray:
        return value_at(self.force[self.row[frame]], self.box, points)

    def _gradient(self, points: np.ndarray, frame: int) -> np.ndarray:
        return slope_at(self.force[self.row[frame]], self.box, points)

    def _tensors(self) -> dict[str, np.ndarray]:
        return {"force": self.force, "row": self.row}

    @classmethod
    def from_file(cls, tensors: dict[str, np.ndarray], metadata: dict[str, str], box: np.ndarray, fps: float, frames: int) -> Self:
        return cls(box, fps, frames, tensors["force"], tensors["row"])
