"""The wind that moves the leaf: known in closed form, changing in space and time, seeded.

Four parts, as accelerations a = f / rho of a body of density rho [m/s²]:
an updraft that leaves little of gravity; gusts to the side that come and go; an eddy that turns the leaf to and fro in the frame's
plane; ripples at right angles to the frame, shorter than the leaf, that bend and tilt it. Eddy and ripples travel with the leaf, as
those do that a falling leaf sheds, and are transverse waves, so that they are free of divergence, as air is.
"""

from __future__ import annotations

import numpy as np

from seeing_wind.engine.field.analytic import ForceFieldAnalytic

SINK = 0.45
"""What gravity keeps over the updraft [m/s²]: half a metre in a second and a half."""
EDDY_WAVELENGTH = 0.9
"""[m]; longer than the leaf, so that the leaf mostly turns in it, and short enough to be curved across it."""
EDDY = 72.0
"""Amplitude of the eddy's angular acceleration [rad/s²]."""
EDDY_PERIOD = 0.6
"""In this time the eddy turns one way and back [s]."""
RIPPLE_WAVELENGTH = 0.45
"""[m]."""
RIPPLE = 0.8
"""Amplitude of a ripple [m/s²]."""


class Wind:
    """The wind of `seed` on a body of `density` [kg/m³] that starts at `start` (3,) [m]: a field that is complete once `carry` was called
    for every frame. Its box reaches a metre beyond the path."""

    def __init__(self, seed: int, start: np.ndarray, density: float, fps: float, frames: int) -> None:
        rng = np.random.default_rng(seed)
        t = (np.arange(frames) + 0.5) / fps

        def swing(low: float, high: float) -> np.ndarray:
            """A cosine of unit amplitude whose period lies between `low` and `high` [s]. It starts at a crest or trough, so that what it
            pushes swings to one side and back; any other phase would leave a drift."""
            return rng.choice([-1.0, 1.0]) * np.cos(2.0 * np.pi * t / rng.uniform(low, high))

        sideways = 0.45 + 2.2 * swing(0.75, 0.9) + 1.2 * swing(0.40, 0.50)
        lift = 9.81 - SINK + 1.2 * swing(0.62, 0.75)
        uniform = np.stack([sideways, 0.35 * swing(0.7, 0.9), lift], 1)

        k = 2.0 * np.pi / EDDY_WAVELENGTH
        spin = EDDY / k * swing(0.96 * EDDY_PERIOD, 1.04 * EDDY_PERIOD)
        waves = [([0.0, 0.0, k], spin[:, None] * [1.0, 0.0, 0.0], 0.0), ([k, 0.0, 0.0], spin[:, None] * [0.0, 0.0, -1.0], 0.0)]
        for direction in ([0.8, 0.0, 0.6], [-0.6, 0.0, 0.8]):
            k = 2.0 * np.pi / RIPPLE_WAVELENGTH / rng.uniform(0.85, 1.2)
            waves.append((k * np.array(direction), RIPPLE * swing(0.36, 0.5)[:, None] * [0.0, 1.0, 0.0], rng.uniform(0.6, 1.0)))
        vectors, strengths, phases = zip(*waves)
        self._vectors, self._strengths, self._phases = np.array(vectors), density * np.stack(strengths, 1), np.array(phases)

        # sin(k . (x - c) + p) = sin(k . x) cos(p - k . c) + cos(k . x) sin(p - k . c): two standing waves for each that travels.
        pairs = len(waves)
        box = np.array([start - [1.0, 1.0, 1.8], start + [1.6, 1.0, 1.0]])
        standing = np.repeat([0.0, np.pi / 2.0], pairs)
        self.field = ForceFieldAnalytic(
            box, fps, frames, density * uniform, np.tile(self._vectors, (2, 1)), standing, np.zeros((frames, 2 * pairs, 3))
        )

    def carry(self, frame: int, centre: np.ndarray) -> None:
        """Put eddy and ripples of `frame` round `centre` (3,) [m]."""
        phase = self._phases - self._vectors @ centre
        strength = self._strengths[frame]
        self.field.amplitude[frame] = np.concatenate([strength * np.cos(phase)[:, None], strength * np.sin(phase)[:, None]])
