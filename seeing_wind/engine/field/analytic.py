"""Known force fields in closed form, for sample scenes, tests and comparison: uniform, and gusts with exact gradients.

A field is a uniform part plus plane waves, each with its own strength in every frame:

    f(x, t) = u_t + sum_j a_tj sin(k_j . x + p_j)
"""

from __future__ import annotations

from typing import Self

import numpy as np

from ..errors import UsageError
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
        field = cls.__new__(cls)
        ForceFieldAnalytic.__init__(field, box, fps, frames, *(tensors[key] for key in ("uniform", "wave_vector", "phase", "amplitude")))
        return field


class UniformField(ForceFieldAnalytic):
    """The same force everywhere: (3,) for all frames or (T, 3), N/m³."""

    def __init__(self, box: np.ndarray, fps: float, frames: int, force_density: np.ndarray) -> None:
        uniform = np.broadcast_to(np.asarray(force_density, dtype=np.float64), (frames, 3))
        super().__init__(box, fps, frames, uniform, np.zeros((0, 3)), np.zeros(0), np.zeros((frames, 0, 3)))


class GustField(ForceFieldAnalytic):
    """A seeded wind: a mean that swells and sinks, and divergence-free waves in space whose strengths wander smoothly in time.

    The wander is a sum of cosines of continuous time, so the wind at a given second depends neither on the clip's length nor on its
    frame rate. Waves are transverse (amplitude at right angles to the wave vector), as air is nearly incompressible.

    Args:
        seed: the same seed gives the same wind.
        box, fps, frames: as in `ForceField`.
        mean: (3,) mean force density [N/m³], for example an updraft that holds a leaf against gravity.
        strength: root mean square over space and time of what is added to the mean [N/m³].
        wavelength: typical wavelength [m]; None takes half of the box's longest side. Near the body's size the field is curved across it.
        period: typical time in which a gust comes and goes [s].
        uniform_share: part of the added variance that is the same everywhere, 0..1.
        waves: J, how many waves.

    Raises:
        UsageError: for a negative strength, or a wavelength or period that is not positive.
    """

    def __init__(
        self,
        seed: int,
        box: np.ndarray,
        fps: float,
        frames: int,
        mean: np.ndarray,
        strength: float,
        *,
        wavelength: float | None = None,
        period: float = 0.8,
        uniform_share: float = 0.4,
        waves: int = 6,
    ) -> None:
        random = np.random.default_rng(seed)
        corners = np.asarray(box, dtype=np.float64)
        wavelength = float((corners[1] - corners[0]).max()) / 2 if wavelength is None else float(wavelength)
        if strength < 0 or wavelength <= 0 or period <= 0 or not 0 <= uniform_share <= 1:
            raise UsageError("A gust field needs strength >= 0, wavelength > 0, period > 0 and a uniform share in 0..1.")
        direction = _unit(random.normal(size=(waves, 3)))
        wave_vector = direction * (2 * np.pi / wavelength) / random.uniform(0.75, 1.35, (waves, 1))
        phase = random.uniform(0, 2 * np.pi, waves)
        seconds = np.arange(frames) / fps
        across = _unit(np.cross(direction, random.normal(size=(waves, 3))))
        # a transverse wave of unit amplitude has mean square 1/2, and J of them share the variance
        wave_size = strength * np.sqrt((1 - uniform_share) * 2 / max(waves, 1))
        amplitude = wave_size * _wander(random, seconds, period, waves)[:, :, None] * across
        uniform = np.asarray(mean, dtype=np.float64) + strength * np.sqrt(uniform_share / 3) * _wander(random, seconds, period, 3)
        super().__init__(corners, fps, frames, uniform, wave_vector, phase, amplitude)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _wander(random: np.random.Generator, seconds: np.ndarray, period: float, channels: int) -> np.ndarray:
    """Smooth random curves (T, channels) of unit mean square over long times."""
    cosines = 5
    frequency = 2 * np.pi / period * random.uniform(0.3, 1.2, (channels, cosines))
    offset = random.uniform(0, 2 * np.pi, (channels, cosines))
    return np.sqrt(2 / cosines) * np.cos(seconds[:, None, None] * frequency + offset).sum(axis=-1)
