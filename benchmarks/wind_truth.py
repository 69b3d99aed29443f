"""Rigid plates blown by known winds, by an integrator of its own, and how well the wind is recovered from their motion.

    python benchmarks/wind_truth.py [SCENE ...] [--work DIR]

The plates are rigid bodies of six degrees of freedom under the drag on their six sides, integrated by SciPy's Runge-Kutta: neither the
solver nor the drag law's code of the engine takes part. Each scene is handed to `recover-trajectories --field wind` as points in 3D. Printed per
scene: the error of the wind over the plate in size [%] and direction [degrees] as of the paper's tables, beside the best wind that is the
same everywhere and always; and the transfer: the recovered field moves a plate of twice the areal density, whose true motion is known,
once as a wind and once as a force.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from seeing_wind.engine.reading import read_arrays

AIR, NORMAL, TANGENTIAL = 1.2, 1.17, 0.05
"""Density of air [kg/m³] and the coefficients of the plates."""
SPACING, COUNTS = 0.008, (20, 15, 2)
"""Points of a plate: their distance [m], and how many along each side."""
TILES = 24
"""Per side, over which the drag is summed."""
YOUNGS_MODULUS = 2e5
"""Pa: the plates hardly bend."""

Wind = Callable[[np.ndarray, float], np.ndarray]
"""Places (M, 3) [m] and time [s] -> velocity of the air (M, 3) [m/s]."""


@dataclass(frozen=True)
class Scene:
    """A plate in a wind."""

    wind: Wind
    areal_density: float = 0.5
    """kg/m²."""
    tilt: tuple[float, float, float] = (0.4, -0.5, 0.2)
    """Rotation vector of the plate at the start [rad]; at zero its normal is Z."""
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad/s."""
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frames: int = 36
    fps: float = 30.0
    chosen_with: bool = field(default=False)
    """The settings of the inverse were chosen on this scene: no evidence for it."""


def steady(*u: float) -> Wind:
    """The same everywhere and always."""
    return lambda x, t: np.broadcast_to(np.array(u), x.shape)


def gusty(mean: tuple[float, float, float], gust: tuple[float, float, float], period: float) -> Wind:
    """A mean, and gusts of two periods."""
    along = np.array(gust)
    return lambda x, t: np.broadcast_to(
        np.array(mean) + along * (np.sin(2 * np.pi * t / period) + 0.5 * np.sin(5.1 * np.pi * t / period + 1.0)), x.shape
    )


def sheared(mean: tuple[float, float, float], slope: float, period: float) -> Wind:
    """Stronger with height, and swelling."""
    return lambda x, t: np.array(mean) * (1.0 + slope * x[:, 2:] + 0.3 * np.sin(2 * np.pi * t / period))


def vortex(mean: tuple[float, float, float], speed: float, radius: float) -> Wind:
    """A mean with a whirl about the vertical axis through (0.5, 0.2), as of a Rankine vortex with a smooth core."""

    def wind(x: np.ndarray, t: float) -> np.ndarray:
        offset = x - np.array([0.5, 0.2, 0.0])
        turned = np.stack([-offset[:, 1], offset[:, 0], np.zeros(len(x))], axis=1)
        return np.array(mean) + 2.0 * speed * radius * turned / (radius**2 + (turned**2).sum(axis=1, keepdims=True))

    return wind


SCENES = {
    "tuning": Scene(gusty((4.0, 1.0, 0.5), (1.0, -0.5, 0.4), 0.7), spin=(1.0, -2.0, 0.5), chosen_with=True),
    "steady": Scene(steady(5.0, 0.0, 1.0), tilt=(0.2, 1.2, 0.0), spin=(0.5, 1.5, -1.0)),
    "gusty": Scene(gusty((3.0, -2.0, 1.5), (1.2, 0.8, -0.8), 0.9), tilt=(-0.7, 0.6, 0.0), spin=(2.0, 2.5, 1.0)),
    "sheared": Scene(sheared((4.0, 1.5, 0.0), 1.5, 1.1), tilt=(0.3, 1.3, 0.3), spin=(-1.5, 2.0, 0.0)),
    "vortex": Scene(vortex((1.5, 0.0, 0.8), 3.0, 0.35), tilt=(0.8, 0.8, 0.0), spin=(0.0, 3.0, 1.0)),
    "falling": Scene(steady(3.0, 1.0, 2.0), areal_density=0.3, tilt=(0.3, 0.2, 0.0), gravity=(0.0, 0.0, -9.81), spin=(1.0, 1.0, 0.0)),
    "light": Scene(gusty((2.0, 1.0, 1.0), (0.8, -0.8, 0.5), 0.8), areal_density=0.12, tilt=(0.9, -0.4, 0.0), spin=(2.0, 0.5, 1.0)),
}


def rotation(vector: np.ndarray) -> np.ndarray:
    """(3, 3) of a rotation vector."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def sides() -> np.ndarray:
    """(3,) of a plate [m]."""
    return SPACING * np.array(COUNTS)


def drag(u: np.ndarray, v: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Force per area (M, 3) [Pa] of air at u (M, 3) on a side of a body at v (M, 3) with the outward unit normals (M, 3)."""
    w = u - v
    along = (w * normal).sum(axis=1, keepdims=True) * normal
    speed = np.linalg.norm(w, axis=1, keepdims=True)
    windward = (w * normal).sum(axis=1, keepdims=True) < 0.0
    return 0.5 * AIR * speed * (NORMAL * np.where(windward, along, 0.0) + 0.5 * TANGENTIAL * (w - along))


def tiles() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres (M, 3) [m] of the tiles of all six sides, their outward normals (M, 3) and areas (M,) [m²]."""
    size, centres, normals, areas = sides(), [], [], []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        across = [max(2, round(TILES * size[other] / size.max())) for other in others]
        grid = np.meshgrid(*((np.arange(count) + 0.5) / count - 0.5 for count in across), indexing="ij")
        for sign in (-1.0, 1.0):
            centre = np.zeros((grid[0].size, 3))
            centre[:, others] = np.stack([g.ravel() for g in grid], axis=1) * size[others]
            centre[:, axis] = 0.5 * sign * size[axis]
            centres.append(centre)
            normals.append(np.broadcast_to(sign * np.eye(3)[axis], centre.shape))
            areas.append(np.full(len(centre), size[others].prod() / len(centre)))
    return np.concatenate(centres), np.concatenate(normals), np.concatenate(areas)


def moved(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """The plate's points (T+1, N, 3) [m] at every picture, and the wind at them (T, N, 3) [m/s] in the middle of every frame."""
    (length, width, height), (places, facing, area) = sides(), tiles()
    mass = scene.areal_density * length * width
    inertia = mass / 12.0 * np.array([width**2 + height**2, length**2 + height**2, length**2 + width**2])

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        place, R, v, spin = state[:3], state[3:12].reshape(3, 3), state[12:15], state[15:]
        offset = places @ R.T
        force = area[:, None] * drag(scene.wind(place + offset, t), v + np.cross(spin, offset), facing @ R.T)
        torque = R.T @ np.cross(offset, force).sum(axis=0)
        own = R.T @ spin
        turn = R @ ((torque - np.cross(own, inertia * own)) / inertia)
        return np.concatenate([v, np.cross(spin, R.T).T.ravel(), force.sum(axis=0) / mass + scene.gravity, turn])

    first = np.concatenate([np.zeros(3), rotation(np.array(scene.tilt)).ravel(), scene.velocity, scene.spin])
    times = np.arange(2 * scene.frames + 1) / (2.0 * scene.fps)
    states = solve_ivp(slope, (0.0, times[-1]), first, t_eval=times, rtol=1e-7, atol=1e-9).y.T
    axes = [SPACING * (np.arange(count) - 0.5 * (count - 1)) for count in COUNTS]
    rest = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    x = states[:, None, :3] + np.einsum("tij,nj->tni", states[:, 3:12].reshape(-1, 3, 3), rest)
    winds = np.stack([scene.wind(x[k], times[k]) for k in range(1, len(times), 2)])
    return x[::2], winds
