"""Known fields: exact gradients, reproducible gusts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scenes.gusts import GustField
from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.field import ForceField
from tests.engine.fields import UniformField

BOX = np.array([[-0.5, -0.2, -0.6], [0.5, 0.2, 0.6]])
POINTS = np.random.default_rng(0).uniform(BOX[0], BOX[1], (200, 3))


def gusts(seed: int = 1, frames: int = 60, fps: float = 30.0) -> GustField:
    return GustField(seed, BOX, fps, frames, np.array([0.0, 0.0, 20.0]), 10.0, wavelength=0.4, period=0.8)


def differences(field: ForceField, points: np.ndarray, frame: int, h: float = 1e-5) -> np.ndarray:
    """Central differences, d f_i / d x_j."""
    steps = h * np.eye(3)
    columns = [(field.sample(points + step, frame)[0] - field.sample(points - step, frame)[0]) / (2 * h) for step in steps]
    return np.stack(columns, axis=-1)


def test_uniform_field_is_the_same_everywhere():
    field = UniformField(BOX, 24, 3, np.array([1.0, -2.0, 3.0]))
    force, confidence = field.sample(POINTS, 2)
    assert np.array_equal(force, np.tile([1.0, -2.0, 3.0], (200, 1)))
    assert np.array_equal(confidence, np.ones(200))
    assert not field.gradient(POINTS, 0).any()


def test_uniform_field_may_change_in_time():
    force = np.arange(9.0).reshape(3, 3)
    field = UniformField(BOX, 24, 3, force)
    assert np.array_equal(field.sample(POINTS[:1], 1)[0][0], force[1])


def test_gust_gradient_is_exact_and_free_of_divergence():
    field = gusts()
    gradient = field.gradient(POINTS, 7)
    assert np.abs(gradient - differences(field, POINTS, 7)).max() < 1e-5 * np.abs(gradient).max()
    assert np.abs(np.trace(gradient, axis1=1, axis2=2)).max() < 1e-10 * np.abs(gradient).max()


def test_gusts_have_the_asked_mean_and_strength():
    seeds = [gusts(seed) for seed in range(12)]
    forces = np.array([[field.sample(POINTS, t)[0] for t in range(0, 60, 6)] for field in seeds])
    assert np.abs(forces.mean(axis=(0, 1, 2)) - [0, 0, 20]).max() < 2.5
    assert np.sqrt(((forces - [0, 0, 20]) ** 2).sum(axis=-1).mean()) == pytest.approx(10, rel=0.2)


def test_gusts_vary_across_space_and_smoothly_in_time():
    field = gusts()
    forces = np.array([field.sample(POINTS, t)[0] for t in range(60)])
    assert forces.std(axis=1).mean() > 2.0
    assert np.abs(np.diff(forces, axis=0)).max() < 0.35 * np.ptp(forces)


def test_gusts_do_not_depend_on_the_clips_length_or_frame_rate():
    long, fast = gusts(frames=90).sample(POINTS, 10)[0], gusts(frames=120, fps=60.0).sample(POINTS, 20)[0]
    assert np.allclose(gusts().sample(POINTS, 10)[0], long)
    assert np.allclose(long, fast)
    assert not np.allclose(long, gusts(seed=2).sample(POINTS, 10)[0])


def test_a_box_without_volume_is_refused():
    with pytest.raises(UsageError):
        UniformField([[0, 0, 0], [1, 0, 1]], 30, 4, np.ones(3))


@pytest.mark.parametrize("frame", [-1, 3])
def test_frames_outside_the_field_are_refused(frame):
    with pytest.raises(UsageError, match="frame"):
        UniformField(BOX, 30, 3, np.ones(3)).sample(POINTS, frame)


@pytest.mark.parametrize("points", [np.full((2, 3), np.nan), np.zeros((2, 2)), np.zeros(3)])
def test_points_that_are_none_are_refused(points):
    field = UniformField(BOX, 30, 3, np.ones(3))
    for ask in (field.sample, field.gradient):
        with pytest.raises(UsageError):
            ask(points, 0)
