"""Small bodies that the engine's own solver moves by known winds, for the recovery to find."""

import numpy as np

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import advance
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.records import Attachment, Camera, Particles, PointTargets
from seeing_wind.engine.settings import RecoverSettings

RUBBER = Material("rubber", "neo_hookean", density=400.0, youngs_modulus=5e3, poisson_ratio=0.3)
FPS = 30.0
WEIGHTLESS = RecoverSettings(gravity=(0.0, 0.0, 0.0))


def plate(shape=(8, 5, 2), spacing=0.02, pinned=None):
    axes = [(np.arange(n) - (n - 1) / 2) * spacing for n in shape]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    held = np.zeros(len(x), bool) if pinned is None else pinned(x)
    return Particles(x, np.full(len(x), spacing**3), held, spacing)


def every(particles):
    return Attachment(np.arange(len(particles.x), dtype=np.int32)[:, None], np.ones((len(particles.x), 1)))


def blow(body, wind, frames, gravity=(0.0, 0.0, 0.0), velocity=None, spin=None, material=RUBBER):
    """Trajectory x (T+1, N, 3) under wind(X, t) [m/s²] of rest positions, and the wind at the particles (T, N, 3)."""
    model, _ = model_for(body, material, FPS, gravity=gravity)
    state, xs, winds = State.at_rest(body.x, velocity, spin), [body.x], []
    for t in range(frames):
        slope = np.stack([(wind(body.x + 1e-5 * e, t) - wind(body.x - 1e-5 * e, t)) / 2e-5 for e in np.eye(3)], axis=-1)
        winds.append(wind(body.x, t))
        state = advance(model, state, winds[-1], slope @ np.linalg.inv(state.F))
        xs.append(state.x)
    return np.stack(xs), np.stack(winds)


def points(body, x):
    return PointTargets(x, np.ones(x.shape[:2], bool), every(body))


def relative(got, want):
    return np.sqrt(((got - want) ** 2).mean() / (want**2).mean())


def camera():
    return Camera(640, 360, 700.0, 700.0, 319.5, 179.5, front_view(1.5))
