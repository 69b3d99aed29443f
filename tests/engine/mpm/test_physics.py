"""Closed forms that nobody here made: beams, waves, collisions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.records import Particles
from tests.engine.mpm.bodies import RUBBER, block


def bar(across: int, along: int, spacing: float, pinned_rows: int = 0) -> Particles:
    """A square bar along Z, its end face in z = 0."""
    axes = [(np.arange(n) + 0.5) * spacing for n in (across, across, along)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return Particles(x, np.full(len(x), spacing**3), x[:, 2] < pinned_rows * spacing, spacing)


def oscillation(t, y, omega):
    """Mean and circular frequency of y(t), by least squares on a + b cos + c sin."""
    size = np.ptp(y)

    def residual(q):
        return (q[0] + q[1] * np.cos(q[3] * t) + q[2] * np.sin(q[3] * t) - y) / size

    found = least_squares(residual, [y.mean(), 0.5 * (y[0] - y.mean()), 0.0, omega], x_scale=[size, size, size, omega])
    return found.x[0], found.x[3]


def cantilever(across: int, slenderness: int = 6) -> float:
    """Tip deflection of a clamped bar under a small uniform load, over Timoshenko's."""
    E, nu, density, thick, rows = 1e5, 0.3, 500.0, 0.06, 2
    spacing, length = thick / across, slenderness * thick
    body = bar(across, slenderness * across + rows, spacing, rows)
    area, inertia, shear = thick**2, thick**4 / 12, 10 * (1 + nu) / (12 + 11 * nu) * E / (2 * (1 + nu))
    per_load = density * area * (length**4 / (8 * E * inertia) + length**2 / (2 * shear * area))
    load = 0.005 * length / per_load
    omega = 3.516 * np.sqrt(E * inertia / (density * area * length**4))
    fps = 16 * omega / (2 * np.pi)
    model, notes = model_for(body, Material("beam", "neo_hookean", density, E, nu), fps, gravity=(0, 0, 0), max_substeps=2000, speed=0.01)
    assert not notes
    path = rollout(model, State.at_rest(body.x), np.broadcast_to([load, 0.0, 0.0], (20, model.particles, 3)))
    bend, z = path.x[:, :, 0] - body.x[:, 0], body.x[:, 2]
    last, before = (bend[:, np.isclose(z, z.max() - k * spacing)].mean(axis=1) for k in (0, 1))
    mean, _ = oscillation(np.arange(21) / fps, last + 0.5 * (last - before), omega)
    return float(mean / (load * per_load))


def test_a_cantilever_bends_as_beam_theory_says():
    coarse, fine = cantilever(4), cantilever(6)
    assert fine == pytest.approx(1.0, abs=0.05)
    # Sixteen particles of a section stand for (1 - 1/16) of its second moment, 36 for (1 - 1/36): the midpoint rule.
    assert 1.0 < fine < coarse < 1.1


def test_a_bar_rings_at_the_speed_of_sound():
    # First longitudinal mode of a free bar: omega = pi c / L, c = sqrt(E / rho) without Poisson's effect.
    E, density, count, spacing = 1e5, 400.0, 24, 0.01
    body, length, c = bar(3, count, spacing), count * spacing, np.sqrt(E / density)
    omega = np.pi * c / length
    fps = 12 * omega / (2 * np.pi)
    model, _ = model_for(body, Material("bar", "corotated", density, E, 0.0), fps, gravity=(0, 0, 0), speed=0.1)
    mode = np.cos(np.pi * body.x[:, 2] / length)
    v = 0.01 * mode[:, None] * [0.0, 0.0, 1.0]
    path = rollout(model, State.at_rest(body.x, v), np.zeros((18, model.particles, 3)))
    amplitude = (path.v[:, :, 2] * mode).mean(axis=1)
    _, found = oscillation(np.arange(19) / fps, amplitude, omega)
    assert found == pytest.approx(omega, rel=0.05)


def test_a_collision_keeps_momentum_and_angular_momentum():
    # Off centre, two materials, so that both bodies turn.
    left = block((4, 4, 4), jitter=0.0)
    right = replace(left, x=left.x + [0.075, 0.02, 0.0])
    soft = replace(RUBBER, name="soft", law="neo_hookean", density=600.0, youngs_modulus=1e4)
    model, _ = model_for([left, right], [RUBBER, soft], 60.0, gravity=(0, 0, 0))
    x = np.concatenate([left.x, right.x])
    v = np.zeros_like(x)
    v[:64] = [1.2, 0.1, 0.0]
    path = rollout(model, State.at_rest(x, v), np.zeros((8, model.particles, 3)))
    mass = model.mass[:, None]

    def angular(t):
        # What a particle carries: the moment of its velocity and, through C, of its own extent dx²/4.
        C = path.C[t]
        own = 0.25 * model.dx**2 * np.stack([C[:, 2, 1] - C[:, 1, 2], C[:, 0, 2] - C[:, 2, 0], C[:, 1, 0] - C[:, 0, 1]], axis=1)
        return (mass * (np.cross(path.x[t], path.v[t]) + own)).sum(axis=0)

    momentum = (mass * path.v).sum(axis=1)
    assert np.abs(momentum - momentum[0]).max() < 1e-5 * np.abs(momentum[0]).max()
    about = (mass * (path.x[0] - path.x[0].mean(0)) ** 2).sum() ** 0.5 * (mass * v**2).sum() ** 0.5
    assert np.abs(angular(-1) - angular(0)).max() < 1e-12 * about
    assert path.v[-1][64:, 0].mean() > 0.2 and path.v[-1][:64, 0].mean() < 0.8
    assert (mass * path.v[-1] ** 2).sum() < (mass * v**2).sum()


def test_a_thrown_body_follows_the_parabola():
    body = block((4, 4, 4))
    model, _ = model_for(body, RUBBER, 30.0)
    path = rollout(model, State.at_rest(body.x, v=[1.0, 0.0, 3.0], spin=[0.0, 2.0, 0.0]), np.zeros((15, model.particles, 3)))
    t = np.arange(16)[:, None] / 30.0
    dt = model.frame_dt / model.substeps  # symplectic Euler falls dt t g / 2 further
    fall = np.array([1.0, 0.0, 3.0]) * t + 0.5 * np.array([0.0, 0.0, -9.81]) * t * (t + dt)
    centre = (model.mass[:, None] * path.x).sum(axis=1) / model.mass.sum()
    assert np.allclose(centre - centre[0], fall, atol=1e-9)
