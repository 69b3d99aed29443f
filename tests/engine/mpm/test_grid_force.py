"""Forces at the nodes of the grid: against gravity, against the path of the centre of mass, their derivative, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.mpm import State, model_for, rollout
from seeing_wind.engine.mpm.autograd import simulate
from seeing_wind.engine.mpm.lattice.colliders import Plane
from seeing_wind.engine.mpm.lattice.grid_force import with_grid_force
from tests.engine.mpm.bodies import RUBBER, block

LOW, HIGH = np.full(3, -0.5), np.full(3, 0.5)
GRAVITY = np.array([0.5, 0.0, -9.81])


def free_block(gravity=(0.0, 0.0, 0.0), **options):
    body = block((4, 4, 4))
    model, _ = model_for(body, RUBBER, 30.0, gravity=gravity, **options)
    return replace(model, substeps=20), State.at_rest(body.x, v=[0.3, 0.0, 0.2], spin=[0.0, 4.0, 2.0])


def test_a_uniform_force_at_the_nodes_is_gravity():
    model, state = free_block()
    pushed = with_grid_force(model, LOW, HIGH, lambda x: np.tile(GRAVITY, (len(x), 1)))
    heavy, _ = free_block(gravity=GRAVITY)
    still = np.zeros((3, model.particles, 3))
    found, wanted = rollout(pushed, state, still), rollout(heavy, state, still)
    assert np.allclose(found.x, wanted.x, rtol=0, atol=1e-12)
    assert np.allclose(found.F, wanted.F, rtol=0, atol=1e-10)
    # Symplectic Euler's parabola.
    t = 3 * model.frame_dt
    fallen = state.v.mean(axis=0) * t + 0.5 * GRAVITY * t * (t + model.frame_dt / model.substeps)
    assert np.allclose((found.x[-1] - state.x).mean(axis=0), fallen, rtol=0, atol=1e-10)


def test_impulse_in_is_momentum_out_in_a_field_that_varies_in_space_and_time():
    # Splines reproduce a linear field: however the body deforms, its centre of mass feels the field's value there.
    model, state = free_block()
    at_origin, slope = np.array([[3.0, 0.0, -1.0], [-5.0, 2.0, 4.0]]), 40.0 * np.random.default_rng(0).normal(size=(3, 3))
    pushed = with_grid_force(model, LOW, HIGH, lambda x: at_origin[:, None] + x @ slope.T)
    path = rollout(pushed, state, np.zeros((2, model.particles, 3)))
    dt, mass = model.frame_dt / model.substeps, model.mass / model.mass.sum()
    x, v = mass @ state.x, mass @ state.v
    for frame in range(2):
        for _ in range(model.substeps):
            v = v + dt * (at_origin[frame] + slope @ x)
            x = x + dt * v
        assert np.allclose(mass @ path.v[frame + 1], v, rtol=0, atol=1e-9)
        assert np.allclose(mass @ path.x[frame + 1], x, rtol=0, atol=1e-11)
    assert np.linalg.norm(v - mass @ state.v) > 0.05


def test_a_force_acts_in_its_box_only():
    model, state = free_block()
    elsewhere = with_grid_force(model, HIGH, HIGH + 0.1, lambda x: np.tile(GRAVITY, (len(x), 1)))
    still = np.zeros((1, model.particles, 3))
    assert np.allclose(rollout(elsewhere, state, still).x, rollout(model, state, still).x, rtol=0, atol=1e-12)


def test_gradients_through_a_force_at_the_nodes_and_a_floor():
    floor = Plane(point=(0.0, 0.0, -0.004), normal=(0.0, 0.0, 1.0), friction=0.2)
    model, state = free_block(colliders=[floor])
    pushed = with_grid_force(model, LOW, HIGH, lambda x: 30.0 * np.stack([np.sin(60.0 * x[:, 2]), x[:, 0] * 20.0, -1.0 + 0.0 * x[:, 1]], 1))
    rng = np.random.default_rng(1)
    weight, way = torch.tensor(rng.normal(size=state.x.shape)), rng.normal(size=(2, *state.x.shape)) * np.array([1e-3, 1.0])[:, None, None]
    still = torch.zeros(1, model.particles, 3, dtype=torch.float64)

    def loss(x, v):
        return (weight * simulate(pushed, x, v, still)[0][-1]).sum()

    x, v = (torch.tensor(a, requires_grad=True) for a in (state.x, state.v))
    loss(x, v).backward()
    slope = float((x.grad.numpy() * way[0]).sum() + (v.grad.numpy() * way[1]).sum())
    step = 1e-4
    ends = [float(loss(torch.tensor(state.x + s * way[0]), torch.tensor(state.v + s * way[1]))) for s in (step, -step)]
    assert abs((ends[0] - ends[1]) / (2 * step) - slope) < 1e-5 * abs(slope)


@pytest.mark.parametrize(
    ("low", "high", "field", "message"),
    [
        (HIGH, HIGH - 0.1, lambda x: x, "No node"),
        (LOW, HIGH, lambda x: x[:, :2], "shape"),
        (LOW, HIGH, lambda x: x * np.nan, "not finite"),
        (LOW, HIGH, lambda x: np.zeros((0, len(x), 3)), "shape"),
        (LOW * np.nan, HIGH, lambda x: x, "reaches from"),
        (LOW - 1e4, HIGH + 1e4, lambda x: x, "more than"),
    ],
)
def test_bad_forces_are_refused(low, high, field, message):
    model, _ = free_block()
    with pytest.raises(UsageError, match=message):
        with_grid_force(model, low, high, field)
