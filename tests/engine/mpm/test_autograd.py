"""Whole simulations backwards, against finite differences in double precision: every law, every input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.conventions import lame
from seeing_wind.engine.mpm.autograd import simulate
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.records import Particles
from tests.engine.mpm.bodies import RUBBER, block

LAWS = ("corotated", "neo_hookean", "von_mises", "viscoplastic")
MOTION = {"x0": 1e-8, "v0": 1e-6, "C0": 1e-5, "F0": 1e-6, "acceleration": 1e-2, "gradient": 1e-2}
"""Steps of the differences: each small beside what the motion does, large beside rounding."""
MATERIAL = {"youngs_modulus": 1e-5, "poisson_ratio": 1e-5, "density": 1e-5, "yield_stress": 1e-5, "viscosity": 1e-5}
"""Relative steps."""
PLASTIC = ("von_mises", "viscoplastic")
STARTS = ("rest", "two equal stretches", "three equal stretches", "anything")


def problem(law, substeps, start, frames=2, pinned_below=0.012):
    """Model, inputs of `simulate` by name, and weights of the four outputs in a loss that sees all of them."""
    rng = np.random.default_rng(0)
    body = block(pinned_below=pinned_below)
    model, _ = model_for(body, replace(RUBBER, law=law, yield_stress=400.0, viscosity=3.0), 30.0, max_substeps=200)
    model = replace(model, substeps=substeps, frame_dt=model.frame_dt / model.substeps * substeps)
    n = model.particles
    F0 = np.tile(np.eye(3), (n, 1, 1))
    if start == "two equal stretches":
        F0 = rotations(rng, n) @ np.diag([1.05, 1.05, 0.96]) @ rotations(rng, n)
    elif start == "three equal stretches":
        F0 = 0.98 * rotations(rng, n)
    elif start == "anything":
        F0 += 0.1 * rng.normal(size=(n, 3, 3))
    inputs = {"x0": body.x, "v0": rng.normal(size=(n, 3)), "C0": rng.normal(size=(n, 3, 3)), "F0": F0}
    inputs |= {"acceleration": 3 * rng.normal(size=(frames, n, 3)), "gradient": 10 * rng.normal(size=(frames, n, 3, 3))}
    values = {"youngs_modulus": 2e4, "poisson_ratio": 0.3, "density": 300.0, "yield_stress": 400.0, "viscosity": 3.0}
    inputs |= {name: value * rng.uniform(0.8, 1.2, size=n) for name, value in values.items()}
    shapes = zip((1.0, 1.0, 0.01, 1.0), (inputs[name].shape for name in ("x0", "v0", "C0", "F0")))
    return model, inputs, [scale * rng.normal(size=(frames + 1, *shape)) for scale, shape in shapes]


def rotations(rng, count):
    Q, _ = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    return Q * np.sign(np.linalg.det(Q))[:, None, None]


def path_of(model, inputs):
    mu, lam = lame(inputs["youngs_modulus"], inputs["poisson_ratio"])
    mass = inputs["density"] * model.volume
    model = replace(model, mass=mass, mu=mu, lam=lam, yield_stress=inputs["yield_stress"], viscosity=inputs["viscosity"])
    path = rollout(model, State(*(inputs[name] for name in ("x0", "v0", "C0", "F0"))), inputs["acceleration"], inputs["gradient"])
    assert (path.substeps == model.substeps).all()
    return path


def gradients(model, inputs, weights):
    tensors = {name: torch.tensor(array, requires_grad=True) for name, array in inputs.items()}
    outputs = simulate(model, **tensors)
    sum((torch.tensor(weight) * output).sum() for weight, output in zip(weights, outputs)).backward()
    return {name: tensor.grad.numpy() for name, tensor in tensors.items()}


def directional(model, inputs, weights, name, direction, step):
    ahead, behind = (path_of(model, inputs | {name: inputs[name] + sign * step * direction}) for sign in (1.0, -1.0))
    # The difference before the sum: that of two sums has the rounding of the sums.
    differences = zip(weights, (ahead.x - behind.x, ahead.v - behind.v, ahead.C - behind.C, ahead.F - behind.F))
    return sum((weight * difference).sum() for weight, difference in differences) / (2 * step)


def agree(law, model, inputs, weights, name, direction, step, found):
    """To 1e-6. A particle that crosses the yield surface within a step spoils that difference, so plastic laws may take shorter ones."""
    steps = (step, 0.1 * step, 0.01 * step) if law in PLASTIC else (step,)
    numeric = []
    for each in steps:
        numeric.append(directional(model, inputs, weights, name, direction, each))
        if found == pytest.approx(numeric[-1], rel=1e-6):
            return
    raise AssertionError(f"{name}: {found} against {numeric}")


def directions(rng, inputs, law):
    """(input, random direction, step) of all inputs that the law has."""
    for name, step in MOTION.items():
        yield name, rng.normal(size=inputs[name].shape), step
    for name, step in MATERIAL.items():
        if (name != "yield_stress" or law in PLASTIC) and (name != "viscosity" or law != "von_mises"):
            yield name, inputs[name] * rng.normal(size=inputs[name].shape), step


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("substeps", [1, 10, 100])
def test_every_input_against_finite_differences(law, start, substeps):
    model, inputs, weights = problem(law, substeps, start)
    found = gradients(model, inputs, weights)
    for name, direction, step in directions(np.random.default_rng(1), inputs, law):
        agree(law, model, inputs, weights, name, direction, step, (found[name] * direction).sum())


@pytest.mark.parametrize("law", PLASTIC)
def test_the_plastic_bodies_above_flow_and_unload(law):
    model, inputs, _ = problem(law, 100, "rest")
    plastic = path_of(model, inputs)
    elastic = path_of(model, inputs | {"yield_stress": 1e3 * inputs["yield_stress"]})
    flowed = np.abs(plastic.F[-1] - elastic.F[-1]).max(axis=(1, 2)) > 1e-2
    assert flowed.sum() > 0.2 * model.particles
    strain = np.log(np.linalg.svd(plastic.F[-1], compute_uv=False))
    trial = 2 * lame(inputs["youngs_modulus"], inputs["poisson_ratio"])[0] * np.linalg.norm(strain - strain.mean(1, keepdims=True), axis=1)
    below = trial < 0.9 * np.sqrt(2 / 3) * inputs["yield_stress"]
    assert below.sum() > 0.1 * model.particles


@pytest.mark.parametrize("law", LAWS)
def test_hundred_substeps_in_twenty_directions(law):
    model, inputs, weights = problem(law, 100, "rest", frames=1, pinned_below=None)
    found = gradients(model, inputs, weights)
    rng = np.random.default_rng(2)
    for _ in range(20 // 5):
        for name, direction, step in directions(rng, inputs, law):
            if name in ("x0", "v0", "F0", "acceleration", "youngs_modulus"):
                agree(law, model, inputs, weights, name, direction, step, (found[name] * direction).sum())


def test_a_frame_that_was_halved_is_walked_back_with_its_own_substeps():
    model, inputs, weights = problem("corotated", 8, "rest", frames=1, pinned_below=None)
    speed = 1.5 * model.dx * model.substeps / model.frame_dt
    inputs["v0"] = inputs["v0"] * 0.01 + [speed, 0.0, 0.0]
    coarse, fine = gradients(model, inputs, weights), gradients(replace(model, substeps=16), inputs, weights)
    for name, gradient in fine.items():
        assert np.allclose(coarse[name], gradient, rtol=1e-12, atol=1e-12 * np.abs(gradient).max()), name


def test_one_number_for_the_whole_body():
    model, inputs, weights = problem("von_mises", 10, "anything")
    inputs |= {name: np.full(model.particles, inputs[name].mean()) for name in MATERIAL}
    found = gradients(model, inputs, weights)
    numbers = {name: torch.tensor(inputs[name][0], requires_grad=True) for name in MATERIAL}
    outputs = simulate(model, **{name: torch.tensor(inputs[name]) for name in MOTION}, **numbers)
    sum((torch.tensor(weight) * output).sum() for weight, output in zip(weights, outputs)).backward()
    for name, number in numbers.items():
        assert number.grad.item() == pytest.approx(found[name].sum(), rel=1e-9), name


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


# -- exactly at yield -------------------------------------------------------------------------------------------------------------

SHIFT = {"x0": 1e-6, "v0": 1e-4, "C0": 1e-2, "F0": 1e-7, "acceleration": 1e-1, "gradient": 1e2} | dict.fromkeys(MATERIAL, 1e-5)
"""Steps of the one-sided differences, those of the material relative: what flows must not go on flowing in the second substep."""


def at_yield(law, substeps):
    """Particles each alone on the grid, so strained, moved and pulled that the first substep ends on the yield surface."""
    rng = np.random.default_rng(5)
    count = 6
    body = Particles(0.2 * np.arange(count)[:, None] * [1.0, 0.0, 0.0], np.full(count, 1e-6), np.zeros(count, bool), 0.01)
    model, _ = model_for(body, replace(RUBBER, law=law, yield_stress=400.0, viscosity=3.0), 30.0, gravity=(0, 0, 0), max_substeps=1000)
    # A hundredth of the time in which a wave crosses a cell: a hundred of them are less than half a period, or the particle would yield
    # again the other way.
    crossing = model.dx / np.sqrt((model.lam + 2 * model.mu) * model.volume / model.mass).max()
    model = replace(model, substeps=substeps, frame_dt=0.01 * crossing * substeps)
    stretches = np.exp(np.array([[0.06, 0.01, -0.05], [0.05, 0.05, -0.04]])).repeat(3, axis=0)[:, None, :] * np.eye(3)
    inputs = {"x0": body.x, "v0": rng.normal(size=(count, 3)), "F0": rotations(rng, count) @ stretches @ rotations(rng, count)}
    inputs |= {"acceleration": rng.normal(size=(1, count, 3)), "gradient": 100.0 * rng.normal(size=(1, count, 3, 3))}
    values = {"youngs_modulus": 2e4, "poisson_ratio": 0.3, "density": 300.0, "yield_stress": 400.0, "viscosity": 3.0}
    inputs |= {name: value * rng.uniform(0.8, 1.2, size=count) for name, value in values.items()}
    inputs["C0"] = np.zeros((count, 3, 3))
    inputs["C0"] = -after_a_substep(model, inputs)[0]
    inputs["yield_stress"] = (after_a_substep(model, inputs)[1] + inputs["yield_stress"] * np.sqrt(2 / 3)) * np.sqrt(1.5)
    return (
        model,
        inputs,
        [scale * rng.normal(size=(2, *inputs[name].shape)) for scale, name in zip((1, 1, 0.01, 1), ("x0", "v0", "C0", "F0"))],
    )


def after_a_substep(model, inputs):
    """C (N, 3, 3) after one substep, and how far |dev tau| (N,) then lies above the yield surface before it flows, in closed form.

    A particle alone keeps its affine velocity but for its stress and the force's gradient: splines sum w x x^T to dx²/4 I.
    """
    dt = model.frame_dt / model.substeps
    mu, lam = lame(inputs["youngs_modulus"], inputs["poisson_ratio"])
    U, s, _ = np.linalg.svd(inputs["F0"])
    tau = U @ ((2 * mu[:, None] * np.log(s) + lam[:, None] * np.log(s).sum(1, keepdims=True))[:, :, None] * U.swapaxes(1, 2))
    C = inputs["C0"] + dt * inputs["gradient"][0] - 4 * dt / (model.dx**2 * inputs["density"])[:, None, None] * tau
    strain = np.log(np.linalg.svd(inputs["F0"] + dt * C @ inputs["F0"], compute_uv=False))
    return C, 2 * mu * np.linalg.norm(strain - strain.mean(1, keepdims=True), axis=1) - np.sqrt(2 / 3) * inputs["yield_stress"]


@pytest.mark.parametrize("law", PLASTIC)
@pytest.mark.parametrize("substeps", [1, 10, 100])
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["flowing", "elastic"])
def test_exactly_at_yield_from_both_sides(law, substeps, side):
    model, inputs, weights = at_yield(law, substeps)
    assert np.abs(after_a_substep(model, inputs)[1]).max() < 1e-12 * 400.0
    inputs["yield_stress"] = inputs["yield_stress"] * (1.0 - side * 1e-12)
    found, here = gradients(model, inputs, weights), path_of(model, inputs)
    for name, direction, _ in directions(np.random.default_rng(6), inputs, law):
        step = SHIFT[name]
        # Each particle goes to its own side: outwards if it flows already, inwards if it does not.
        ahead, behind = (after_a_substep(model, inputs | {name: inputs[name] + sign * step * direction})[1] for sign in (1.0, -1.0))
        turn = np.where(ahead - behind == 0.0, 1.0, side * np.sign(ahead - behind))
        axis = 1 if name in ("acceleration", "gradient") else 0
        direction = direction * turn.reshape([-1 if k == axis else 1 for k in range(direction.ndim)])
        numeric = 0.0
        for k, share in zip((1, 2, 3, 4), (48, -36, 16, -3)):  # f'(0) from values at 0, h, ... 4 h, of fourth order
            there = path_of(model, inputs | {name: inputs[name] + k * step * direction})
            numeric += share * sum((w * (getattr(there, part) - getattr(here, part))).sum() for w, part in zip(weights, "xvCF"))
        exact = (found[name] * direction).sum()
        assert exact == pytest.approx(numeric / (12 * step), rel=1e-6), name
