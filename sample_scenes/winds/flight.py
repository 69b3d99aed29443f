"""A rigid plate that flies in a known wind, integrated by SciPy's Runge-Kutta: nothing of the engine takes part."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from winds import FPS, FRAMES, Flight, Wind

AIR, NORMAL, TANGENTIAL = 1.2, 1.17, 0.05
"""Density of air [kg/m³], and the coefficients of the drag law (docs/reference/wind.md)."""
TILES = 8
"""Along the longest side, over which the drag is summed."""


def flown(flight: Flight, wind: Wind) -> np.ndarray:
    """Where the plate's particles are in every frame: (FRAMES + 1, N, 3) [m]."""
    size = flight.spacing * np.array(flight.counts)
    places, facing, area = _tiles(size)
    mass = flight.areal_density * size[0] * size[1]
    inertia = mass / 12.0 * ((size**2).sum() - size**2)

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        R, v, spin = state[3:12].reshape(3, 3), state[12:15], state[15:]
        offset, normal = places @ R.T, facing @ R.T
        w = wind(state[:3] + offset, t) - v - np.cross(spin, offset)
        through = (w * normal).sum(axis=1, keepdims=True)
        pressed = NORMAL * np.minimum(through, 0.0) * normal + 0.5 * TANGENTIAL * (w - through * normal)
        force = 0.5 * AIR * area[:, None] * np.linalg.norm(w, axis=1, keepdims=True) * pressed
        own = R.T @ spin
        turn = R @ ((R.T @ np.cross(offset, force).sum(axis=0) - np.cross(own, inertia * own)) / inertia)
        return np.concatenate([v, np.cross(spin, R.T).T.ravel(), force.sum(axis=0) / mass + flight.gravity, turn])

    first = np.concatenate([flight.place, _rotation(np.array(flight.tilt)).ravel(), flight.velocity, flight.spin])
    times = np.arange(FRAMES + 1) / FPS
    states = solve_ivp(slope, (0.0, times[-1]), first, t_eval=times, rtol=1e-6, atol=1e-8).y.T
    axes = [flight.spacing * (np.arange(count) - 0.5 * (count - 1)) for count in flight.counts]
    rest = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return states[:, None, :3] + np.einsum("tij,nj->tni", states[:, 3:12].reshape(-1, 3, 3), rest)


def _tiles(size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of all six sides: centres (M, 3) [m], outward normals (M, 3), areas (M,) [m²]."""
    parts = []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        across = [max(2, round(TILES * size[other] / size.max())) for other in others]
        grid = np.meshgrid(*((np.arange(count) + 0.5) / count - 0.5 for count in across), indexing="ij")
        for sign in (-1.0, 1.0):
            centre = np.full((grid[0].size, 3), 0.5 * sign * size[axis])
            centre[:, others] = np.stack([g.ravel() for g in grid], axis=1) * size[others]
            normal = np.broadcast_to(sign * np.eye(3)[axis], centre.shape)
            parts.append((centre, normal, np.full(len(centre), size[others].prod() / len(centre))))
    centres, normals, areas = (np.concatenate(each) for each in zip(*parts, strict=True))
    return centres, normals, areas


def _rotation(vector: np.ndarray) -> np.ndarray:
    """(3, 3) of a rotation vector, by Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-12)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
