"""Known fields to test with."""

from __future__ import annotations

import numpy as np

from seeing_wind.engine.field import ForceFieldAnalytic


class UniformField(ForceFieldAnalytic):
    """The same force everywhere: (3,) for all frames or (T, 3), N/m³."""

    def __init__(self, box: np.ndarray, fps: float, frames: int, force_density: np.ndarray) -> None:
        uniform = np.broadcast_to(np.asarray(force_density, dtype=np.float64), (frames, 3))
        super().__init__(box, fps, frames, uniform, np.zeros((0, 3)), np.zeros(0), np.zeros((frames, 0, 3)))
