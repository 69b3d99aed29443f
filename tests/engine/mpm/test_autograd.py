"""The adjoint against finite differences in double precision."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.errors import MaterialError
from seeing_wind.engine.mpm import State, model_for, rollout
from seeing_wind.engine.mpm.autograd import simulate
from tests.engine.mpm.bodies import RUBBER, block

STEP = (1e-8, 1e-6, 1e-6, 1e-6, 1e-2, 1e-2)
"""Of x0, v0, C0, F0, acceleration, gradient: each small beside what the motion does, large beside rounding."""


def problem(law, substeps, deformed, frames=2, pinned_below=0.012):
    """Model, (x0, v0, C0, F0, acceleration, gradient), and weights of the four outputs in a loss that sees all of them."""
    rng = np.random.default_rng(0)
    body = block(pinned_below=pinned_below)
    model, _ = model_for(body, replace(RUBBER, law=law), 30.0)
    model = replace(model, substeps=substeps, frame_dt=model.frame_dt / model.substeps * substeps)
    n = model.particles
    F0 = np.tile(np.eye(3), (n, 1, 1)) + (0.1 * rng.normal(size=(n, 3, 3)) if deformed else 0.0)
    inputs = [body.x, rng.normal(size=(n, 3)), rng.normal(size=(n, 3, 3)), F0]
    inputs += [3 * rng.normal(size=(frames, n, 3)), 10 * rng.normal(size=(frames, n, 3, 3))]
    weights = [scale * rng.normal(size=(frames + 1, *array.shape)) for scale, array in zip((1.0, 1.0, 0.01, 1.0), inputs)]
    return model, inputs, weights


def loss(model, inputs, weights):
    x, v, C, F, acceleration, gradient = inputs
    path = rollout(model, State(x, v, C, F), acceleration, gradient)
    assert (path.substeps == model.substeps).all()
    return sum((weight * array).sum() for weight, array in zip(weights, (path.x, path.v, path.C, path.F)))


def gradients(model, inputs, weights):
    x, v, C, F, acceleration, gradient = tensors = [torch.tensor(array, requires_grad=True) for array in inputs]
    outputs = simulate(model, x, v, acceleration, gradient, C0=C, F0=F)
    sum((torch.tensor(weight) * output).sum() for weight, output in zip(weights, outputs)).backward()
    return [tensor.grad.numpy() for tensor in tensors]


def directional(model, inputs, weights, which, direction):
    h = STEP[which]
    ahead, behind = list(inputs), list(inputs)
    ahead[which], behind[which] = inputs[which] + h * direction, inputs[which] - h * direction
    return (loss(model, ahead, weights) - loss(model, behind, weights)) / (2 * h)


@pytest.mark.parametrize("law", ["corotated", "neo_hookean"])
@pytest.mark.parametrize("deformed", [False, True])
@pytest.mark.parametrize("substeps", [1, 10, 100])
def test_every_input_against_finite_differences(law, deformed, substeps):
    model, inputs, weights = problem(law, substeps, deformed)
    found = gradients(model, inputs, weights)
    rng = np.random.default_rng(1)
    for which, gradient in enumerate(found):
        direction = rng.normal(size=gradient.shape)
        numeric = directional(model, inputs, weights, which, direction)
        assert (gradient * direction).sum() == pytest.approx(numeric, rel=1e-6), which


def test_hundred_substeps_in_twenty_directions():
    model, inputs, weights = problem("corotated", 100, False, frames=1, pinned_below=None)
    found = gradients(model, inputs, weights)
    rng = np.random.default_rng(2)
    for k in range(20):
        which = (0, 1, 3, 4, 5)[k % 5]
        direction = rng.normal(size=inputs[which].shape)
        numeric = directional(model, inputs, weights, which, direction)
        assert (found[which] * direction).sum() == pytest.approx(numeric, rel=1e-6), which


def test_a_frame_that_was_halved_is_walked_back_with_its_own_substeps():
    model, inputs, weights = problem("corotated", 8, False, frames=1, pinned_below=None)
    speed = 1.5 * model.dx * model.substeps / model.frame_dt
    inputs[1] = inputs[1] * 0.01 + [speed, 0.0, 0.0]
    fine = replace(model, substeps=16)
    for coarse_gradient, fine_gradient in zip(gradients(model, inputs, weights), gradients(fine, inputs, weights)):
        assert np.allclose(coarse_gradient, fine_gradient, rtol=1e-12, atol=1e-12 * np.abs(fine_gradient).max())


def test_a_uniform_wind_is_found_by_descent():
    body = block()
    model, _ = model_for(body, RUBBER, 30.0)
    wind = torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64)
    rest = torch.tensor(body.x)
    target = simulate(model, rest, torch.zeros_like(rest), wind.expand(3, model.particles, 3))[0]
    guess = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.LBFGS([guess], max_iter=10, line_search_fn="strong_wolfe")

    def closure():
        optimiser.zero_grad()
        x = simulate(model, rest, torch.zeros_like(rest), guess.expand(3, model.particles, 3))[0]
        value = ((x - target) ** 2).sum() * 1e4
        value.backward()
        return value

    optimiser.step(closure)
    assert torch.allclose(guess.detach(), wind, atol=1e-4)


def test_plastic_laws_have_no_gradients():
    body = block()
    model, _ = model_for(body, replace(RUBBER, law="von_mises", yield_stress=100.0), 30.0)
    rest = torch.tensor(body.x)
    with pytest.raises(MaterialError, match="no gradients"):
        simulate(model, rest, torch.zeros_like(rest), torch.zeros(1, model.particles, 3, dtype=torch.float64))
