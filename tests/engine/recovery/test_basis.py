"""The modes and knots that represent a force."""


import numpy as np
import pytest

from seeing_wind.engine.errors import ObjectError
from seeing_wind.engine.recovery.prior.basis import hats, knots_between, spatial_basis, velocity_basis
from tests.engine.recovery.bodies import plate


def test_modes_are_orthonormal_and_their_gradients_are_right():
    rng = np.random.default_rng(3)
    tilt = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    x = rng.uniform(-1, 1, (200, 3)) * [0.3, 0.2, 0.15] @ tilt + [1.0, 2.0, 3.0]
    mass = rng.uniform(0.5, 1.5, 200)
    basis = spatial_basis(x, mass, 20)
    np.testing.assert_allclose(np.einsum("n,ni,nj->ij", mass / mass.sum(), basis.phi, basis.phi), np.eye(20), atol=1e-9)
    np.testing.assert_allclose(basis.phi[:, 0], 1.0)
    # The first four span the affine functions, whose gradient is known.
    slope = rng.standard_normal(3)
    coefficients = np.linalg.lstsq(basis.phi, x @ slope, rcond=None)[0]
    np.testing.assert_allclose(coefficients[4:], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.einsum("npi,p->ni", basis.gradient, coefficients), np.tile(slope, (200, 1)), atol=1e-9)
    # A quadratic one too.
    coefficients = np.linalg.lstsq(basis.phi, (x @ slope) ** 2, rcond=None)[0]
    np.testing.assert_allclose(np.einsum("npi,p->ni", basis.gradient, coefficients), 2 * (x @ slope)[:, None] * slope, atol=1e-8)


def test_a_plate_has_no_modes_across_and_a_rod_only_powers_of_one_coordinate():
    sheet = plate((20, 14, 2), 0.01)
    basis = spatial_basis(sheet.x, sheet.volume, 30)
    assert (basis.degree == 1).sum() == 2 and (basis.degree == 2).sum() == 3
    rod = plate((40, 2, 2), 0.01)
    assert list(spatial_basis(rod.x, rod.volume, 30).degree) == [0, 1, 2, 3, 4, 5]


def test_bodies_of_few_particles():
    assert spatial_basis(np.zeros((1, 3)), np.ones(1), 16).phi.shape == (1, 1)
    assert spatial_basis(np.eye(3)[:2], np.ones(2), 16).phi.shape == (2, 2)
    with pytest.raises(ObjectError):
        spatial_basis(np.zeros((5, 3)), np.ones(5), 16)


@pytest.mark.parametrize(("frames", "spacing"), [(1, 2.0), (2, 4.0), (24, 2.0), (45, 3.3)])
def test_hats_share_every_frame_and_longer_clips_keep_the_first_knots(frames, spacing):
    shares = hats(frames, spacing)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    assert (shares >= 0).all() and (shares.max(axis=0) > 0).all()
    longer = hats(frames + 20, spacing)
    np.testing.assert_allclose(longer[:frames, : shares.shape[1] - 1], shares[:, :-1])


def test_knots_begin_anew_after_still_air():
    still = np.array([False, False, True, True, True, False, False, False, True])
    found = knots_between(still, 2.0)
    np.testing.assert_array_equal(found.at, [0.0, 2.0, 5.0, 7.0])
    np.testing.assert_allclose(found.hats.sum(axis=1), ~still)
    np.testing.assert_allclose(found.hats[1], [0.5, 0.5, 0.0, 0.0])
    np.testing.assert_array_equal(knots_between(np.zeros(9, bool), 2.0).hats, hats(9, 2.0))
    calm = knots_between(np.ones(5, bool), 2.0)
    assert calm.at.shape == (1,) and not calm.hats.any()


def test_initial_motions_of_free_and_held_bodies():
    body = plate((4, 3, 5))
    basis = spatial_basis(body.x, body.volume, 4)
    velocity, gradient = velocity_basis(body.x, basis, body.pinned)
    assert velocity.shape == (6, 60, 3)
    turned = np.cross([0.0, 0.0, 1.0], body.x) / basis.radius
    np.testing.assert_allclose(velocity[5], turned, atol=1e-12)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", gradient[5], body.x), turned, atol=1e-12)
    held = body.x[:, 2] < -0.03
    velocity, gradient = velocity_basis(body.x, basis, held)
    assert velocity.shape == (3, 60, 3) and (velocity[:, held] == 0.0).all() and (gradient[:, held] == 0.0).all()
