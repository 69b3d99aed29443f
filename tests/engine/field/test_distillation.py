"""Distilling: what the representations keep of the samples, gradients, confidence, determinism."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.field import ForceField, distances, distill, distillation, sample_points
from seeing_wind.engine.look.report.accuracy import field_errors, uniform_errors
from seeing_wind.engine.progress import Cancelled, Progress

from .conftest import FPS, FRAMES, recovery_of
from .test_analytic import differences


@pytest.fixture(scope="module")
def triplane(tumbling) -> ForceField:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(distillation, "ITERATIONS", 500)  # of 800
        return distill(*tumbling, FPS)


def test_the_triplane_keeps_a_curved_field(tumbling, triplane):
    recovery, _ = tumbling
    flat = uniform_errors(recovery.force_density)
    assert flat[0] > 10 and flat[1] > 6, "the scene must need the spatial part"
    magnitude, direction = field_errors(recovery.force_density, sample_points(triplane, recovery.x[:-1])[0])
    assert magnitude < 0.8 and direction < 0.8


def test_a_blow_of_two_frames_is_kept_among_many_without_a_force():
    x = np.tile(np.random.default_rng(0).uniform([-0.02, -0.02, -0.2], [0.02, 0.02, 0.2], (150, 3)), (81, 1, 1))
    force = np.zeros((80, 150, 3))
    force[2:4] = [3000.0, 500.0, 0.0] * (1.0 + x[0, :, 2:])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(distillation, "ITERATIONS", 300)
        messages: list[dict] = []
        field = distill(*recovery_of(force, x, 30.0), FPS, progress=Progress(messages.append))
    got = sample_points(field, x[:-1])[0]
    assert np.linalg.norm(got[2:4] - force[2:4]) < 0.03 * np.linalg.norm(force)
    assert np.abs(got[4:]).max() < 0.03 * np.abs(force).max()
    assert not any(message["type"] == "warning" for message in messages)


def test_no_force_is_none_everywhere_and_not_fitted_for():
    told: list[dict] = []
    x = np.tile(np.random.default_rng(0).uniform(-0.1, 0.1, (60, 3)), (9, 1, 1))
    for representation in ("causal_triplane", "kplanes", "point"):
        field = distill(*recovery_of(np.zeros((8, 60, 3)), x, 30.0), FPS, representation, progress=Progress(told.append))
        assert not field.sample(x[0] + 0.03, 4)[0].any()
    assert not told


def test_between_the_samples_it_is_close_to_the_true_field(tumbling, triplane, known_wind):
    recovery, _ = tumbling
    between = (recovery.x[:-1, :100] + recovery.x[:-1, 100:200]) / 2
    want, got = sample_points(known_wind, between)[0], sample_points(triplane, between)[0]
    assert np.sqrt(((want - got) ** 2).sum(-1).mean()) < 0.05 * np.sqrt((want**2).sum(-1).mean())


def test_the_gradient_is_that_of_the_force_and_near_the_true_one(tumbling, triplane, known_wind):
    x = tumbling[0].x[11]
    gradient = triplane.gradient(x, 11)
    assert np.abs(gradient - differences(triplane, x, 11, 1e-6)).max() < 1e-4 * np.abs(gradient).max()
    # only along the plate has the field been seen
    along = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[2][:2]
    want, got = known_wind.gradient(x, 11) @ along.T, gradient @ along.T
    assert np.sqrt(((want - got) ** 2).mean()) < 0.35 * np.sqrt((want**2).mean())


def test_away_from_the_body_the_force_stays_near_the_mean_and_is_not_trusted(tumbling, triplane):
    recovery, _ = tumbling
    frame = 3
    corner = np.array([triplane.box[0], triplane.box[1], [10.0, 10.0, 10.0]])
    force, confidence = triplane.sample(corner, frame)
    strength = np.linalg.norm(recovery.force_density[frame], axis=1)
    assert (np.linalg.norm(force, axis=1) < 1.5 * strength.max()).all()
    assert (confidence < 0.1).all()


def test_confidence_follows_coverage_and_noise(tumbling):
    recovery, particles = tumbling
    side = recovery.x[0, :, 0] > 0
    rms = np.sqrt((recovery.force_density**2).sum(-1).mean())
    unsure, _ = recovery_of(recovery.force_density, recovery.x, np.where(side, 2 * rms, 0.01 * rms))
    field = distill(unsure, particles, FPS, "point")
    _, confidence = field.sample(recovery.x[5], 5)
    assert ((0 <= confidence) & (confidence <= 1)).all()
    assert np.median(confidence[~side]) > 0.9 and np.median(confidence[side]) < 0.2
    assert (field.sample(recovery.x[5] + [0, 0.3, 0], 5)[1] < 0.1).all()


def test_how_far_a_place_is_from_the_object_in_each_frame(tumbling):
    """Against all distances to its particles, a spacing of which count as the object itself; and the gradient by differences."""
    recovery, particles = tumbling
    field = distill(recovery, particles, FPS, "point")
    on = distances(field, recovery.x[:-1])
    assert not on.any() and not field.away(recovery.x[7], 7)[1].any()
    points, h = np.random.default_rng(1).uniform(field.box[0] - 0.2, field.box[1] + 0.2, (200, 3)), 1e-6
    for frame in (0, 20):
        found, gradient = field.away(points, frame)
        nearest = np.linalg.norm(points[:, None] - recovery.x[frame], axis=-1).min(axis=1)
        assert found == pytest.approx(np.maximum(nearest - particles.spacing, 0.0), abs=1e-6) and (found > 0.05).sum() > 100
        ends = [np.stack([field.away(points + sign * step, frame)[0] for step in h * np.eye(3)], axis=1) for sign in (1.0, -1.0)]
        assert gradient == pytest.approx((ends[0] - ends[1]) / (2.0 * h), abs=1e-3)
    assert np.array_equal(distances(field, points, 20), found)
    with pytest.raises(UsageError, match="no frame"):
        field.away(points, FRAMES)


@pytest.mark.slow
def test_kplanes_keep_the_field_too(tumbling, monkeypatch):
    recovery, particles = tumbling
    monkeypatch.setattr(distillation, "ITERATIONS", 300)  # they need fewer
    field = distill(recovery, particles, FPS, "kplanes")
    magnitude, direction = field_errors(recovery.force_density, sample_points(field, recovery.x[:-1])[0])
    assert magnitude < 1 and direction < 1


def test_point_forces_return_the_samples(tumbling):
    recovery, particles = tumbling
    field = distill(recovery, particles, FPS, "point")
    assert np.array_equal(sample_points(field, recovery.x[:-1])[0], recovery.force_density)
    assert not field.gradient(recovery.x[0], 0).any()


def test_wrong_input_is_refused(tumbling):
    recovery, particles = tumbling
    with pytest.raises(UsageError, match="voxels"):
        distill(recovery, particles, FPS, "voxels")
    broken = recovery.force_density.copy()
    broken[2, 3, 1] = np.nan
    with pytest.raises(UsageError, match="not finite"):
        distill(recovery_of(broken, recovery.x)[0], particles, FPS)


def test_it_can_be_cancelled_and_reports(tumbling):
    messages: list[dict] = []
    progress = Progress(messages.append, lambda: len(messages) > 2)
    with pytest.raises(Cancelled):
        distill(*tumbling, FPS, progress=progress)
    assert len(messages) == 3 and messages[-1]["misfit"] > 0


def test_every_frames_code_starts_from_its_predecessor():
    import torch

    from seeing_wind.engine.field.representations.triplane import CausalTimeEncoder

    torch.manual_seed(0)
    encoder = CausalTimeEncoder(FRAMES, 8)
    before = encoder.codes().detach()
    with torch.no_grad():
        encoder.step[9].add_(0.1)
    moved = (encoder.codes().detach() - before).abs().amax(dim=1) > 1e-6
    assert moved.tolist() == [t >= 10 for t in range(FRAMES)], "a step changes its frame and all later ones, none before"
