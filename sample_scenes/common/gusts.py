"""Gusts as the air near the ground has them."""

from __future__ import annotations

import numpy as np


def turbulence(t: np.ndarray, rng: np.random.Generator, count: int = 12, scale: float = 0.3) -> np.ndarray:
    """(T,) of unit variance at the times `t` [s]: waves of 0.1 to 4 Hz with von Kármán's spectrum (1 + 70.8 (f scale)²)^(-5/6), whose
    integral time scale is `scale` [s]. A single tone would not do: near a body's own frequency it cannot be told from its ringing."""
    edges = np.geomspace(0.1, 4.0, count + 1)
    f = edges[:-1] * (edges[1:] / edges[:-1]) ** rng.uniform(size=count)
    power = (1.0 + 70.8 * (f * scale) ** 2) ** (-5.0 / 6.0) * np.diff(edges)
    waves = np.cos(2.0 * np.pi * (f[:, None] * t + rng.uniform(size=(count, 1))))
    return np.sqrt(2.0 * power / power.sum()) @ waves
