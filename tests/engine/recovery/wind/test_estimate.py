"""The wind from the force on a body, against the closed form of a plate that the wind blows along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.recovery.prior.basis import spatial_basis
from seeing_wind.engine.recovery.wind.estimate import force_problem, places_of, solve_problem, wind_of
from seeing_wind.engine.recovery.wind.felt import felt_force
from seeing_wind.engine.recovery.wind.surface import particle_surface
from tests.engine.recovery.wind.blown_plate import DENSITY, FPS, SPEED


@pytest.fixture(scope="module")
def found(blown):
    recovery, particles, _ = blown
    basis = spatial_basis(particles.x, particles.volume, 16).up_to(1)
    felt = felt_force(recovery, particles, DENSITY, particle_surface(particles), basis, FPS)
    return felt, basis, wind_of(felt, basis, recovery.x)


def test_the_wind_of_a_plate_is_that_of_the_closed_form(found):
    felt, _, estimate = found
    across = estimate.velocity[..., 2]
    np.testing.assert_allclose(across, SPEED, rtol=0.05)
    assert estimate.unexplained < 0.05
    assert estimate.mean[2] == pytest.approx(SPEED, rel=0.05)


def test_wind_along_a_sheet_is_left_to_the_prior(found):
    felt, basis, estimate = found
    assert np.abs(estimate.velocity[..., :2]).max() < 0.3 * SPEED
    along, across = estimate.deviation[..., :2], estimate.deviation[..., 2]
    assert along.mean() > 0.05 * SPEED and along.mean() > 3.0 * across.mean()


def test_a_component_of_the_force_that_is_hardly_known_is_a_datum_that_counts_for_little(blown):
    recovery, particles, _ = blown
    deviation = recovery.deviation * [1.0, 10.0, 1.0]
    basis = spatial_basis(particles.x, particles.volume, 16).up_to(1)
    felt = felt_force(replace(recovery, deviation=deviation), particles, DENSITY, particle_surface(particles), basis, FPS)
    net = felt.deviation[:, :3]
    np.testing.assert_allclose(net[:, 1], 10.0 * net[:, 0])
    np.testing.assert_allclose(net[:, 2], net[:, 0])


def test_a_wind_is_more_probable_than_a_force_that_happens_to_fade_like_drag(found, blown):
    felt, basis, estimate = found
    start = np.einsum("tdpi,td->tpi", felt.seen, felt.measured)
    assert estimate.evidence > solve_problem(force_problem(felt), places_of(basis, blown[0].x, 1.0), [start], 20.0).evidence


def test_slopes_are_those_of_finite_differences(found):
    felt, _, _ = found
    wind = np.random.default_rng(0).normal(size=(len(felt.measured), felt.phi.shape[1], 3)) + [0.0, 0.0, 6.0]
    slopes, step = felt.slopes(wind), 1e-6
    for mode in range(wind.shape[1]):
        for axis in range(3):
            change = np.zeros_like(wind)
            change[:, mode, axis] = step
            quotient = (felt.predicted(wind + change) - felt.predicted(wind - change)) / (2 * step)
            np.testing.assert_allclose(slopes[:, :, mode, axis], quotient, rtol=1e-4, atol=1e-5 * np.abs(slopes).max())


def test_what_only_stretches_the_body_is_no_observation(blown):
    recovery, particles, _ = blown
    basis = spatial_basis(particles.x, particles.volume, 16).up_to(1)
    squeeze = np.zeros_like(recovery.force_density)
    squeeze[..., 0] = -500.0 * particles.x[:, 0]
    surface = particle_surface(particles)
    plain = felt_force(recovery, particles, DENSITY, surface, basis, FPS)
    squeezed = felt_force(replace(recovery, force_density=recovery.force_density + squeeze), particles, DENSITY, surface, basis, FPS)
    np.testing.assert_allclose(squeezed.measured, plain.measured, atol=1e-9)
    turning = np.zeros_like(recovery.force_density)
    turning[..., 2] = 500.0 * particles.x[:, 0]
    turned = felt_force(replace(recovery, force_density=recovery.force_density + turning), particles, DENSITY, surface, basis, FPS)
    assert np.abs(turned.measured[:, 3:]).max() > 0.5


def test_the_observation_of_a_plate_is_its_net_force_and_torque(found):
    felt, basis, _ = found
    assert felt.phi.shape[1] == 3
    assert felt.measured.shape[1] == 6
    rows = felt.seen.reshape(len(felt.seen), 6, -1)
    np.testing.assert_allclose(rows @ rows.transpose(0, 2, 1), np.tile(np.eye(6), (len(rows), 1, 1)), atol=1e-9)
