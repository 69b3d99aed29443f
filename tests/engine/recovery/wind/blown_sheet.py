"""A small flag, or a released sheet, in a varying wind: moved by our solver with short substeps, with an independent code for the drag."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from seeing_wind.engine.materials import Sheet
from seeing_wind.engine.mpm.shell import advance, at_rest, shell_of

FPS, FRAMES, SUBSTEPS = 24.0, 14, 8
GRAVITY = np.array([0.0, 0.0, -9.81])
E, THICKNESS, AREAL = 2e6, 4e-4, 0.1


def mesh(columns: int = 8, rows: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """An upright rectangle of 0.8 m x 0.5 m."""
    u, w = np.meshgrid(np.linspace(0.0, 0.8, columns + 1), np.linspace(0.0, 0.5, rows + 1), indexing="ij")
    index = np.arange(u.size).reshape(u.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.stack([u.ravel(), np.zeros(u.size), w.ravel()], 1), faces


def wind(x: np.ndarray, time: float) -> np.ndarray:
    """u (V, 3) [m/s]."""
    u = np.broadcast_to([3.0, 2.0, 0.3], x.shape).copy()
    u[:, 0] += np.sin(5.0 * time) + 1.2 * x[:, 2] * np.cos(3.0 * time)
    u[:, 1] += 1.5 * np.sin(3.8 * time + 1.0) + 1.5 * np.sin(3.9 * x[:, 0] - 4.4 * time)
    u[:, 2] += 0.6 * np.cos(3.1 * time)
    return u


def quick_gusts(x: np.ndarray, time: float) -> np.ndarray:
    """u (V, 3) [m/s] that comes and goes within five or six frames."""
    u = np.zeros(x.shape)
    u[:, 0] = 1.0 + 1.2 * np.sin(28.0 * time + x[:, 2])
    u[:, 1] = 0.8 * np.cos(23.0 * time + x[:, 0])
    return u


def drag(u: np.ndarray, x: np.ndarray, v: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The law as docs/reference/wind.md states it, face by face."""
    force = np.zeros_like(x)
    for face in faces:
        n = 0.5 * np.cross(x[face[1]] - x[face[0]], x[face[2]] - x[face[0]])
        area = np.linalg.norm(n)
        n = n / area
        w = (u[face] - v[face]).mean(axis=0)
        across = (w @ n) * n
        force[face] += 0.5 * 1.2 * area * np.linalg.norm(w) * (1.17 * across + 0.05 * (w - across)) / 3.0
    return force


def blown(
    noise: float = 0.0, held: bool = True, air: Callable[[np.ndarray, float], np.ndarray] = wind
) -> dict[str, np.ndarray]:
    """The arrays of a trajectory file, with the true wind (T, V, 3) [m/s] in the middle of each frame."""
    x, faces = mesh()
    fixed = (x[:, 0] < 1e-9) & held
    shell = shell_of(x, faces, Sheet(AREAL, THICKNESS, E * THICKNESS, E * THICKNESS**3 / 12.0, 0.1), pinned=fixed)
    dt = 1.0 / (FPS * SUBSTEPS)
    state, path, winds = at_rest(shell, acceleration=np.broadcast_to(GRAVITY, x.shape), dt=dt), [x], []
    for number in range(FRAMES * SUBSTEPS):
        u = air(state.x, (number + 0.5) * dt)
        if number % SUBSTEPS == SUBSTEPS // 2:
            winds.append(u)
        state, _ = advance(shell, state, dt=dt, gravity=GRAVITY, load=lambda now, v, frame, u=u: (drag(u, now, v, faces), None))
        if (number + 1) % SUBSTEPS == 0:
            path.append(state.x)
    seen = np.stack(path) + noise * np.random.default_rng(0).normal(size=(FRAMES + 1, *x.shape))
    return {
        "x": seen, "faces": faces, "fixed": fixed, "fps": np.array(FPS), "gravity": GRAVITY, "areal_density": np.array(AREAL),
        "thickness": np.array(THICKNESS), "E": np.array(E), "nu": np.array(0.3), "damping": np.array(0.1), "wind": np.stack(winds),
    }  # fmt: skip
