"""The prior of the force, and how its sizes are learnt."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.records import PointTargets
from seeing_wind.engine.recovery.prior.basis import knots, spatial_basis
from seeing_wind.engine.recovery.prior.evidence import log_evidence, maximise_evidence, prefer_belief
from seeing_wind.engine.recovery.prior.kernel import Kernel, Places, Prior, knots_for_variance, modes_for_variance
from seeing_wind.engine.recovery.prior.learning import noise_share
from seeing_wind.engine.recovery.solve.gauss_newton import Linearisation
from seeing_wind.engine.recovery.targets.objective import Objective
from seeing_wind.engine.recovery.targets.points import point_channels
from tests.engine.recovery.bodies import every, plate


def still(body, frames):
    return np.repeat(body.x[None], frames + 1, axis=0)


def test_prior_is_smooth_in_time_and_the_inverse_of_its_precision():
    body = plate((8, 6, 2))
    basis = spatial_basis(body.x, body.volume, 6)
    prior = Prior(Kernel(9.0 * np.eye(3)), Places.along(basis, still(body, 40), knots(40, 2.0)), np.array([0.1]))
    covariance = np.linalg.inv(prior.precision())
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), prior.deviation(), rtol=1e-5)
    first, modes = np.diag(covariance)[:-1].reshape(-1, 6, 3)[0], prior.places.covariance(prior.kernel)
    assert 7.0 < first[0, 0] < 9.0 and first[0, 0] > 4 * first[1:].max()  # most of it is the same all over a small body
    assert modes[0, 6] > 0.8 * modes[0, 0] > modes[0, -6] > 0.0


def test_prior_knows_that_the_field_stays_where_it_is_when_the_body_moves_on():
    body = plate((8, 6, 2))
    basis = spatial_basis(body.x, body.volume, 4)
    path = still(body, 4)
    path[4] += [10.0 * basis.radius, 0.0, 0.0]
    kernel = Kernel(np.eye(3), length=1.0, duration=8.0, uniform=0.0)
    here = Places.along(basis, still(body, 4), knots(4, 4.0)).covariance(kernel)
    gone = Places.along(basis, path, knots(len(path) - 1, 4.0)).covariance(kernel)
    assert here[0, 4] > 0.5 * here[0, 0] and abs(gone[0, 4]) < 1e-6 * gone[0, 0]
    # A quarter turn in the plane: what was the slope along the body's length is now the one along its width.
    turned = still(body, 4)
    turned[4] = body.x @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    quarter = Places.along(basis, turned, knots(len(turned) - 1, 4.0)).covariance(kernel)
    assert abs(here[1, 5]) > 10 * abs(here[1, 6]) and abs(quarter[1, 6]) > 10 * abs(quarter[1, 5])


def test_sizes_of_the_prior_are_learnt_from_a_draw():
    body = plate((8, 6, 2))
    basis = spatial_basis(body.x, body.volume, 10)
    places = Places.along(basis, still(body, 40), knots(40, 2.0))
    true = Kernel(np.diag([0.3, 0.3, 2.4]), length=1.0, duration=6.0, uniform=0.05)
    believed = Prior(true, places, np.zeros(0))
    draw = np.linalg.cholesky(np.linalg.inv(believed.precision())) @ np.random.default_rng(4).standard_normal(believed.count)
    normal = np.eye(believed.count) / 0.01**2
    learnt = maximise_evidence(Prior(Kernel(np.eye(3)), places, np.zeros(0)), normal, normal @ draw)
    size = np.diag(learnt.covariance)
    assert size[2] > 4 * size[0] and size[2] > 4 * size[1] and 0.4 < size.sum() / 3.0 < 2.5
    assert 0.7 < learnt.length < 1.5 and 4.0 < learnt.duration < 9.0
    assert modes_for_variance(learnt, basis, body.x, 1e-4) > modes_for_variance(replace(learnt, length=8.0), basis, body.x, 1e-4)


def test_knots_get_denser_where_the_field_changes_fast_for_the_body():
    """So it does, steady as it is, for a body that spins in it; not for one that rests, nor where it is the same everywhere."""
    body = plate((8, 6, 2))
    basis = spatial_basis(body.x, body.volume, 16)
    angles, middle = np.radians(20.0) * np.arange(13), body.x.mean(axis=0)
    turns = np.array([[[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]] for a in angles])
    spinning = middle + (body.x - middle) @ turns.transpose(0, 2, 1)
    slow = Kernel(np.eye(3), length=1.0, duration=40.0)

    def spacing(kernel: Kernel, path: np.ndarray) -> float:
        return knots_for_variance(kernel, basis, path, 4.0, 1e-3)

    assert spacing(slow, still(body, 12)) == 4.0
    assert spacing(slow, spinning) < 4.0
    assert spacing(replace(slow, length=100.0, slope=0.0), spinning) == 4.0
    assert spacing(replace(slow, duration=8.0), still(body, 12)) == 2.0
    assert spacing(replace(slow, duration=3.0), still(body, 12)) == 1.0


def test_the_derivative_of_the_evidence_is_that_of_its_difference_quotient():
    rng = torch.Generator().manual_seed(0)
    root, z = (torch.randn(shape, generator=rng, dtype=torch.float64) for shape in ((6, 6), (6,)))
    unit = torch.eye(6, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda A: log_evidence(A @ A.T + 0.1 * unit, z), (root.requires_grad_(),))


def test_a_clip_that_tells_nothing_leaves_the_sizes_as_they_were():
    body = plate((4, 4, 2))
    basis = spatial_basis(body.x, body.volume, 4)
    blind = Prior(Kernel(np.diag([1.0, 2.0, 3.0]), length=1.5), Places.along(basis, still(body, 4), knots(4, 2.0)), np.zeros(0))
    assert maximise_evidence(blind, 1e-12 * np.eye(blind.count), np.zeros(blind.count)) is blind.kernel


def test_a_clip_that_shows_no_force_leaves_room_for_one_that_its_noise_would_hide():
    body = plate((8, 6, 2))
    basis = spatial_basis(body.x, body.volume, 10)
    prior = Prior(Kernel(np.eye(3)), Places.along(basis, still(body, 40), knots(40, 2.0)), np.zeros(0))
    for noise in (0.01, 0.1):
        learnt = maximise_evidence(prior, np.eye(prior.count) / noise**2, np.zeros(prior.count))
        assert 0.05 < np.sqrt(np.trace(learnt.covariance) / 3.0) / noise < 1.0  # all knots together show less than one alone


def test_a_squeeze_is_learnt_as_a_slope_and_not_as_a_huge_net_force():
    body = plate((7, 7, 7))
    basis = spatial_basis(body.x, body.volume, 10)
    places = Places.along(basis, still(body, 16), knots(16, 2.0))
    squeeze = np.zeros((len(places.at), 10, 3))
    squeeze[:, 1, 0], squeeze[:, 2, 2] = 1.0, -1.0  # [m/s²] along two axes, all through the clip
    # Net forces are seen ten times less well than slopes, as by noise that moves the body as a whole.
    weight = np.repeat(np.where(np.arange(10) == 0, 1.0, 10.0) ** 2 / 0.3**2, 3)
    normal = np.diag(np.tile(weight, len(places.at)))
    noise = np.random.default_rng(1).standard_normal(len(normal)) / np.sqrt(np.diag(normal))
    learnt = maximise_evidence(Prior(Kernel(np.eye(3)), places, np.zeros(0)), normal, normal @ (squeeze.ravel() + noise))
    modes = np.diag(places.covariance(learnt)) * np.trace(learnt.covariance)
    assert learnt.slope > 2.0 * (learnt.uniform + 1.0)
    assert 0.2 < np.sqrt(modes[1]) < 3.0 and np.sqrt(modes[0]) < 1.0


def test_stretch_is_held_down_and_turning_is_not() -> None:
    """A plate that has turned by a quarter: rotation fields cost nothing extra, in-plane stretch costs, out-of-plane slope does not."""
    from seeing_wind.engine.recovery.prior.stretch import stretch_precision, stretch_rows

    x = np.stack(np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.07, 0.07, 7), [-0.005, 0.005], indexing="ij"), -1).reshape(-1, 3)
    basis = spatial_basis(x, np.ones(len(x)), 4).up_to(1)
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # a quarter turn round Y
    F = np.broadcast_to(turn, (5, len(x), 3, 3))
    rows = stretch_rows(basis, x, F, knots(len(F) - 1, 4.0))
    modes = basis.phi.shape[1]
    space = np.tile(np.eye(modes), (len(rows), 1, 1))
    extra = stretch_precision(rows, np.eye(len(rows)), space, np.eye(3), 0.1)

    def cost(gradient: np.ndarray) -> float:
        """The cost of the field whose derivative with respect to the rest position is `gradient`."""
        wanted = x @ gradient.T
        c = np.linalg.lstsq(basis.phi, wanted, rcond=None)[0]
        theta = np.tile(c.ravel(), len(rows))
        return float(theta @ extra @ theta)

    spin = turn @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    swell = turn @ np.diag([1.0, 1.0, 0.0])
    tilt = turn @ np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert cost(swell) > 0.0
    assert cost(spin) < 1e-9 * cost(swell) and cost(tilt) < 1e-9 * cost(swell)


def test_evidence_of_sizes_beyond_all_measure_is_finite_and_small():
    rows = torch.from_numpy(np.random.default_rng(0).normal(size=(60, 20)))
    data = rows @ torch.ones(20, dtype=torch.float64)
    evidence = [float(log_evidence(size * rows @ rows.T, data)) for size in (1.0, 1e8, 1e18, 1e24)]
    assert np.isfinite(evidence).all() and (np.diff(evidence) < 0.0).all()


@pytest.mark.parametrize("noise", [0.01, 100.0])
def test_a_belief_is_given_up_when_the_clip_speaks_against_it(noise):
    """Fields that stretch a body, seen sharply, refute that none does; seen through noise beyond their size they refute nothing."""
    body = plate((8, 6, 2))
    basis, path = spatial_basis(body.x, body.volume, 6), still(body, 40)
    F = np.broadcast_to(np.eye(3), (*path.shape[:2], 3, 3))
    open_to_all = Prior(Kernel(9.0 * np.eye(3), uniform=0.1), Places.along(basis, path, knots(len(path) - 1, 2.0)), np.zeros(0))
    belief = open_to_all.with_stretch_penalty(basis, body.x, F, 0.3)
    white = np.random.default_rng(6).standard_normal(belief.count)
    for true in (belief, open_to_all):
        draw = np.linalg.cholesky(np.linalg.inv(true.precision())) @ white
        point = Linearisation.at(np.zeros(len(draw)), -draw / noise, np.eye(len(draw)) / noise)
        kept = prefer_belief(belief, open_to_all, point)
        assert kept is (open_to_all if true is open_to_all and noise < 1.0 else belief)


@pytest.mark.parametrize(("sigma", "low", "high"), [(0.0, 0.0, 0.0), (1e-3, 0.9, 1.0)])
def test_the_share_of_noise_is_none_of_exact_points_and_most_of_noisy_ones(sigma, low, high):
    body = plate((4, 3, 2))
    still = np.repeat(body.x[None], 10, axis=0)
    channels = point_channels(body, PointTargets(still, np.ones(still.shape[:2], bool), every(body), sigma=sigma), False)
    assert low <= noise_share(Objective([channels])) <= high
