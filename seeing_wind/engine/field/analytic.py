"""Known force fields in closed form with exact gradients, for sample scenes, tests and comparison.

A field is a uniform part plus plane waves, each with its own amplitude in every frame:

    f(x, t) = u_t + sum_j a_tj sin(k_j . x + p_j)
"""

from __future__ import annotations

from typing import Self

import numpy as np

from .force_field import ForceField


class ForceFieldAnalytic(ForceField):
    """Uniform part plus plane waves.

    Args:
        box, fps, frames: as in `ForceField`.
        uniform: (T, 3) [N/m³].
        wave_vector: (J, 3) [rad/m].
        phase: (J,) [rad].
        amplitude: (T, J, 3) [N/m³].
    """

    representation = "analytic"

    def __init__(
        self,
        box: np.ndarray,
        fps: float,
        frames: int,
        uniform: np.ndarray,
        wave_vector: np.ndarray,
        phase: np.ndarray,
        amplitude: np.ndarray,
    ) -> None:
        super().__init__(box, fps, frames)
        self.uniform, self.wave_vector = np.asarray(uniform, dtype=np.float64), np.asarray(wave_vector, dtype=np.float64)
        self.phase, self.amplitude = np.asarray(phase, dtype=np.float64), np.asarray(amplitude, dtype=np.float64)
        waves = len(self.phase)
        shapes = (self.uniform.shape, self.wave_vector.shape, self.phase.shape, self.amplitude.shape)
        if shapes != ((self.frames, 3), (waves, 3), (waves,), (self.frames, waves, 3)):
            raise ValueError(f"uniform, wave_vector, phase and amplitude have shapes {shapes}, which do not fit {self.frames} frames")

    def _force(self, points: np.ndarray, frame: int) -> np.ndarray:
        return self.uniform[frame] + np.sin(points @ self.wave_vector.T + self.phase) @ self.amplitude[frame]

    def _gradient(self, points: np.ndarray, frame: int) -> np.ndarray:
        slope = np.cos(points @ self.wave_vector.T + self.phase)
        return np.einsum("mj,ji,jk->mik", slope, self.amplitude[frame], self.wave_vector)

    def _tensors(self) -> dict[str, np.ndarray]:
        return {"uniform": self.uniform, "wave_vector": self.wave_vector, "phase": self.phase, "amplitude": self.amplitude}

    @classmethod
    def from_file(cls, tensors: dict[str, np.ndarray], metadata: dict[str, str], box: np.ndarray, fps: float, frames: int) -> Self:
        return cls(box, fps, frames, *(tensors[key] for key in ("uniform", "wave_vector", "phase", "amplitude")))
