"""A known wind in gusts, for benchmarks and tests."""

from __future__ import annotations

import numpy as np

from seeing_wind.engine.field import ForceFieldAnalytic

UNIFORM_SHARE = 0.4
"""Share of the added variance that is uniform in space."""
WAVES = 6
"""J, number of waves."""
COSINES = 5
"""Number of cosines whose sum is the strength of a wave."""


class GustField(ForceFieldAnalytic):
    """A seeded wind: a mean that rises and falls, and divergence-free waves in space whose strengths vary smoothly in time.

    The variation is a sum of cosines of continuous time, so the wind at a given second depends neither on the clip's length nor on its
    frame rate. Waves are transverse (amplitude at right angles to the wave vector), as air is nearly incompressible.

    Args:
        seed: the same seed gives the same wind.
        box, fps, frames: as in `ForceField`.
        mean: (3,) mean force density [N/m³], for example an updraft that holds a leaf against gravity.
        strength: root mean square over space and time of what is added to the mean [N/m³].
        wavelength: typical wavelength [m]. Near the body's size the field is curved across it.
        period: typical time in which a gust comes and goes [s].
    """

    def __init__(
        self, seed: int, box: np.ndarray, fps: float, frames: int, mean: np.ndarray, strength: float, *, wavelength: float, period: float
    ) -> None:
        random = np.random.default_rng(seed)
        direction = _unit(random.normal(size=(WAVES, 3)))
        wave_vector = direction * (2 * np.pi / wavelength) / random.uniform(0.75, 1.35, (WAVES, 1))
        phase = random.uniform(0, 2 * np.pi, WAVES)
        seconds = np.arange(frames) / fps
        across = _unit(np.cross(direction, random.normal(size=(WAVES, 3))))
        # a transverse wave of unit amplitude has mean square 1/2, and J of them share the variance
        wave_size = strength * np.sqrt((1 - UNIFORM_SHARE) * 2 / WAVES)
        amplitude = wave_size * _wander(random, seconds, period, WAVES)[:, :, None] * across
        uniform = np.asarray(mean, dtype=np.float64) + strength * np.sqrt(UNIFORM_SHARE / 3) * _wander(random, seconds, period, 3)
        super().__init__(box, fps, frames, uniform, wave_vector, phase, amplitude)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _wander(random: np.random.Generator, seconds: np.ndarray, period: float, channels: int) -> np.ndarray:
    """Smooth random curves (T, channels) of unit mean square over long times."""
    frequency = 2 * np.pi / period * random.uniform(0.3, 1.2, (channels, COSINES))
    offset = random.uniform(0, 2 * np.pi, (channels, COSINES))
    return np.sqrt(2 / COSINES) * np.cos(seconds[:, None, None] * frequency + offset).sum(axis=-1)
