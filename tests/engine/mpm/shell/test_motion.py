"""Motion: free fall, momentum, energy, the frequency of a strip, its damping, moving pins, a load with drag."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.errors import SimulationError
from seeing_wind.engine.materials import SHEETS, Sheet
from seeing_wind.engine.mpm.shell import advance, advance_frame, at_rest, shell_of, substeps_for
from seeing_wind.engine.mpm.shell import bending as bend
from seeing_wind.engine.mpm.shell import membrane as stretch
from seeing_wind.engine.mpm.shell import substep as room

G = np.array([0.0, 0.0, -9.81])
NONE = np.zeros(3)
STIFF = Sheet(0.12, 1e-3, 500.0, 1e-4, poisson_ratio=0.0)


def energy(shell, state, gravity=NONE):
    F = stretch.deformation(shell.membrane, state.x)
    moving = 0.5 * (shell.mass[:, None] * state.v**2).sum() - (shell.mass[:, None] * state.x * gravity).sum()
    return moving + stretch.energy(shell.membrane, stretch.strain(F)).sum() + bend.energy(shell.bending, state.x)


@pytest.mark.parametrize("dt", [0.002, 0.01])
def test_free_fall_is_exact(make, dt):
    shell = shell_of(*make["irregular"](0.3, 0.2, 5, 4), SHEETS["silk"])
    v = np.array([1.0, -2.0, 3.0])
    state = at_rest(shell, np.broadcast_to(v, shell.surface.x.shape), np.broadcast_to(G, shell.surface.x.shape), dt=dt)
    for _ in range(20):
        state, _ = advance(shell, state, dt=dt, gravity=G)
    t = 20 * dt
    np.testing.assert_allclose(state.x, shell.surface.x + v * t + 0.5 * G * t**2, atol=1e-9)
    np.testing.assert_allclose(state.v, np.broadcast_to(v + G * t, state.v.shape), atol=1e-8)


def test_a_free_sheet_keeps_its_momentum_and_turns_on(make):
    x, faces = make["irregular"](0.3, 0.3, 6, 6)
    shell = shell_of(x, faces, STIFF)
    spin = np.array([2.0, 1.0, -3.0])
    v = np.cross(spin, x - x.mean(axis=0)) + 0.3 * np.sin(20.0 * x[:, ::-1])
    state, dt = at_rest(shell, v, dt=0.002), 0.002

    def momenta(s):
        p = shell.mass[:, None] * s.v
        return p.sum(axis=0), np.cross(s.x, p).sum(axis=0)

    linear, angular = momenta(state)
    for _ in range(100):
        state, _ = advance(shell, state, dt=dt, gravity=NONE)
    after, turned = momenta(state)
    np.testing.assert_allclose(after, linear, atol=1e-9 * np.linalg.norm(linear))
    np.testing.assert_allclose(turned, angular, atol=0.02 * np.linalg.norm(angular))


@pytest.mark.parametrize("drag", [0.0, 0.02])
def test_a_free_stiff_sheet_gains_the_impulse_of_its_load(make, drag):
    """Exactly, whatever Newton's method leaves of the equations of each vertex."""
    x, faces = make["irregular"](0.12, 0.08, 12, 8)
    shell = shell_of(x + np.array([0.0, 0.0, 1.0]) * (2.0 * x[:, :1] ** 2 + 0.5 * x[:, :1] * x[:, 1:2]), faces, SHEETS["leaf"])
    force = shell.mass[:, None] * (4.0 * np.array([0.1, 0.0, 1.0]) + 3.0 * np.sin(40.0 * x[:, :1] + [[0.0, 1.0, 2.0]]))
    slows = drag * shell.mass.sum() / len(x)
    damping = np.broadcast_to(slows * np.eye(3), (len(x), 3, 3)) if drag else None
    dt, count = 0.005, 12
    state = at_rest(shell, None, force / shell.mass[:, None], dt=dt)
    for _ in range(count):
        before, earlier = (shell.mass @ each for each in (state.v, state.v_before))
        state, _ = advance(shell, state, dt=dt, gravity=NONE, load=lambda x, v, frame: (force - slows * v, damping))
        gained = shell.mass @ state.v - (4.0 * before - earlier) / 3.0
        pushed = (force - slows * state.v).sum(axis=0)
        np.testing.assert_allclose(gained, 2.0 * dt / 3.0 * pushed, atol=1e-10 * np.linalg.norm(force.sum(axis=0)))


@pytest.mark.parametrize(
    ("kind", "dt"),
    [("grid", 0.006), ("irregular", 0.003)]
    + [pytest.param(*one, marks=pytest.mark.slow) for one in (("grid", 0.003), ("irregular", 0.006))],
)
def test_energy_does_not_grow_in_still_air(make, kind, dt):
    """Cotton swings down from its edge, cracks like a whip and crumples. (What BDF2 never lets grow is a mean over two substeps.)"""
    x, faces = make[kind](0.4, 0.4, 6, 6)
    shell = shell_of(x, faces, SHEETS["cotton"], pinned=x[:, 0] < 1e-9)
    state = at_rest(shell, acceleration=np.broadcast_to(G, x.shape), dt=dt)
    weight = shell.mass.sum() * 9.81 * 0.4
    energies, lowest = [energy(shell, state, G)], 0.0
    for _ in range(int(0.6 / dt)):
        state, _ = advance(shell, state, dt=dt, gravity=G)
        energies.append(energy(shell, state, G))
        lowest = min(lowest, float(state.x[:, 2].min()))
    rise = np.max(energies - np.minimum.accumulate(energies))
    assert rise < 0.01 * weight
    assert energies[-1] < energies[0]
    assert lowest < -0.3


def strip(make, loss_factor=0.0):
    x, faces = make["grid"](0.12, 0.02, 12, 2)
    x[:, 0] -= 0.02
    return shell_of(x, faces, Sheet(0.12, 1e-3, 500.0, 1e-4, loss_factor, poisson_ratio=0.0), pinned=x[:, 0] < 1e-9)


def swing(shell, dt, seconds):
    """Height of the free end over time, after a push in the shape of the first mode."""
    x = shell.surface.x
    s = np.clip(x[:, 0] / 0.1, 0.0, None)
    shape = np.cosh(1.8751 * s) - np.cos(1.8751 * s) - 0.7341 * (np.sinh(1.8751 * s) - np.sin(1.8751 * s))
    v = np.zeros_like(x)
    v[:, 2] = 0.005 * shape
    state, heights = at_rest(shell, v, dt=dt), [0.0]
    for _ in range(int(seconds / dt)):
        state, _ = advance(shell, state, dt=dt, gravity=NONE)
        heights.append(float(state.x[np.argmax(x[:, 0]), 2]))
    return np.array(heights)


OMEGA = 1.8751**2 * np.sqrt(1e-4 / (0.12 * 0.1**4))
"""rad/s of the first mode of a strip 0.1 m long."""


def crossings(heights, dt):
    before = np.flatnonzero((heights[:-1] * heights[1:] < 0.0) & (np.arange(len(heights) - 1) > 0))
    return dt * (before + heights[before] / (heights[before] - heights[before + 1]))


def test_a_strip_swings_at_its_frequency(make, monkeypatch):
    monkeypatch.setattr(room, "EXACT", 1e-4)
    dt = 0.005
    heights = swing(strip(make), dt, 1.5)
    period = 2.0 * np.diff(crossings(heights, dt)).mean()
    assert 2.0 * np.pi / period == pytest.approx(OMEGA, rel=0.01)


@pytest.mark.parametrize("dt", [pytest.param(0.004, marks=pytest.mark.slow), 0.008])
def test_the_rule_damps_a_slow_swing_little(make, monkeypatch, dt):
    """BDF2 takes (w dt)³ / 4 of the amplitude in a radian of the swing."""
    monkeypatch.setattr(room, "EXACT", 1e-4)
    heights = swing(strip(make), dt, 2.0)
    peaks = np.abs(heights[1:-1])[(np.abs(heights[1:-1]) > np.abs(heights[:-2])) & (np.abs(heights[1:-1]) > np.abs(heights[2:]))]
    loss = -np.log(peaks[-1] / peaks[0]) / (np.pi * (len(peaks) - 1))
    assert -2e-4 < loss < 0.5 * (OMEGA * dt) ** 3 + 2e-4


def test_damping_follows_the_loss_factor(make, monkeypatch):
    """A loss factor eta at 2 Hz is a retardation tau = eta / (4 pi): a mode's damping ratio is omega tau / 2."""
    monkeypatch.setattr(room, "EXACT", 1e-4)
    dt, eta = 0.004, 0.2
    heights = swing(strip(make, eta), dt, 1.5)
    peaks = np.abs(heights[1:-1])[(np.abs(heights[1:-1]) > np.abs(heights[:-2])) & (np.abs(heights[1:-1]) > np.abs(heights[2:]))]
    ratio = -np.log(peaks[-1] / peaks[0]) / (np.pi * (len(peaks) - 1))
    assert ratio == pytest.approx(0.5 * OMEGA * eta / (4.0 * np.pi), rel=0.05)


def test_pins_go_their_way(make):
    x, faces = make["grid"](0.2, 0.2, 4, 4)
    pinned = x[:, 0] < 1e-9
    shell = shell_of(x, faces, SHEETS["wool"], pinned=pinned)
    path = x[pinned] + np.linspace(0.0, 0.1, 6)[:, None, None] * [0.0, 1.0, 0.0]
    state = at_rest(shell, dt=1.0 / 30.0 / substeps_for(30.0))
    for frame in range(5):
        state = advance_frame(shell, state, frame=frame, fps=30.0, substeps=substeps_for(30.0), gravity=G, pin_path=path)
        np.testing.assert_allclose(state.x[pinned], path[frame + 1], atol=1e-12)
    assert state.x[~pinned, 1].mean() > x[~pinned, 1].mean() + 0.03


def test_strong_drag_carries_a_light_sheet_with_the_air(make):
    """Damping a hundred times the mass over the substep: an explicit force would throw it away."""
    shell = shell_of(*make["grid"](0.2, 0.2, 4, 4), SHEETS["silk"])
    dt = 0.005
    damping = (100.0 * shell.mass / dt)[:, None, None] * np.eye(3)
    wind = np.array([3.0, 0.0, 0.0])

    def load(x, v, frame):
        return np.einsum("vij,vj->vi", damping, wind - v), damping

    state = at_rest(shell)
    for _ in range(20):
        state, _ = advance(shell, state, dt=dt, gravity=NONE, load=load)
        assert (state.v[:, 0] < 3.6).all()
    np.testing.assert_allclose(state.v, np.broadcast_to(wind, state.v.shape), atol=0.01)


def test_quadratic_drag_is_of_second_order_in_the_substep(make):
    """A plate across the wind, from rest: v(t) = u (1 - 1 / (1 + k u t)) with k = drag / mass."""
    shell = shell_of(*make["grid"](0.2, 0.2, 4, 4), STIFF)
    k, u, end = 1.3, np.array([0.0, 4.0, 0.0]), 0.48

    def load(x, v, frame):
        off = u - v
        damping = (k * shell.mass * np.linalg.norm(off, axis=1))[:, None, None] * np.eye(3)
        return np.einsum("vij,vj->vi", damping, off), damping

    errors = []
    for steps in (24, 48, 96):
        dt = end / steps
        state = at_rest(shell, acceleration=np.broadcast_to(k * np.abs(u) * u, shell.surface.x.shape), dt=dt)
        for _ in range(steps):
            state, _ = advance(shell, state, dt=dt, gravity=NONE, load=load)
        errors.append(abs(state.v[:, 1].mean() - 4.0 * (1.0 - 1.0 / (1.0 + k * 4.0 * end))))
    assert errors[0] < 0.02 and errors[1] < 0.35 * errors[0] and errors[2] < 0.35 * errors[1]


def test_a_load_that_is_not_finite_stops_with_the_frame(make):
    shell = shell_of(*make["grid"](0.2, 0.2, 2, 2), SHEETS["silk"])
    with pytest.raises(SimulationError) as caught:
        advance_frame(shell, at_rest(shell), frame=3, fps=30.0, substeps=4, gravity=G, load=lambda x, v, frame: (x * np.nan, None))
    assert (caught.value.frame, caught.value.substep) == (3, 0)
