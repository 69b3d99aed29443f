"""Six force fields of different kinds, as accelerations a(x, t) = f / rho [m/s²] at points x (M, 3) [m] and time t [s]."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Field = Callable[[np.ndarray, float], np.ndarray]
STEP = 1e-5
"""Step of the finite differences for the gradient [m]."""


def breeze(x: np.ndarray, t: float) -> np.ndarray:
    """A wind that rises and falls, and changes direction over lengths of a metre."""
    wave = np.sin(6.0 * x[:, 0] + 4.0 * x[:, 2] - 3.0 * t)
    swell = np.sin(2 * np.pi * 1.1 * t)
    return np.stack([2.2 * swell + 0.9 * wave, 0.6 * np.cos(5.0 * t) + 0.4 * wave, 0.8 * np.cos(7.0 * x[:, 0] + 4.0 * t)], axis=1)


def front(x: np.ndarray, t: float) -> np.ndarray:
    """A gust whose front passes over the body from left to right, lifting as it goes."""
    inside = 0.5 * (1.0 + np.tanh((1.2 * t - 0.25 - x[:, 0]) / 0.12))
    return np.stack([-1.0 + 3.0 * inside, 0.6 - 0.9 * inside, 0.9 + 0.8 * np.sin(6.0 * x[:, 2] + 3.0 * t)], axis=1)


def swirl(x: np.ndarray, t: float) -> np.ndarray:
    """Air that rotates about a vertical axis beside the body, first one way and then the other."""
    turn, r = 7.0 * np.sin(2 * np.pi * 0.9 * t + 0.6), x - np.array([0.08, 0.1, 0.0])
    decay = np.exp(-(r[:, 0] ** 2 + r[:, 1] ** 2) / 0.35**2)
    return np.stack([-turn * r[:, 1] * decay + 0.5, turn * r[:, 0] * decay, 0.5 * np.sin(5.0 * x[:, 2] + 2.0 * t)], axis=1)


def shear(x: np.ndarray, t: float) -> np.ndarray:
    """A wind that increases with height and turns with time."""
    angle = 2.2 * t
    strength = 1.4 + 4.0 * x[:, 2]
    return np.stack([strength * np.cos(angle), 0.7 * strength * np.sin(angle), 0.7 * np.cos(3.0 * t) + 1.5 * x[:, 0]], axis=1)


def squeeze(x: np.ndarray, t: float) -> np.ndarray:
    """Compression along X and extension along Z, with a drift."""
    press = 6.0 + 5.0 * np.sin(2 * np.pi * 1.2 * t)
    return np.stack([1.2 - press * x[:, 0], 0.5 + 0.5 * press * x[:, 1], 0.8 * np.cos(4.0 * t) + 0.6 * press * x[:, 2]], axis=1)


def waves(x: np.ndarray, t: float) -> np.ndarray:
    """Two waves shorter than the body, running through each other, on a mean wind."""
    one, two = np.sin(13.0 * x[:, 0] - 4.0 * t), np.sin(10.0 * x[:, 2] + 6.0 * x[:, 0] + 3.0 * t + 1.0)
    return np.stack([1.2 + 0.7 * two, 0.5 * one, 1.0 + 1.4 * one + 0.4 * two], axis=1)


FIELDS: dict[str, Field] = {"breeze": breeze, "front": front, "swirl": swirl, "shear": shear, "squeeze": squeeze, "waves": waves}


def gradient(field: Field, x: np.ndarray, t: float) -> np.ndarray:
    """d a_i / d x_j (M, 3, 3) [1/s²]."""
    return np.stack([(field(x + STEP * e, t) - field(x - STEP * e, t)) / (2.0 * STEP) for e in np.eye(3)], axis=2)
