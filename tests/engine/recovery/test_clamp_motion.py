"""A moving clamp: its motion is distinguished from a force."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.recovery.targets.clamp_motion import clamp_motion
from tests.engine.mpm.bodies import block
from tests.engine.recovery.bodies import FPS, WEIGHTLESS, points

POST = Material("post", "corotated", density=500.0, youngs_modulus=2e4, poisson_ratio=0.3)
FRAMES = 16
WIND = np.array([1.5, 0.0, 0.0])
SWAY = np.array([0.0, 0.02, 0.01])
"""Displacement [m] of the clamp to one side of its start."""
TILT = np.radians(10.0) * np.array([0.6, 0.0, 0.8])


def post():
    return block((2, 2, 8), pinned_below=0.025)


def swayed(body, time):
    """Positions (n, N, 3) of `body` at `time` (n,) [frames], carried rigidly by a clamp that sways and turns, starting at rest."""
    way = 0.5 * (1.0 - np.cos(2.0 * np.pi * time / FRAMES))
    turn = Rotation.from_rotvec(way[:, None] * TILT).as_matrix()
    centre = body.x[body.pinned].mean(axis=0)
    return centre + way[:, None, None] * SWAY + np.einsum("tij,nj->tni", turn, body.x - centre)


@pytest.fixture(scope="module")
def filmed():
    """A post in a wind, with a swaying foot that the solver's own moving clamp moves."""
    body = post()
    path = swayed(body, np.arange(FRAMES + 1.0))[:, body.pinned]
    model, _ = model_for(body, POST, FPS, gravity=(0, 0, 0), pin_path=path)
    return body, rollout(model, State.at_rest(body.x), np.broadcast_to(WIND, (FRAMES, len(body.x), 3)))


def test_the_motion_of_held_points_is_found(filmed):
    body, moved = filmed
    motion = clamp_motion(body, points(body, moved.x), FPS)
    assert motion.largest == pytest.approx(np.linalg.norm(SWAY), rel=0.01)
    assert motion.widest == pytest.approx(10.0, rel=0.01)
    still = motion.in_clamp_frame(points(body, moved.x)).x[:, body.pinned]
    assert np.abs(still - body.x[body.pinned]).max() < 1e-4


def test_a_foot_that_sways_is_not_a_wind(filmed):
    body, moved = filmed
    targets = points(body, moved.x)
    found = recover(body, POST, targets, FPS, WEIGHTLESS, NoProgress())
    unseen = replace(targets, visible=targets.visible & ~body.pinned)
    taken_to_stand = recover(body, POST, unseen, FPS, replace(WEIGHTLESS, iterations=2), NoProgress())  # more would not mend it

    def missed(recovery):
        return np.sqrt(((recovery.force_density[:, ~body.pinned] / POST.density - WIND) ** 2).mean())

    assert missed(found) < 0.08 * np.linalg.norm(WIND)
    assert missed(found) < 0.25 * missed(taken_to_stand)
    assert found.clamp_moves
    assert np.abs(found.x[:, body.pinned] - moved.x[:, body.pinned]).max() < 1e-4
    assert any("What is held moves by up to 22 mm and turns by up to 10 degrees" in note for note in found.notes)


def test_a_clamp_that_stands_is_left_alone():
    body = post()
    x = np.repeat(body.x[None], FRAMES + 1, axis=0)
    assert clamp_motion(body, points(body, x), FPS) is None
    noisy = x + np.random.default_rng(0).normal(0.0, 5e-4, x.shape)
    assert clamp_motion(body, points(body, noisy), FPS) is None


def test_noise_does_not_hide_a_clamp_that_sways(filmed):
    body, moved = filmed
    noisy = moved.x + np.random.default_rng(0).normal(0.0, 5e-4, moved.x.shape)
    motion = clamp_motion(body, points(body, noisy), FPS)
    assert motion.largest == pytest.approx(np.linalg.norm(SWAY), rel=0.05)


def test_a_slow_drift_of_a_few_times_the_noise_is_seen():
    body = post()
    way = np.linspace(0.0, 2e-3, 60)[:, None, None] * np.array([1.0, 0.0, 0.0])
    x = body.x + way + np.random.default_rng(0).normal(0.0, 5e-4, (60, len(body.x), 3))
    motion = clamp_motion(body, points(body, x), FPS)
    assert motion.largest == pytest.approx(2e-3, rel=0.1)


def test_held_places_that_move_apart_are_no_one_clamp(filmed):
    body, moved = filmed
    x = moved.x.copy()
    half = body.pinned & (body.x[:, 0] > np.median(body.x[:, 0]))
    x[:, half] += 0.05 * np.linspace(0.0, 1.0, FRAMES + 1)[:, None, None] * np.array([1.0, 0.0, 0.0])
    x[:, body.pinned & ~half] -= 0.05 * np.linspace(0.0, 1.0, FRAMES + 1)[:, None, None] * np.array([1.0, 0.0, 0.0])
    assert clamp_motion(body, points(body, x), FPS) is None


def test_too_little_that_is_held_is_seen(filmed):
    body, moved = filmed
    targets = points(body, moved.x)
    hidden = targets.visible.copy()
    hidden[3, body.pinned] = False
    assert clamp_motion(body, replace(targets, visible=hidden), FPS) is None
    assert clamp_motion(replace(body, pinned=np.zeros(len(body.x), bool)), targets, FPS) is None
