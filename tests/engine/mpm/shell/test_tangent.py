"""The derivative of substeps against finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.materials import Sheet
from seeing_wind.engine.mpm.shell import State, advance, at_rest, shell_of
from seeing_wind.engine.mpm.shell import substep as room
from seeing_wind.engine.mpm.shell.tangent import Change, FaceSlopes, LoadSlopes, tangent_of
from seeing_wind.engine.mpm.shell.tangent.blocks import diagonal
from seeing_wind.engine.recovery.wind.drag import drag_slopes, vertex_drag

G = np.array([0.0, 0.0, -9.81])
DT = 0.004
STEP = 1e-6


@pytest.fixture
def exact(monkeypatch):
    """Newton's method goes on until nothing moves: what it leaves of the equations by default is more than a difference of 1e-6."""
    monkeypatch.setattr(room, "EXACT", 1e-10)
    monkeypatch.setattr(room, "LOOSE", 1e-4)


def blown(shell, wind):
    """The load of a wind (V, 3), and its derivatives with the velocity at the end."""
    faces, slopes = shell.surface.faces, FaceSlopes(shell)

    def load_slopes(state, after):
        d = drag_slopes(wind, state.x, state.v, after.v, faces)
        by_wind = slopes.corners.assembled(d.wind)
        lumped = diagonal(vertex_drag(wind, state.x, state.v, faces)[1])
        return LoadSlopes(slopes.corners.assembled(d.x), lumped - by_wind), by_wind

    return (lambda x, v, frame: vertex_drag(wind, x, v, faces)), load_slopes, slopes


def start(make, bumpy, loss):
    x, faces = make["irregular"](0.4, 0.3, 5, 4)
    x[:, 2] += bumpy * (0.4 * x[:, 0] ** 2 - 0.5 * x[:, 0] * x[:, 1])
    sheet = Sheet(0.12, 1e-3, 60.0, 3e-4, loss_factor=loss)
    shell = shell_of(x, faces, sheet, pinned=x[:, 0] < 1e-9)
    moving = np.random.default_rng(1).normal(size=x.shape) * 0.3 + 2.0 * x[:, :1] * [0.0, 0.3, 1.0]
    return shell, at_rest(shell, moving, np.broadcast_to(G, x.shape), dt=DT)


@pytest.mark.parametrize(("bumpy", "loss"), [(0.0, 0.0), (0.0, 0.3), (1.0, 0.0), (1.0, 0.3)])
def test_a_rollout_has_its_derivative_by_wind_and_first_state(make, exact, bumpy, loss):
    """Pins that move, bending, damping, a bent shape at rest: 5 substeps, the change of everything at the end."""
    shell, state = start(make, bumpy, loss)
    rng = np.random.default_rng(3)
    wind = np.array([1.0, 2.0, 3.0]) + rng.normal(size=state.x.shape)
    free = ~shell.pinned[:, None]
    first, gust = [rng.normal(size=state.x.shape) * free for _ in range(4)], rng.normal(size=state.x.shape)

    def path(step):
        now = State(*(part + step * one for part, one in zip((state.x, state.v, state.x_before, state.v_before), first, strict=True)))
        states, load = [now], blown(shell, wind + step * gust)[0]
        for number in range(5):
            pins = shell.surface.x[shell.pinned] + (number + 1) * np.array([0.0, 0.001, 0.002])
            states.append(advance(shell, states[-1], dt=DT, gravity=G, load=load, pins=pins)[0])
        return states

    states = path(0.0)
    load, load_slopes, slopes = blown(shell, wind)
    change = Change(*(one[..., None] for one in first))
    for before, after in zip(states, states[1:]):
        by_state, by_wind = load_slopes(before, after)
        tangent = tangent_of(shell, slopes, before, after, dt=DT, gravity=G, load=load, load_slopes=by_state)
        change = tangent.carried(change, (by_wind @ gust.ravel()).reshape(-1, 3, 1))
    above, below = path(STEP)[-1], path(-STEP)[-1]
    for name in ("x", "v", "x_before", "v_before"):
        numeric = (getattr(above, name) - getattr(below, name)) / (2.0 * STEP)
        np.testing.assert_allclose(getattr(change, name)[..., 0], numeric, atol=1e-5 * np.abs(numeric).max())


def test_several_directions_are_those_one_by_one(make):
    shell, state = start(make, 0.0, 0.3)
    after = advance(shell, state, dt=DT, gravity=G)[0]
    tangent = tangent_of(shell, FaceSlopes(shell), state, after, dt=DT, gravity=G)
    both = np.random.default_rng(0).normal(size=(4, len(state.x), 3, 2)) * ~shell.pinned[:, None, None]
    together = tangent.carried(Change(*both))
    for one in range(2):
        alone = tangent.carried(Change(*both[..., one : one + 1]))
        np.testing.assert_allclose(together.x[..., one], alone.x[..., 0], atol=1e-12)
        np.testing.assert_allclose(together.v_before[..., one], alone.v_before[..., 0], atol=1e-12)
