"""Known fields, and edits simulated in them."""

from __future__ import annotations

import numpy as np

from seeing_wind.engine.field.analytic import ForceFieldAnalytic
from seeing_wind.engine.recovery.resimulate import simulate_bodies
from seeing_wind.engine.settings import BodyEdit, Edit
from tests.engine.fields import UniformField

FPS, FRAMES = 30.0, 8
BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
SOFT = {"density": 500.0, "youngs_modulus": 2e4}
WEIGHTLESS = (0.0, 0.0, 0.0)


def uniform(force=(600.0, 0.0, 300.0), frames=FRAMES) -> UniformField:
    return UniformField(BOX, FPS, frames, np.array(force))


def waves(frames=FRAMES) -> ForceFieldAnalytic:
    """A field that bends and turns."""
    amplitude, mean = np.broadcast_to(np.array([[0.0, 900.0, 400.0]]), (frames, 1, 3)), np.tile([500.0, 0.0, 0.0], (frames, 1))
    return ForceFieldAnalytic(BOX, FPS, frames, mean, np.array([[9.0, 0.0, 0.0]]), np.zeros(1), amplitude)


def run(folder, *bodies: BodyEdit, field=None, gravity=WEIGHTLESS, recovered=None, **edit):
    return simulate_bodies(Edit(body=bodies, gravity=gravity, **edit), field or uniform(), recovered, folder)
