"""Basis, prior, residuals and the damped solver, each against what it must satisfy."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import ObjectError, UsageError
from seeing_wind.engine.records import Attachment, Camera, Particles, PointTargets, TrackTargets
from seeing_wind.engine.recovery.prior.basis import hats, knots, knots_between, spatial_basis, velocity_basis
from seeing_wind.engine.recovery.prior.evidence import log_evidence, maximise_evidence, prefer_belief
from seeing_wind.engine.recovery.prior.kernel import Kernel, Places, Prior, modes_for_variance
from seeing_wind.engine.recovery.prior.learning import noise_share
from seeing_wind.engine.recovery.solve.gauss_newton import Linearisation, solve
from seeing_wind.engine.recovery.targets.channels import noise_of
from seeing_wind.engine.recovery.targets.objective import Objective
from seeing_wind.engine.recovery.targets.points import point_channels, rotations, wild
from seeing_wind.engine.recovery.targets.tracks import edge_on, track_channels

rng = np.random.default_rng(3)


def block(shape, spacing=0.02):
    axes = [(np.arange(n) - (n - 1) / 2) * spacing for n in shape]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return Particles(x, np.full(len(x), spacing**3), np.zeros(len(x), bool), spacing)


def every(particles):
    return Attachment(np.arange(len(particles.x), dtype=np.int32)[:, None], np.ones((len(particles.x), 1)))


def test_modes_are_orthonormal_and_their_gradients_are_right():
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
    plate = block((20, 14, 2), 0.01)
    basis = spatial_basis(plate.x, plate.volume, 30)
    assert (basis.degree == 1).sum() == 2 and (basis.degree == 2).sum() == 3
    rod = block((40, 2, 2), 0.01)
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
    body = block((4, 3, 5))
    basis = spatial_basis(body.x, body.volume, 4)
    velocity, gradient = velocity_basis(body.x, basis, body.pinned)
    assert velocity.shape == (6, 60, 3)
    turned = np.cross([0.0, 0.0, 1.0], body.x) / basis.radius
    np.testing.assert_allclose(velocity[5], turned, atol=1e-12)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", gradient[5], body.x), turned, atol=1e-12)
    held = body.x[:, 2] < -0.03
    velocity, gradient = velocity_basis(body.x, basis, held)
    assert velocity.shape == (3, 60, 3) and (velocity[:, held] == 0.0).all() and (gradient[:, held] == 0.0).all()


def still(body, frames):
    return np.repeat(body.x[None], frames + 1, axis=0)


def test_prior_is_smooth_in_time_and_the_inverse_of_its_precision():
    body = block((8, 6, 2))
    basis = spatial_basis(body.x, body.volume, 6)
    prior = Prior(Kernel(9.0 * np.eye(3)), Places.along(basis, still(body, 40), knots(40, 2.0)), np.array([0.1]))
    covariance = np.linalg.inv(prior.precision())
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), prior.deviation(), rtol=1e-5)
    first, modes = np.diag(covariance)[:-1].reshape(-1, 6, 3)[0], prior.places.covariance(prior.kernel)
    assert 7.0 < first[0, 0] < 9.0 and first[0, 0] > 4 * first[1:].max()  # most of it is the same all over a small body
    assert modes[0, 6] > 0.8 * modes[0, 0] > modes[0, -6] > 0.0


def test_prior_knows_that_the_field_stays_where_it_is_when_the_body_moves_on():
    body = block((8, 6, 2))
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
    body = block((8, 6, 2))
    basis = spatial_basis(body.x, body.volume, 10)
    places = Places.along(basis, still(body, 60), knots(60, 2.0))
    true = Kernel(np.diag([0.3, 0.3, 2.4]), length=1.0, duration=6.0, uniform=0.05)
    believed = Prior(true, places, np.zeros(0))
    draw = np.linalg.cholesky(np.linalg.inv(believed.precision())) @ np.random.default_rng(4).standard_normal(believed.count)
    normal = np.eye(believed.count) / 0.01**2
    learnt = maximise_evidence(Prior(Kernel(np.eye(3)), places, np.zeros(0)), normal, normal @ draw)
    size = np.diag(learnt.covariance)
    assert size[2] > 4 * size[0] and size[2] > 4 * size[1] and 0.4 < size.sum() / 3.0 < 2.5
    assert 0.7 < learnt.length < 1.5 and 4.0 < learnt.duration < 9.0
    assert modes_for_variance(learnt, basis, body.x, 1e-4) > modes_for_variance(replace(learnt, length=8.0), basis, body.x, 1e-4)


def test_the_derivative_of_the_evidence_is_that_of_its_difference_quotient():
    rng = torch.Generator().manual_seed(0)
    root, z = (torch.randn(shape, generator=rng, dtype=torch.float64) for shape in ((6, 6), (6,)))
    unit = torch.eye(6, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda A: log_evidence(A @ A.T + 0.1 * unit, z), (root.requires_grad_(),))


def test_a_clip_that_tells_nothing_leaves_the_sizes_as_they_were():
    body = block((4, 4, 2))
    basis = spatial_basis(body.x, body.volume, 4)
    blind = Prior(Kernel(np.diag([1.0, 2.0, 3.0]), length=1.5), Places.along(basis, still(body, 4), knots(4, 2.0)), np.zeros(0))
    assert maximise_evidence(blind, 1e-12 * np.eye(blind.count), np.zeros(blind.count)) is blind.kernel


def test_a_squeeze_is_learnt_as_a_slope_and_not_as_a_huge_net_force():
    body = block((7, 7, 7))
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


def test_residuals_of_points_are_zero_for_the_truth_and_white_for_noise():
    body = block((6, 5, 4))
    moved = body.x + 0.1 * np.arange(30)[:, None, None] ** 2 / 900 * [1.0, 0.0, 0.5]
    exact = Objective([point_channels(body, PointTargets(moved, np.ones((30, 120), bool), every(body)), False)])
    assert np.abs(exact.residual(moved[None])).max() < 1e-12
    sizes = []
    for _ in range(6):
        noisy = moved + 0.003 * rng.standard_normal(moved.shape)
        targets = PointTargets(noisy - noisy[0] + body.x + (noisy[0] - moved[0]), np.ones((30, 120), bool), every(body), sigma=0.003)
        objective = Objective([point_channels(body, targets, False)])
        white = objective.whiten(objective.residual(moved[None]))[0]
        sizes.append(np.mean(white[white != 0.0] ** 2))
    assert 0.8 < np.mean(sizes) < 1.2


def test_points_seen_now_and_then():
    body = block((6, 5, 4))
    moved = np.repeat(body.x[None], 10, axis=0)
    visible = rng.random((10, 120)) < 0.3
    visible[4] = False
    hidden = np.where(visible[..., None], moved, np.nan)
    objective = Objective([point_channels(body, PointTargets(hidden, visible, every(body)), False)])
    assert not objective.used[4].any() and objective.used[5].any()
    assert np.abs(objective.residual(moved[None])).max() < 1e-9


def test_whitening_of_the_first_frames_does_not_know_the_later_ones():
    body = block((6, 5, 4))
    targets = PointTargets(np.repeat(body.x[None], 12, axis=0), np.ones((12, 120), bool), every(body), sigma=0.001)
    objective = Objective([point_channels(body, targets, False)])
    raw = rng.standard_normal((1, 12, objective.used.shape[1]))
    whole = objective.whiten(raw).reshape(-1, 12)
    part = objective.until(6).whiten(raw[:, :7]).reshape(-1, 7)
    np.testing.assert_allclose(whole[:, :7], part)


def camera():
    return Camera(320, 240, 300.0, 300.0, 159.5, 119.5, front_view(1.0))


def test_residuals_of_tracks_and_outliers():
    body = block((6, 2, 5))
    xy = np.repeat(camera().project(body.x)[0][None], 9, axis=0)
    visible = np.ones((9, 60), bool)
    xy[5, 7] += [40.0, 0.0]
    targets = TrackTargets(xy, visible, np.full((9, 60), 0.2), camera(), every(body))
    objective = Objective([track_channels(body, targets, False)])
    still = np.repeat(body.x[None], 9, axis=0)
    raw = objective.residual(still[None])
    assert raw[0, 5, 14] == pytest.approx(-40.0) and np.abs(np.delete(raw[0], 14, axis=1)).max() < 1e-9
    robust = objective.reweighted(raw[0])
    before, after = (np.abs(one.whiten(raw)).max() for one in (objective, robust))
    assert after < 0.2 * before
    assert objective.root_mean_square(still)[0] < 1e-9
    behind = still[None] - [0.0, 2.0, 0.0]
    assert np.isfinite(objective.whiten(objective.residual(behind))).all()


def test_edge_on_tracks_are_dropped():
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), -1).reshape(-1, 2) * 10
    xy = np.stack([grid, grid * [0.6, 1.0], grid * [0.1, 1.0]])
    assert list(edge_on(xy, np.ones((3, 25), bool)).mean(axis=1)) == [0.0, 0.0, 1.0]


def test_noise_is_told_from_motion():
    time = np.arange(30)[:, None] / 30.0
    smooth = 0.05 * np.sin(2 * np.pi * 1.5 * time + np.arange(3))
    assert noise_of(smooth) < 2e-5
    assert noise_of(smooth + 0.001 * rng.standard_normal(smooth.shape)) == pytest.approx(0.001, rel=0.3)
    assert noise_of(smooth[:5]) == 0.0
    # Not too small on average, either, for clips as short as those of a fall.
    draws = [noise_of(rng.standard_normal((16, 3))) for _ in range(400)]
    assert np.mean(draws) == pytest.approx(0.98, abs=0.025)


def test_bad_targets_are_refused_with_a_hint():
    body = block((3, 3, 3))
    x, visible = np.repeat(body.x[None], 5, axis=0), np.ones((5, 27), bool)
    for targets, error in (
        (PointTargets(np.where(x == x[0, 0], np.nan, x), visible, every(body)), UsageError),
        (PointTargets(x[:, :5], visible, every(body)), UsageError),
        (PointTargets(x[:2], visible[:2], every(body)), ObjectError),
        (PointTargets(x, visible, Attachment(np.full((27, 1), 99, np.int32), np.ones((27, 1)))), UsageError),
    ):
        with pytest.raises(error) as caught:
            point_channels(body, targets, False)
        assert caught.value.hint
    with pytest.raises(UsageError):
        track_channels(body, TrackTargets(x[..., :2], visible, np.zeros((5, 27)), camera(), every(body)), False)


def test_gauss_newton_finds_the_minimum_of_a_curved_problem_and_steps_round_breakdowns():
    precision, truth = np.eye(2), np.array([1.2, 0.7])

    def values(theta):
        return np.stack([theta[:, 0] + theta[:, 1] ** 3, np.exp(theta[:, 0]) - theta[:, 1], 3 * theta[:, 1]], axis=1)

    observed = values(truth[None])[0]

    def residuals(theta):
        out = 100.0 * (values(theta) - observed)
        out[theta[:, 0] > 2.0] = np.inf  # as a simulation that bursts
        return out

    def linearise(theta):
        step = 1e-6
        base = residuals(theta[None])[0]
        return Linearisation.at(theta, base, np.stack([(residuals((theta + step * e)[None])[0] - base) / step for e in np.eye(2)]))

    found = solve(np.zeros(2), np.zeros(2), precision, residuals, linearise, 20)
    np.testing.assert_allclose(found.theta, truth, atol=2e-3)
    assert found.converged and found.iterations < 20


def test_stretch_is_held_down_and_turning_is_not() -> None:
    """A plate that has turned by a quarter: rotation fields cost nothing extra, in-plane stretch costs, out-of-plane slope does not."""
    from seeing_wind.engine.recovery.prior.stretch import stretch_precision, stretch_rows

    x = np.stack(np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.07, 0.07, 7), [-0.005, 0.005], indexing="ij"), -1).reshape(-1, 3)
    basis = spatial_basis(x, np.ones(len(x)), 4, 1)
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # a quarter turn round Y
    F = np.broadcast_to(turn, (5, len(x), 3, 3))
    rows = stretch_rows(basis, x, F, knots(len(F) - 1, 4.0))
    modes = basis.phi.shape[1]
    space = np.tile(np.eye(modes), (len(rows), 1, 1))
    extra = stretch_precision(rows, np.eye(len(rows)), space, np.eye(3), 0.1)

    def cost(gradient: np.ndarray) -> float:
        """Of the field whose derivative with respect to the rest position is `gradient`."""
        wanted = x @ gradient.T
        c = np.linalg.lstsq(basis.phi, wanted, rcond=None)[0]
        theta = np.tile(c.ravel(), len(rows))
        return float(theta @ extra @ theta)

    spin = turn @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    swell = turn @ np.diag([1.0, 1.0, 0.0])
    tilt = turn @ np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert cost(swell) > 0.0
    assert cost(spin) < 1e-9 * cost(swell) and cost(tilt) < 1e-9 * cost(swell)


def test_wild_points_are_left_out_and_no_others():
    body = block((8, 6, 2))
    pictures = 6
    bend = np.stack([body.x + [0.0, 0.0, 1.0] * (2.0 * t * 0.01 * (body.x[:, :1] / 0.08) ** 2) for t in range(pictures)])
    moved = bend + 0.0005 * rng.standard_normal(bend.shape)
    lost = rng.random((pictures, 96)) < 0.1
    lost[0] = False
    moved[lost] += 0.05 * rng.standard_normal((lost.sum(), 3)) + 0.05
    targets = PointTargets(moved, np.ones(lost.shape, bool), every(body))
    modes = spatial_basis(body.x, np.ones(96), 12).phi
    np.testing.assert_array_equal(wild(targets, body.x, modes, body.spacing), lost)


def test_evidence_of_sizes_beyond_all_measure_is_finite_and_small():
    rows = torch.from_numpy(np.random.default_rng(0).normal(size=(60, 20)))
    data = rows @ torch.ones(20, dtype=torch.float64)
    evidence = [float(log_evidence(size * rows @ rows.T, data)) for size in (1.0, 1e8, 1e18, 1e24)]
    assert np.isfinite(evidence).all() and (np.diff(evidence) < 0.0).all()


@pytest.mark.parametrize("noise", [0.01, 100.0])
def test_a_belief_is_given_up_when_the_clip_speaks_against_it(noise):
    """Fields that stretch a body, seen sharply, refute that none does; seen through noise beyond their size they refute nothing."""
    body = block((8, 6, 2))
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


def test_the_noise_of_picture_0_turns_with_the_body():
    """Residuals of a body that turns by half, built from noisy points, have the covariance that the channels say they have."""
    body, angles = block((8, 6, 2)), np.linspace(0.0, np.pi, 10)
    turns = np.stack([[[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]] for a in angles])
    true = np.einsum("tij,nj->tni", turns, body.x)
    np.testing.assert_allclose(rotations(true, np.ones(true.shape[:2], bool)), turns, atol=1e-9)
    random, series = np.random.default_rng(8), []
    for _ in range(300):
        noise = 0.002 * random.standard_normal(true.shape)
        built = replace(body, x=body.x + noise[0])
        channels = point_channels(built, PointTargets(true + noise, np.ones(true.shape[:2], bool), every(body), sigma=0.002), False)
        moved = np.einsum("tij,nj->tni", turns, built.x)
        series.append([channels.residual(moved[None, t], t)[0, :3] for t in range(1, 10)])
    for axis in range(3):  # of the first mode, the mean
        found = np.cov(np.array(series)[:, :, axis].T)
        wanted = replace(channels, mismatch_scale=0.0).covariance(axis)[1:, 1:]
        np.testing.assert_allclose(found, wanted, atol=0.3 * wanted[0, 0])


@pytest.mark.parametrize(("sigma", "low", "high"), [(0.0, 0.0, 0.0), (1e-3, 0.9, 1.0)])
def test_the_share_of_noise_is_none_of_exact_points_and_most_of_noisy_ones(sigma, low, high):
    body = block((4, 3, 2))
    still = np.repeat(body.x[None], 10, axis=0)
    channels = point_channels(body, PointTargets(still, np.ones(still.shape[:2], bool), every(body), sigma=sigma), False)
    assert low <= noise_share(Objective([channels])) <= high
