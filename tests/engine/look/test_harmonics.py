"""Colours that depend on the view, at rest and turned."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seeing_wind.engine.look.gaussians import covariances, rest_covariances
from seeing_wind.engine.look.harmonics import harmonics, polar_rotations, seen_colours

from .test_gaussians_ply import colours, some

EYE = np.array([3.0, -4.0, 2.0])


def test_harmonics_are_orthonormal_on_the_sphere() -> None:
    z, weight = np.polynomial.legendre.leggauss(8)
    angle = np.arange(16) * np.pi / 8
    ring = np.sqrt(1 - z[:, None] ** 2)
    directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), z[:, None] + 0 * angle], -1).reshape(-1, 3)
    values = harmonics(directions, 16)
    assert values.T @ (np.repeat(weight, 16)[:, None] * np.pi / 8 * values) == pytest.approx(np.eye(16), abs=1e-12)
    for bands in (1, 4, 9):
        assert np.array_equal(harmonics(directions, bands), values[:, :bands])


def test_harmonics_have_the_signs_of_gaussian_splatting() -> None:
    # Their eval_sh: C0, -C1 y, C1 z, -C1 x, then xy, -yz, 3z² - 1, -xz, x² - y².
    n = np.array([0.6, 0.48, 0.64])
    signs = np.sign(harmonics(n, 16))
    assert signs.tolist() == [1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, np.sign(5 * 0.64**2 - 3), -1, 1, np.sign(3 * 0.48**2 - 0.6**2)]


def test_one_band_looks_the_same_from_everywhere() -> None:
    gaussians = some()
    assert seen_colours(gaussians, gaussians.x, EYE) == pytest.approx(colours(gaussians))


@pytest.mark.parametrize("bands", [4, 9, 16])
def test_a_turned_body_shows_a_turned_camera_the_same_colours_and_shape(bands: int) -> None:
    gaussians = some(bands=bands)
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    F = np.broadcast_to(turn, (7, 3, 3))
    at_rest = seen_colours(gaussians, gaussians.x, EYE)
    assert seen_colours(gaussians, gaussians.x @ turn.T, turn @ EYE, F) == pytest.approx(at_rest)
    assert np.abs(seen_colours(gaussians, gaussians.x @ turn.T, EYE, F) - at_rest).max() > 0.05
    assert covariances(gaussians, F) == pytest.approx(turn @ rest_covariances(gaussians) @ turn.T)


def test_stretch_does_not_turn_colours() -> None:
    gaussians = some(bands=9)
    random = np.random.default_rng(1).normal(size=(7, 3, 3))
    stretch = np.eye(3) + 0.1 * (random + random.transpose(0, 2, 1))
    assert seen_colours(gaussians, gaussians.x, EYE, stretch) == pytest.approx(seen_colours(gaussians, gaussians.x, EYE))
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    assert polar_rotations(turn @ stretch) == pytest.approx(np.broadcast_to(turn, (7, 3, 3)))
    assert np.linalg.det(polar_rotations(-stretch)) == pytest.approx(np.ones(7))
