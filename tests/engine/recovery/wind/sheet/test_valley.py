"""The deviation of a wind of which the sheet hardly determines one component."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.recovery.prior.basis import hats, spatial_basis
from seeing_wind.engine.recovery.solve.gauss_newton import Linearisation
from seeing_wind.engine.recovery.wind.estimate import deviation_of
from seeing_wind.engine.recovery.wind.sheet.valley import Posterior, mean_wind, mixed, posterior_of

NORMAL, ALONG = np.array([0.6, 0.0, 0.8]), np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0]])
BREEZE = 2.5


class Plate:
    """What a plate that does not turn feels of a uniform wind: |u| (u.n), and components along the plate, with deviations `felt` [m/s]."""

    cause = None
    basis = spatial_basis(np.zeros((1, 3)), np.ones(1), 1)

    def __init__(self, felt):
        self.felt, self.hats = felt, np.ones((4, 1))

    def residual(self, theta):
        u = theta[:3] + theta[3:]
        push = (np.linalg.norm(u) * (u @ NORMAL) - 4.0) / 0.1
        return np.concatenate([[push], (ALONG @ u - [0.0, 0.3]) / self.felt])

    def linearise(self, theta):
        u = theta[:3] + theta[3:]
        size = np.linalg.norm(u)
        slope = (u / size * (u @ NORMAL) + size * NORMAL) / 0.1
        rows = np.concatenate([slope[None], ALONG / np.array(self.felt)[:, None]])
        return Linearisation.at(theta, self.residual(theta), np.concatenate([rows, rows], axis=1).T)


class Breeze:
    """A prior with hardly any gusts and a mean wind of size `BREEZE`."""

    def precision(self):
        return np.diag([1e8] * 3 + [1.0 / BREEZE**2] * 3)


def by_quadrature(plate, about):
    """Root mean square distance [m/s] of the mean wind from `about` (3,), over the posterior on a grid."""
    ways = np.concatenate([NORMAL[None], ALONG])
    line = np.arange(-12.0, 12.0, 0.1)
    grid = np.stack(np.meshgrid(np.arange(-0.5, 3.0, 0.02), line, np.arange(-0.3, 0.9, 0.02), indexing="ij"), axis=-1).reshape(-1, 3) @ ways
    push = (np.linalg.norm(grid, axis=1) * (grid @ NORMAL) - 4.0) / 0.1
    other = (grid @ ALONG.T - [0.0, 0.3]) / plate.felt
    cost = push**2 + (other**2).sum(axis=1) + (grid**2).sum(axis=1) / BREEZE**2
    weight = np.exp(-0.5 * (cost - cost.min()))
    return float(np.sqrt((weight * ((grid - about) ** 2).sum(axis=1)).sum() / weight.sum()))


def test_along_a_bent_valley_the_whole_of_it_counts():
    """From a solution far up the valley: the walk finds its lowest place, and the error there, which the linearised posterior misses."""
    plate = Plate((100.0, 0.1))
    start = np.concatenate([np.zeros(3), 0.9 * NORMAL + 4.3 * ALONG[0] + 0.3 * ALONG[1]])
    found = posterior_of(plate, Breeze(), start)
    assert abs(found.theta[3:] @ ALONG[0]) < 1.5
    wanted = by_quadrature(plate, found.theta[3:])
    assert np.sqrt(np.trace(found.covariance[3:, 3:])) == pytest.approx(wanted, rel=0.15)
    linear = np.linalg.inv(plate.linearise(start).normal + Breeze().precision())
    assert np.sqrt(np.trace(linear[3:, 3:])) < 0.75 * by_quadrature(plate, start[3:])


def test_where_the_wind_is_known_nothing_changes():
    plate = Plate((0.1, 0.1))
    start = np.concatenate([np.zeros(3), 2.0 * NORMAL + 0.3 * ALONG[1]])
    found = posterior_of(plate, Breeze(), start)
    np.testing.assert_array_equal(found.theta, start)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(plate.linearise(start).normal + Breeze().precision()))


def test_the_mean_of_a_wind_over_time():
    plate = Plate((1.0, 1.0))
    plate.hats = np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0], [0.0, 1.0]])
    theta = np.array([1.0, 2.0, 3.0, 5.0, 6.0, 7.0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(mean_wind(plate) @ theta, [3.6, 4.7, 5.8])


def test_of_several_starts_the_most_probable_counts_with_the_others_errors():
    """Two as probable as each other, 4 m/s apart, and one that is not."""
    far = [Posterior(at * np.ones(1), 0.25 * np.eye(1), True) for at in (1.0, 5.0, 100.0)]
    found = mixed(far, [7.0, 7.0 - 1e-9, -60.0])
    np.testing.assert_array_equal(found.theta, [1.0])
    np.testing.assert_allclose(found.covariance, [[0.25 + 0.5 * 16.0]], rtol=1e-6)


def test_the_same_posterior_at_a_knot_in_every_frame():
    """Fields and their deviations stay, so that posteriors with different knots can be mixed."""
    rng = np.random.default_rng(3)
    knots, basis = hats(7, 3.0), spatial_basis(rng.normal(size=(20, 3)), np.ones(20), 3)
    theta, root = rng.normal(size=9 * knots.shape[1] + 3), rng.normal(size=(9 * knots.shape[1] + 3,) * 2)
    coarse = Posterior(theta, root @ root.T, True)
    fine = coarse.between_knots(knots)
    each = np.tensordot(knots, theta[:-3].reshape(knots.shape[1], -1), 1)
    np.testing.assert_allclose(fine.theta, np.concatenate([each.ravel(), theta[-3:]]), atol=1e-12)
    told = deviation_of(fine.covariance, np.eye(7), basis)
    np.testing.assert_allclose(told, deviation_of(coarse.covariance, knots, basis), rtol=1e-9)
