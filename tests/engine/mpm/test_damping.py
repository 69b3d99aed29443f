"""Kelvin-Voigt damping against closed forms, and what it asks of the substeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from seeing_wind.engine.errors import MaterialError
from seeing_wind.engine.materials import LIMITS, LOSS_FREQUENCY, MATERIALS, Material, adjust
from seeing_wind.engine.mpm.damping import longest_retardation, substeps_for, with_retardation
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from tests.engine.mpm.bodies import RUBBER, block, retardation_of
from tests.engine.mpm.test_physics import bar
from tests.reference import mpm as twin


def ringing(t, y, omega):
    """Frequency [rad/s] and decay rate [1/s] of y(t), by least squares on a decaying cosine."""

    def residual(q):
        return (np.exp(-q[3] * t) * (q[0] * np.cos(q[2] * t) + q[1] * np.sin(q[2] * t)) - y) / np.ptp(y)

    start = [y[0], np.ptp(y) / 2, omega, 0.02 * omega]
    found = least_squares(residual, start, x_scale=[np.ptp(y), np.ptp(y), omega, 0.01 * omega])
    return found.x[2], found.x[3]


def damped_and_not(body, material, fps, frames, omega, velocity, mode, ratio):
    """(frequency, decay rate) of a mode without damping and with the damping ratio `ratio`, both with the same substeps."""
    model, _ = model_for(body, material, fps, gravity=(0, 0, 0), max_substeps=2000, speed=0.01)
    retardation = 2.0 * ratio / omega
    model = replace(model, substeps=substeps_for(model, retardation))
    found = []
    for one in (model, with_retardation(model, retardation)):
        path = rollout(one, State.at_rest(body.x, velocity), np.zeros((frames, one.particles, 3)))
        assert (path.substeps == one.substeps).all()
        found.append(ringing(np.arange(frames + 1) / fps, ((path.x - path.x[0]) * mode).sum(axis=(1, 2)), omega))
    return *found, retardation


def assert_kelvin_voigt(free, damped, retardation):
    """Within 2 %: a mode of frequency w0 decays at w0² tau / 2, besides what the solver loses of itself, and slows to sqrt(w0² - rate²)."""
    natural = np.hypot(*free)
    rate = 0.5 * natural**2 * retardation
    assert damped[1] - free[1] == pytest.approx(rate, rel=0.02)
    decrement = 2.0 * np.pi * damped[1] / damped[0] - 2.0 * np.pi * free[1] / free[0]
    assert decrement == pytest.approx(2.0 * np.pi * rate / np.sqrt(natural**2 - rate**2), rel=0.02)
    assert damped[0] == pytest.approx(np.sqrt(natural**2 - damped[1] ** 2), rel=0.02)


@pytest.mark.parametrize("law", ["corotated", "neo_hookean"])
def test_a_bar_rings_down_as_a_kelvin_voigt_solid(law):
    E, density, count, spacing = 1e5, 400.0, 16, 0.01
    body, length = bar(2, count, spacing), count * spacing
    omega = np.pi * np.sqrt(E / density) / length
    mode = np.cos(np.pi * body.x[:, 2] / length)[:, None] * [0.0, 0.0, 1.0]
    found = damped_and_not(body, Material("bar", law, density, E, 0.2), 12 * omega / (2 * np.pi), 30, omega, 0.01 * mode, mode, 0.05)
    assert_kelvin_voigt(*found)
    assert found[0][0] == pytest.approx(omega, rel=0.06)


def test_a_cantilever_swings_down_as_a_kelvin_voigt_solid():
    thick, along, rows, spacing, E, density = 0.06, 15, 2, 0.02, 1e5, 500.0
    body, length = bar(3, along + rows, spacing, rows), along * spacing
    omega = 3.516 * np.sqrt(E * thick**2 / (12.0 * density * length**4))
    z = np.clip(body.x[:, 2] - rows * spacing, 0.0, None) / length * 1.8751
    mode = (np.cosh(z) - np.cos(z) - 0.7341 * (np.sinh(z) - np.sin(z)))[:, None] * [1.0, 0.0, 0.0]
    velocity = 1e-3 * length * omega * mode
    found = damped_and_not(body, Material("beam", "corotated", density, E, 0.3), 12 * omega / (2 * np.pi), 24, omega, velocity, mode, 0.03)
    assert_kelvin_voigt(*found)
    assert found[0][0] == pytest.approx(omega, rel=0.1)  # shear and few particles in the section make it slower


def damped_block(law="corotated"):
    body = block()
    model, _ = model_for(body, replace(RUBBER, law=law), 30.0, gravity=(0, 0, 0))
    retardation = 4e-3
    return body, with_retardation(replace(model, substeps=substeps_for(model, retardation)), retardation)


@pytest.mark.parametrize("law", ["corotated", "neo_hookean"])
def test_damping_takes_energy_and_no_momentum(law):
    body, model = damped_block(law)
    stretching = 10.0 * np.array([[1.0, 0.3, 0.0], [0.3, -0.5, 0.0], [0.0, 0.2, -0.6]])
    v, C = [0.5, 0.2, -0.3] + (body.x - body.x.mean(axis=0)) @ stretching.T, np.tile(stretching, (len(body.x), 1, 1))
    start = State(body.x, v, C, np.tile(np.eye(3), (len(body.x), 1, 1)))
    still = np.zeros((3, model.particles, 3))
    damped, free = (rollout(one, start, still) for one in (model, replace(model, viscosity=0.0 * model.viscosity)))
    m = model.mass[:, None]

    def angular(path, t):
        spin = np.stack([path.C[t, :, (i + 2) % 3, (i + 1) % 3] - path.C[t, :, (i + 1) % 3, (i + 2) % 3] for i in range(3)], axis=1)
        return (m * (np.cross(path.x[t], path.v[t]) + model.dx**2 / 4.0 * spin)).sum(axis=0)

    def energy(path):
        moving = 0.5 * (m * path.v[-1] ** 2).sum() + model.dx**2 / 8.0 * (m[:, None] * path.C[-1] ** 2).sum()
        stored = sum(V * twin.energy(law, F, mu, lam) for V, F, mu, lam in zip(model.volume, path.F[-1], model.mu, model.lam))
        return moving + stored - 0.5 * (momentum @ momentum) / m.sum()

    momentum = (m * v).sum(axis=0)
    np.testing.assert_allclose((m * damped.v[-1]).sum(axis=0), momentum, atol=1e-12 * np.abs(m * v).sum())
    np.testing.assert_allclose(angular(damped, -1), angular(damped, 0), atol=1e-10 * np.abs(m * np.cross(body.x, v)).sum())
    assert energy(damped) < 0.6 * energy(free)


def test_a_body_that_turns_as_one_piece_is_not_damped():
    body, model = damped_block()
    start = State.at_rest(body.x, spin=(0.0, 0.0, 2.0))
    still = np.zeros((4, model.particles, 3))
    damped, free = (rollout(one, start, still) for one in (model, replace(model, viscosity=0.0 * model.viscosity)))
    np.testing.assert_allclose(damped.x, free.x, rtol=0, atol=1e-4 * np.abs(free.x - free.x[0]).max())


# -- what the substeps carry ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("poisson_ratio", [0.3, 0.45])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_the_longest_retardation_is_stable_with_half_the_substeps_too(poisson_ratio, share):
    body = bar(3, 12, 0.02, 2)
    model, _ = model_for(body, replace(RUBBER, poisson_ratio=poisson_ratio), 30.0, gravity=(0, 0, 0))
    model = replace(model, substeps=2 * model.substeps)
    model = with_retardation(model, longest_retardation(model))
    rough = replace(model, substeps=int(share * model.substeps))
    force = np.zeros((6, model.particles, 3))
    force[:3, :, 0], force[3:, :, 0] = 6.0, -6.0
    shaken = 0.05 * np.random.default_rng(0).normal(size=body.x.shape) * ~body.pinned[:, None]
    assert (rollout(rough, State.at_rest(body.x, shaken), force).substeps == rough.substeps).all()


def test_substeps_for_are_the_fewest_that_carry_it():
    model, _ = model_for(block(), RUBBER, 30.0)
    for retardation in (2e-3, 5e-3):
        enough = replace(model, substeps=substeps_for(model, retardation))
        assert longest_retardation(replace(enough, substeps=enough.substeps - 1)) < retardation <= longest_retardation(enough)
    assert substeps_for(model, 0.0) == model.substeps and LIMITS.viscous_courant < 0.95


def test_a_held_body_is_damped_as_far_as_its_substeps_carry_and_is_told_what_is_cut():
    held, free = block(pinned_below=0.012), block()
    soft, lossy = replace(RUBBER, loss_factor=1e-4), replace(RUBBER, loss_factor=0.5)
    undamped, _ = model_for(held, RUBBER, 30.0)
    model, notes = model_for(held, soft, 30.0)
    assert retardation_of(model) == pytest.approx(1e-4 / (2 * np.pi * LOSS_FREQUENCY)) and not notes
    assert model.substeps == undamped.substeps and not undamped.viscosity.any()
    model, notes = model_for(held, lossy, 30.0)
    assert model.substeps == undamped.substeps and retardation_of(model) == pytest.approx(longest_retardation(model))
    assert len(notes) == 1 and "swings on for longer than it should: it has a loss factor of 0.5, and with" in notes[0]
    model, notes = model_for(free, lossy, 30.0)
    assert model.substeps == model_for(free, RUBBER, 30.0)[0].substeps and retardation_of(model) == 0.0 and not notes


def test_bodies_that_flow_keep_the_viscosity_of_their_flow():
    lossy = replace(RUBBER, law="viscoplastic", yield_stress=100.0, viscosity=3.0, loss_factor=0.1)
    model, _ = model_for([block(pinned_below=0.012), block()], [lossy, replace(RUBBER, loss_factor=0.1)], 30.0)
    plastic = model.law == model.law[0]
    assert (model.viscosity[plastic] == 3.0).all() and (model.viscosity[~plastic] > 0.0).all()


def test_a_loss_factor_out_of_range_is_refused():
    for wrong in (-0.1, 3.0, np.nan):
        with pytest.raises(MaterialError, match="loss"):
            adjust(MATERIALS["rubber"], loss_factor=wrong)
