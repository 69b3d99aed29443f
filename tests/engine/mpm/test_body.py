"""One body on all cores: the same motion as on one, in both precisions; what it keeps; how it fails."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.errors import SimulationError
from seeing_wind.engine.materials import PLASTIC_LAWS
from seeing_wind.engine.mpm.autograd import simulate
from seeing_wind.engine.mpm.batch import rollout_batch
from seeing_wind.engine.mpm.body import Body
from seeing_wind.engine.mpm.checks import checked_state
from seeing_wind.engine.mpm.kernels.native import aligned_zeros
from seeing_wind.engine.mpm.lattice.colliders import Plane
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from tests.engine.mpm.bodies import RUBBER, block

LAWS = ("corotated", "neo_hookean", "von_mises", "viscoplastic")


def problem(law="corotated", substeps=50, pinned_below=0.022, speed=1.0):
    """Model, state and force (N, 3), (N, 3, 3) of a post that is pinned, struck and bent until plastic laws flow."""
    rng = np.random.default_rng(0)
    body = block((5, 5, 12), pinned_below=pinned_below)
    model, _ = model_for(body, replace(RUBBER, law=law, yield_stress=300.0, viscosity=2.0), 30.0)
    model = replace(model, substeps=substeps, frame_dt=model.frame_dt / model.substeps * substeps)
    x = body.x - body.x.mean(axis=0)
    v = speed * np.stack([3.0 * x[:, 2], np.sin(40.0 * x[:, 0]), x[:, 0]], axis=1) + 0.05 * rng.normal(size=x.shape)
    F = np.eye(3) + 0.02 * rng.normal(size=(model.particles, 3, 3))
    v[body.pinned], F[body.pinned] = 0.0, np.eye(3)
    return model, State(body.x, v, np.zeros_like(F), F), 20.0 * rng.normal(size=x.shape), 50.0 * rng.normal(size=F.shape)


def moved(model, state, acceleration, gradient, precision="double", tasks=None):
    body = Body(model, precision, tasks)
    return body.frame(checked_state(body.model, state), acceleration + model.gravity, gradient, 0, NoProgress())[0]


def apart(a, b, start):
    """Largest difference of two states, each part relative to how far it went from `start`."""
    parts = [(getattr(a, name), getattr(b, name), getattr(start, name)) for name in "xvCF"]
    return max(np.linalg.norm(p - q) / np.linalg.norm(q - s) for p, q, s in parts)


@pytest.mark.parametrize("law", LAWS)
def test_all_cores_move_a_body_as_one_does_and_single_precision_keeps_up(law):
    model, state, acceleration, gradient = problem(law)
    one = rollout(model, state, acceleration[None], gradient[None]).state(1)
    for tasks in (1, 3):
        assert apart(moved(model, state, acceleration, gradient, tasks=tasks), one, state) < 1e-10
    assert apart(moved(model, state, acceleration, gradient, "single", tasks=2), one, state) < 1e-3
    if law == "von_mises":
        elastic = replace(model, yield_stress=1e6 * model.yield_stress)
        assert apart(moved(elastic, state, acceleration, gradient), one, state) > 1e-2  # it does flow


def test_single_precision_does_not_depend_on_the_place():
    model, state, acceleration, gradient = problem(pinned_below=None)
    here = moved(model, state, acceleration, gradient, "single")
    far = np.array([300.0, -200.0, 1000.0])
    there = moved(replace(model, offset=model.offset + far), replace(state, x=state.x + far), acceleration, gradient, "single")
    assert np.allclose(there.x - far, here.x, atol=1e-9)


def test_a_large_body_takes_all_cores_and_momentum_is_kept():
    body = block((21, 21, 21))
    model, _ = model_for(body, RUBBER, 30.0, gravity=(0, 0, 0))
    model = replace(model, substeps=5, frame_dt=model.frame_dt / model.substeps * 5)
    push = np.random.default_rng(0).normal(size=(2, model.particles, 3))
    for precision, tolerance in (("double", 1e-9), ("single", 1e-5)):
        path = rollout(model, State.at_rest(body.x), push, precision=precision)
        impulse = model.mass[:, None] * push.sum(axis=0) * model.frame_dt
        momentum = (model.mass[:, None] * path.v[-1]).sum(axis=0)
        assert np.linalg.norm(momentum - impulse.sum(axis=0)) < tolerance * np.linalg.norm(impulse, axis=1).sum()


# -- the way back -----------------------------------------------------------------------------------------------------------------


def gradients(model, state, acceleration, gradient, precision):
    tensors = [torch.tensor(a, requires_grad=True) for a in (state.x, state.v, acceleration[None], gradient[None], state.C, state.F)]
    stiffness = torch.tensor(2e4, dtype=torch.float64, requires_grad=True)
    x, v, a, G, C, F = tensors
    outputs = simulate(model, x, v, a, G, C0=C, F0=F, youngs_modulus=stiffness, precision=precision)
    rng = np.random.default_rng(1)
    sum((torch.tensor(rng.normal(size=output[-1].shape)) * output[-1]).sum() for output in (outputs[0], outputs[1])).backward()
    return [tensor.grad.numpy() for tensor in (*tensors, stiffness)], outputs[0].grad_fn.runs


# No verb asks for single precision, and compiling it for what flows takes a quarter of a minute; its laws' own adjoints are tried anyway.
@pytest.mark.parametrize("law", [pytest.param(law, marks=[pytest.mark.slow] if law in PLASTIC_LAWS else []) for law in LAWS])
def test_single_precision_finds_the_same_gradients(law):
    double, _ = gradients(*problem(law, substeps=20), "double")
    single, _ = gradients(*problem(law, substeps=20), "single")
    for a, b in zip(single, double):
        assert np.linalg.norm(a - b) < 2e-3 * np.linalg.norm(b)


def test_states_simulated_again_give_the_gradients_of_states_kept(monkeypatch):
    kept, _ = gradients(*problem(), "single")
    monkeypatch.setattr(importlib.import_module("seeing_wind.engine.mpm.autograd"), "HISTORY", 0)
    again, _ = gradients(*problem(), "single")
    for a, b in zip(again, kept):
        assert np.allclose(a, b, rtol=1e-6, atol=1e-6 * np.abs(b).max())


def test_a_frame_keeps_at_most_a_hundred_bytes_per_particle_and_substep():
    model, state, acceleration, gradient = problem()
    for precision, stride in (("single", 1), ("double", 8)):
        body = Body(model, precision)
        _, run = body.frame(checked_state(body.model, state), acceleration, gradient, 0, NoProgress(), lambda substeps: stride)  # noqa: B023
        assert 0 < run.bytes <= 100 * len(run.order) * run.substeps
        bar = aligned_zeros((6 * len(run.order), 4), body.real)
        most = []

        def watch(run=run, most=most):
            most.append(run.bytes)
            return False

        body.pull_back(run, bar, False, Progress(cancelled=watch))
        assert max(most) <= 100 * len(run.order) * run.substeps


# -- failures ---------------------------------------------------------------------------------------------------------------------


def test_too_fast_names_where_and_what_to_change():
    model, state, acceleration, gradient = problem(substeps=10)
    acceleration[7] = [3e6, 0.0, 0.0]
    with pytest.raises(SimulationError, match="more than one grid cell|inside out") as caught:
        moved(model, state, acceleration, gradient)
    error = caught.value
    assert error.frame == 0 and 0 <= error.substep < 20 and 0 <= error.particle < model.particles and "of 20" in error.message


def test_not_finite_is_an_error_not_a_zero():
    for precision in ("double", "single"):
        model, state, acceleration, gradient = problem(substeps=5)
        acceleration[200, 1] = np.nan
        with pytest.raises(SimulationError, match="not finite") as caught:
            moved(model, state, acceleration, gradient, precision)
        assert caught.value.quantity == "velocity" and caught.value.particle >= 0


def test_a_frame_that_is_a_little_too_fast_takes_half_the_substep():
    model, state, acceleration, gradient = problem(substeps=10, pinned_below=None, speed=0.0)
    speed = 1.5 * model.dx * model.substeps / model.frame_dt
    body = Body(model)
    start = checked_state(body.model, State.at_rest(state.x, v=[speed, 0.0, 0.0]))
    after, run = body.frame(start, np.zeros_like(acceleration), None, 0, NoProgress())
    assert run.substeps == 20
    assert np.allclose(after.x - start.x, [speed * model.frame_dt, 0.0, 0.0], atol=1e-9)


def test_a_grid_too_large_for_memory_is_an_error(monkeypatch):
    monkeypatch.setattr(importlib.import_module("seeing_wind.engine.mpm.body.substeps"), "MOST_NODES", 100)
    model, state, acceleration, gradient = problem(substeps=2)
    with pytest.raises(SimulationError, match="flew off") as caught:
        moved(model, state, acceleration, gradient)
    assert caught.value.quantity == "position"


def test_cancelling_stops_a_frame():
    model, state, acceleration, gradient = problem(substeps=5)
    body = Body(model)
    with pytest.raises(Cancelled):
        body.frame(state, acceleration, gradient, 0, Progress(cancelled=lambda: True))


def test_copies_above_a_floor_equal_single_rollouts():
    body = block((4, 4, 4), jitter=0.0)
    floor = Plane(point=(0.0, 0.0, -0.01), normal=(0.0, 0.0, 1.0))
    model, _ = model_for(body, RUBBER, 30.0, colliders=[floor])
    state, phi, dphi = State.at_rest(body.x, v=[0.0, 0.0, -1.0]), np.ones((64, 1)), np.zeros((64, 1, 3))
    coefficients = np.zeros((2, 3, 1, 3))
    coefficients[1, :, 0, 0] = 5.0
    found = rollout_batch(model, state, phi, dphi, coefficients)
    assert not found.failed.any()
    for copy, points in zip(coefficients, found.x):
        path = rollout(model, state, np.repeat(copy, 64, axis=1))
        assert np.allclose(points, path.x, atol=1e-12)
    free, _ = model_for(body, RUBBER, 30.0)
    assert found.x[0, -1, :, 2].min() > rollout(free, state, np.zeros((3, 64, 3))).x[-1, :, 2].min() + 0.02
