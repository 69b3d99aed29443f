"""Residuals of points and tracks, whitened, and what is left out of them."""

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import ObjectError, UsageError
from seeing_wind.engine.records import Attachment, Camera, PointTargets, TrackTargets
from seeing_wind.engine.recovery.prior.basis import spatial_basis
from seeing_wind.engine.recovery.targets.channels import noise_of
from seeing_wind.engine.recovery.targets.mismatch import mismatch_covariance
from seeing_wind.engine.recovery.targets.objective import Objective
from seeing_wind.engine.recovery.targets.points import point_channels, rotations, wild
from seeing_wind.engine.recovery.targets.tracks import edge_on, track_channels
from tests.engine.recovery.bodies import every, plate


def test_residuals_of_points_are_zero_for_the_truth_and_white_for_noise():
    rng = np.random.default_rng(3)
    body = plate((6, 5, 4))
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
    rng = np.random.default_rng(3)
    body = plate((6, 5, 4))
    moved = np.repeat(body.x[None], 10, axis=0)
    visible = rng.random((10, 120)) < 0.3
    visible[4] = False
    hidden = np.where(visible[..., None], moved, np.nan)
    objective = Objective([point_channels(body, PointTargets(hidden, visible, every(body)), False)])
    assert not objective.used[4].any() and objective.used[5].any()
    assert np.abs(objective.residual(moved[None])).max() < 1e-9


def test_whitening_of_the_first_frames_does_not_know_the_later_ones():
    rng = np.random.default_rng(3)
    body = plate((6, 5, 4))
    targets = PointTargets(np.repeat(body.x[None], 12, axis=0), np.ones((12, 120), bool), every(body), sigma=0.001)
    objective = Objective([point_channels(body, targets, False)])
    raw = rng.standard_normal((1, 12, objective.used.shape[1]))
    whole = objective.whiten(raw).reshape(-1, 12)
    part = objective.until(6).whiten(raw[:, :7]).reshape(-1, 7)
    np.testing.assert_allclose(whole[:, :7], part)


def camera():
    return Camera(320, 240, 300.0, 300.0, 159.5, 119.5, front_view(1.0))


def test_residuals_of_tracks_and_outliers():
    body = plate((6, 2, 5))
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


def test_frames_at_the_ends_whose_tracks_leave_the_others_count_little():
    body, rng = plate((6, 2, 5)), np.random.default_rng(5)
    xy = np.repeat(camera().project(body.x)[0][None], 20, axis=0) + 0.2 * rng.standard_normal((20, 60, 2))
    still = np.repeat(body.x[None], 20, axis=0)

    def judged(where, size, first=0, last=19):
        moved = xy.copy()
        moved[where] += size * rng.standard_normal((len(where), 60, 2))
        targets = TrackTargets(moved, np.ones((20, 60), bool), np.full((20, 60), 0.2), camera(), every(body))
        part = Objective([track_channels(body, targets, False)]).between(first, last)
        return part.reweighted(part.residual(still[None, first : last + 1])[0]).channels[0]

    for where in ([18, 19], [1, 2, 3]):
        one = judged(where, 8.0)
        assert list(np.flatnonzero(one.wild)) == where
        inside = np.setdiff1d(np.arange(4, 17), where)
        assert one.inflation[where].min() > 1000.0 * np.median(one.inflation[inside])
    for where, size in (([10, 11], 8.0), ([18, 19], 0.2), ([0], 8.0)):  # in the middle, as the others, and frame 0, which shows nothing
        assert not judged(where, size).wild.any()
    # The end of a block is not that of the clip.
    assert not judged([8, 9], 8.0, 0, 9).wild.any()
    assert list(np.flatnonzero(judged([18, 19], 8.0, 8, 19).wild)) == [18, 19]


def test_edge_on_tracks_are_dropped():
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), -1).reshape(-1, 2) * 10
    xy = np.stack([grid, grid * [0.6, 1.0], grid * [0.1, 1.0]])
    assert list(edge_on(xy, np.ones((3, 25), bool)).mean(axis=1)) == [0.0, 0.0, 1.0]


def test_noise_is_told_from_motion():
    rng = np.random.default_rng(3)
    time = np.arange(30)[:, None] / 30.0
    smooth = 0.05 * np.sin(2 * np.pi * 1.5 * time + np.arange(3))
    assert noise_of(smooth) < 2e-5
    assert noise_of(smooth + 0.001 * rng.standard_normal(smooth.shape)) == pytest.approx(0.001, rel=0.3)
    assert noise_of(smooth[:5]) == 0.0
    # Not too small on average, either, for clips as short as those of a fall.
    draws = [noise_of(rng.standard_normal((16, 3))) for _ in range(400)]
    assert np.mean(draws) == pytest.approx(0.98, abs=0.025)


def test_bad_targets_are_refused_with_a_hint():
    body = plate((3, 3, 3))
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


def test_wild_points_are_left_out_and_no_others():
    rng = np.random.default_rng(3)
    body = plate((8, 6, 2))
    frames = 6
    bend = np.stack([body.x + [0.0, 0.0, 1.0] * (2.0 * t * 0.01 * (body.x[:, :1] / 0.08) ** 2) for t in range(frames)])
    moved = bend + 0.0005 * rng.standard_normal(bend.shape)
    lost = rng.random((frames, 96)) < 0.1
    lost[0] = False
    moved[lost] += 0.05 * rng.standard_normal((lost.sum(), 3)) + 0.05
    targets = PointTargets(moved, np.ones(lost.shape, bool), every(body))
    modes = spatial_basis(body.x, np.ones(96), 12).phi
    np.testing.assert_array_equal(wild(targets, body.x, modes, body.spacing), lost)


def test_the_noise_of_frame_0_turns_with_the_body():
    """Residuals of a body that makes half a turn, built from noisy points, have the covariance that the channels state."""
    body, angles = plate((5, 4, 2)), np.linspace(0.0, np.pi, 10)
    turns = np.stack([[[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]] for a in angles])
    true = np.einsum("tij,nj->tni", turns, body.x)
    np.testing.assert_allclose(rotations(true, np.ones(true.shape[:2], bool)), turns, atol=1e-9)
    random, series = np.random.default_rng(8), []
    for _ in range(150):
        noise = 0.002 * random.standard_normal(true.shape)
        built = replace(body, x=body.x + noise[0])
        channels = point_channels(built, PointTargets(true + noise, np.ones(true.shape[:2], bool), every(body), sigma=0.002), False)
        moved = np.einsum("tij,nj->tni", turns, built.x)
        series.append([channels.residual(moved[None, t], t)[0, :3] for t in range(1, 10)])
    for axis in range(3):  # of the first mode, the mean
        found = np.cov(np.array(series)[:, :, axis].T)
        wanted = replace(channels, mismatch_scale=0.0).covariance(axis)[1:, 1:]
        np.testing.assert_allclose(found, wanted, atol=0.3 * wanted[0, 0])


def test_the_mismatch_of_a_body_in_its_built_place_grows_from_there():
    whole, grown = (mismatch_covariance(60, 0.1, 2.0, 8.0, 3.0, from_rest) for from_rest in (False, True))
    assert grown[0, 0] == pytest.approx(3.0 * 0.1**2) and np.allclose(grown[0, 1:], 0.0)
    assert (np.diff(np.diag(grown)) >= 0.0).all() and grown[-1, -1] == pytest.approx(whole[-1, -1], rel=1e-5)
    assert np.linalg.eigvalsh(grown).min() > 0.0
