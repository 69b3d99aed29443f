"""Attachments: which particles carry which points."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.errors import ObjectError
from seeing_wind.engine.observe.object.motion.control import attach


def affine(rng: np.random.Generator):
    matrix, shift = np.eye(3) + 0.5 * rng.normal(size=(3, 3)), rng.normal(size=3)
    return lambda x: x @ matrix.T + shift


@pytest.mark.parametrize("uniform", [False, True])
def test_affine_motion_is_reproduced(uniform: bool) -> None:
    rng = np.random.default_rng(1)
    particles, points = rng.uniform(size=(200, 3)), rng.uniform(0.0, 1.0, size=(50, 3))
    attachment = attach(points, particles, uniform=uniform)
    assert attachment.index.shape == attachment.weight.shape == (50, 16)
    assert attachment.weight.sum(axis=1) == pytest.approx(np.ones(50))
    motion = affine(rng)
    assert attachment.follow(motion(particles)) == pytest.approx(motion(points), abs=1e-10)
    assert np.abs(attachment.weight).sum(axis=1).max() < 6.0


def test_two_layers_carry_a_point_in_front_of_them() -> None:
    rng = np.random.default_rng(2)
    grid = np.stack(np.meshgrid(np.arange(8.0), np.arange(8.0), [0.0, 0.3]), -1).reshape(-1, 3)
    points = rng.uniform([1, 1, -0.2], [6, 6, 0.5], size=(20, 3))
    attachment, motion = attach(points, grid), affine(rng)
    assert attachment.follow(motion(grid)) == pytest.approx(motion(points), abs=1e-9)
    assert (attachment.weight**2).sum(axis=1).max() < 2.0


def test_single_layer_drops_the_offset_and_stays_bounded() -> None:
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0), [0.0]), -1).reshape(-1, 3)
    attachment = attach(np.array([[2.3, 3.1, 0.7]]), grid)
    assert attachment.follow(grid)[0] == pytest.approx([2.3, 3.1, 0.0], abs=1e-10)
    assert np.abs(attachment.weight).sum() < 3.0


def test_far_points_do_not_amplify_noise() -> None:
    particles = np.random.default_rng(3).uniform(size=(100, 3))
    attachment = attach(np.array([[40.0, 0.0, 0.0]]), particles)
    assert attachment.weight.sum() == pytest.approx(1.0)
    assert np.abs(attachment.weight).sum() < 10.0


def test_few_particles() -> None:
    one = attach(np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]), np.array([[1.0, 1.0, 1.0]]))
    assert one.weight == pytest.approx(np.ones((2, 1)))
    line = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    assert attach(np.array([[0.5, 1.0, 0.0]]), line).follow(line)[0] == pytest.approx([0.5, 0.0, 0.0], abs=1e-10)
    assert attach(np.empty((0, 3)), line).weight.shape == (0, 3)
    with pytest.raises(ObjectError):
        attach(np.zeros((1, 3)), np.empty((0, 3)))
    with pytest.raises(ObjectError, match="finite"):
        attach(np.full((1, 3), np.nan), line)
