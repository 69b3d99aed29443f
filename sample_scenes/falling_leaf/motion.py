"""The leaf's flight: particles in the known wind, moved by the engine's own solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from leaf import Leaf
from outlines import inside
from wind import Wind

from seeing_wind.engine.conventions import GRAVITY
from seeing_wind.engine.field.analytic import ForceFieldAnalytic
from seeing_wind.engine.materials import Material, adjust, find
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import advance
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.observe.object.motion.control import attach
from seeing_wind.engine.records import Particles

MATERIAL = "leaf"
DENSITY = 400.0
"""kg/m³, between a fresh and a dry leaf."""
THICKNESS = 0.012
"""Metres: forty times a real leaf's, so that particles fit in."""
YOUNGS_MODULUS = 2.0e4
"""Pa. A plate's stiffness against bending per mass goes as E h² / rho: at forty times the thickness 2e4 Pa do what 3e7 Pa do in a leaf."""
START = (0.0, 0.0, 1.6)
"""Where the blade's middle is in frame 0 [m]."""
ROLL = 0.5
"""How far the tip leans to the left in frame 0 [rad]; the leaf faces the camera."""


@dataclass(frozen=True)
class Flight:
    """What the simulation gave, for the clip and (particles, forces) for the report alone."""

    particles: Particles
    material: Material
    wind: ForceFieldAnalytic
    x: np.ndarray
    """(T+1, N, 3) [m]."""
    v: np.ndarray
    """(T+1, N, 3) [m/s]."""
    acceleration: np.ndarray
    """(T, N, 3) of the wind, f / rho at x[t] [m/s²]."""
    surface: np.ndarray
    """(T+1, V, 3) the side of the leaf that faces the camera [m]."""


def leaf_material() -> Material:
    """The library's leaf with the numbers above."""
    return adjust(find(MATERIAL), density=DENSITY, youngs_modulus=YOUNGS_MODULUS)


def leaf_particles(leaf: Leaf, spacing: float) -> Particles:
    """Particles on a square lattice inside the leaf's outline, in as many layers as the thickness holds, placed as in frame 0."""
    low, high = leaf.outline.min(0), leaf.outline.max(0)
    axes = [(np.arange(np.floor(low[c] / spacing), np.ceil(high[c] / spacing)) + 0.5) * spacing for c in range(2)]
    flat = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    flat = flat[inside(leaf.outline, flat)]
    layers = max(round(THICKNESS / spacing), 1)
    depth = (np.arange(layers) + 0.5) * THICKNESS / layers - THICKNESS / 2
    x = np.concatenate([place(flat, y) for y in depth])
    volume = np.full(len(x), spacing**2 * THICKNESS / layers)
    return Particles(x=x, volume=volume, pinned=np.zeros(len(x), dtype=bool), spacing=spacing)


def place(flat: np.ndarray, depth: float) -> np.ndarray:
    """Leaf coordinates (M, 2) at `depth` behind the middle plane -> world (M, 3) in frame 0."""
    c, s = np.cos(ROLL), np.sin(ROLL)
    return np.stack([c * flat[:, 0] - s * flat[:, 1], np.full(len(flat), depth), s * flat[:, 0] + c * flat[:, 1]], 1) + START


def fly(leaf: Leaf, seed: int, fps: float, frames: int, spacing: float = 0.006) -> Flight:
    """Let the leaf go, at rest, in the wind of `seed` and in gravity."""
    particles, material = leaf_particles(leaf, spacing), leaf_material()
    wind = Wind(seed, particles.x.mean(0), material.density, fps, frames)
    model, _ = model_for(particles, material, fps, gravity=GRAVITY)
    state = State.at_rest(particles.x)
    x, v, acceleration = [state.x], [state.v], []
    for t in range(frames):
        wind.carry(t, state.x.mean(0))
        a = wind.field.sample(state.x, t)[0] / material.density
        state = advance(model, state, a, wind.field.gradient(state.x, t) / material.density, frame=t)
        acceleration.append(a)
        x.append(state.x)
        v.append(state.v)
    surface = attach(place(leaf.vertices, -THICKNESS / 2), particles.x).follow(np.stack(x))
    return Flight(particles, material, wind.field, np.stack(x), np.stack(v), np.stack(acceleration), surface)


def tilt(x: np.ndarray) -> np.ndarray:
    """(T+1,) angle [degrees] between the leaf's normal and the camera's view axis, from its particles' best plane (x is (T+1, N, 3))."""
    angles = []
    for frame in x:
        normal = np.linalg.svd(frame - frame.mean(0), full_matrices=False)[2][2]
        angles.append(np.degrees(np.arccos(min(abs(normal[1]), 1.0))))
    return np.array(angles)
