"""A plate that the wind blows along, by the closed form of its motion, in the form of a recovery.

Across the wind, from rest and without gravity, it reaches v(t) = u (1 - 1 / (1 + k u t)) with k = rho C_n / (2 m''), m'' its mass per area.
"""

from __future__ import annotations

import numpy as np

from seeing_wind.engine.materials import Material
from seeing_wind.engine.records import Outcome, Particles, Recovery

SPACING, LAYERS, FPS, FRAMES = 0.01, 2, 30.0, 10
AREAL_DENSITY, SPEED = 0.4, 6.0
DENSITY = AREAL_DENSITY / (LAYERS * SPACING)


def plate_particles() -> Particles:
    axes = [SPACING * (np.arange(count) - 0.5 * (count - 1)) for count in (20, 16, LAYERS)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return Particles(x, np.full(len(x), SPACING**3), np.zeros(len(x), bool), SPACING)


def travelled(
    t: np.ndarray | float, areal_density: float = AREAL_DENSITY, speed: float = SPEED, coefficient: float = 1.17
) -> np.ndarray | float:
    """Distance [m] travelled after t seconds: the integral of the closed form."""
    k = 1.2 * coefficient / (2.0 * areal_density)
    return speed * t - np.log1p(k * speed * t) / k


def blown_plate() -> tuple[Recovery, Particles, Material]:
    """Along Z, its normal."""
    particles = plate_particles()
    k, t = 1.2 * 1.17 / (2.0 * AREAL_DENSITY), np.arange(FRAMES + 1) / FPS
    velocity = SPEED * (1.0 - 1.0 / (1.0 + k * SPEED * t))
    force = np.zeros((FRAMES, len(particles.x), 3))
    force[..., 2] = DENSITY * FPS * np.diff(velocity)[:, None]
    x = particles.x + np.stack([0.0 * t, 0.0 * t, travelled(t)], axis=1)[:, None]
    F = np.tile(np.eye(3), (FRAMES + 1, len(particles.x), 1, 1))
    deviation = np.full(force.shape, 0.02 * DENSITY)
    recovery = Recovery(Outcome.CONVERGED, force, deviation, x, F, np.zeros_like(particles.x), np.zeros(FRAMES + 1), "m", 1, 1.0)
    return recovery, particles, Material("plate", "corotated", DENSITY, 1e5, 0.3, source="test")
