"""Tracks to 3D on a plate that turns out of the frame plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seeing_wind.engine.errors import ObjectError
from seeing_wind.engine.observe.object.motion.lifting import Sight, _Frame, best_rotations, lift, neighbour_edges
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from seeing_wind.engine.records import Camera
from seeing_wind.engine.recovery import journal as journals
from seeing_wind.engine.recovery.journal import TakeJournal
from seeing_wind.engine.take import Take


@pytest.fixture(scope="module")
def scene():
    """A plate of 0.2 m, 2 m from the camera, turning by 40 degrees about its upright axis while it drifts: truth, tracks, camera."""
    rng = np.random.default_rng(0)
    rest = np.column_stack([rng.uniform(-0.1, 0.1, 40), rng.uniform(-0.1, 0.1, 40), 2.0 + 0.01 * rng.normal(size=40)])
    camera = Camera(640, 480, 1500.0, 1500.0, 319.5, 239.5, np.eye(4))
    truth = []
    for t in range(13):
        turn = Rotation.from_euler("yx", [40 * t / 12, 10 * t / 12], degrees=True).as_matrix()
        truth.append((rest - [0, 0, 2]) @ turn.T + [0.02 * t / 12, 0.05 * t / 12, 2.0 + 0.1 * t / 12])
    truth = np.array(truth)
    xy = np.stack([camera.project(x)[0] for x in truth]) + 0.1 * rng.normal(size=(13, 40, 2))
    return truth, xy, camera


def errors(lifted: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    difference = np.abs(lifted - truth)[1:]
    return float(np.median(difference[..., 2])), float(np.median(np.linalg.norm(difference[..., :2], axis=-1)))


def run(scene, **options) -> np.ndarray:
    truth, xy, camera = scene
    visible = np.ones(xy.shape[:2], dtype=bool)
    return lift([Sight(camera, xy, visible, np.full(visible.shape, 0.1))], truth[0], **options)


def test_rotation_aware_lift_follows_the_turn(scene) -> None:
    along, across = errors(run(scene), scene[0])
    assert along < 3e-3
    assert across < 3e-4


def test_a_kill_costs_no_frame_that_was_lifted(scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Killed(BaseException):
        pass

    whole, solve, frames = run(scene), _Frame.solve, 0

    def killed_once(self, *arguments):
        nonlocal frames
        frames += 1
        if frames == 8:
            raise Killed
        return solve(self, *arguments)

    monkeypatch.setattr(journals, "LATEST", 0.0)
    monkeypatch.setattr(_Frame, "solve", killed_once)
    with pytest.raises(Killed), TakeJournal(Take(tmp_path), "lift", NoProgress()) as journal:
        run(scene, journal=journal)
    with TakeJournal(Take(tmp_path), "lift", NoProgress()) as journal:
        assert np.array_equal(run(scene, journal=journal), whole)
    assert frames == 13, "twelve and the one that was begun"


def test_two_views_hold_a_stretching_plate(scene) -> None:
    truth, _, camera = scene
    # One view takes a growing plate for one that comes nearer; the other one, of other points of it, sees that it does not.
    middle = truth.mean(axis=1, keepdims=True)
    truth = middle + (truth - middle) * np.linspace(1.0, 1.25, 13)[:, None, None]
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("y", -40, degrees=True).as_matrix()
    pose[:3, 3] = np.array([0.0, 0.0, 2.0]) - 2.0 * pose[:3, 2]
    aside = Camera(640, 480, 1500.0, 1500.0, 319.5, 239.5, pose)
    rng, sights = np.random.default_rng(1), []
    for number, eye in enumerate((camera, aside)):
        xy = np.stack([eye.project(x)[0] for x in truth]) + 0.1 * rng.normal(size=(13, 40, 2))
        visible = np.tile(np.arange(40) % 2 == number, (13, 1))
        sights.append(Sight(eye, xy, visible, np.full(visible.shape, 0.1)))
    together = errors(lift(sights, truth[0], flows=True), truth)
    alone = errors(lift([sights[0]], truth[0], flows=True)[:, ::2], truth[:, ::2])
    assert together[0] < 3e-3 and together[1] < 1e-3
    assert alone[0] > 5.0 * together[0]
    with pytest.raises(ObjectError):
        lift([sights[0], Sight(aside, sights[1].xy[:5], sights[1].visible[:5], sights[1].sigma[:5])], truth[0])


def test_previous_frame_reference_follows_too(scene) -> None:
    assert errors(run(scene, flows=True), scene[0])[0] < 8e-3


def test_hidden_points_are_carried_and_unseen_ones_are_nan(scene) -> None:
    truth, xy, camera = scene
    visible = np.ones(xy.shape[:2], dtype=bool)
    visible[4:, 3] = False
    visible[:, 7] = False
    gaps = xy.copy()
    gaps[~visible] = np.nan
    start = truth[0].copy()
    start[7] = np.nan
    lifted = lift([Sight(camera, gaps, visible, np.full(visible.shape, 0.1))], start)
    assert np.isnan(lifted[:, 7]).all()
    assert np.isfinite(np.delete(lifted, 7, axis=1)).all()
    assert np.linalg.norm(lifted[-1, 3] - truth[-1, 3]) < 0.01


def test_outliers_do_not_pull(scene) -> None:
    truth, xy, camera = scene
    bad = xy.copy()
    bad[6, 5] += 40.0
    visible = np.ones(xy.shape[:2], dtype=bool)
    lifted = lift([Sight(camera, bad, visible, np.full(visible.shape, 0.1))], truth[0])
    # 56 pixels, 560 sigma: Huber bounds the pull, and the next frames forget it.
    assert np.linalg.norm(lifted[6] - truth[6], axis=1).max() < 0.015
    assert np.median(np.linalg.norm(lifted[8:] - truth[8:], axis=-1)) < 3e-3


def test_pinned_points_stay(scene) -> None:
    pinned = np.zeros(40, dtype=bool)
    pinned[:2] = True
    lifted = run(scene, pinned=pinned)
    assert lifted[:, :2] == pytest.approx(np.broadcast_to(scene[0][0, :2], (13, 2, 3)), abs=1e-12)


def test_one_point_moves_in_its_depth_plane() -> None:
    camera = Camera(100, 100, 100.0, 100.0, 49.5, 49.5, np.eye(4))
    truth = np.array([[[0.01 * t, 0.02 * t, 1.0]] for t in range(5)])
    xy = np.stack([camera.project(x)[0] for x in truth])
    visible = np.ones((5, 1), dtype=bool)
    lifted = lift([Sight(camera, xy, visible, np.full((5, 1), 0.1))], truth[0])
    assert lifted == pytest.approx(truth, abs=1e-4)


def test_best_rotations_recovers_a_turn() -> None:
    rng = np.random.default_rng(4)
    rest = rng.normal(size=(30, 3))
    turn = Rotation.from_rotvec([0.3, -1.2, 0.5]).as_matrix()
    found = best_rotations(rest, rest @ turn.T + 3.0, neighbour_edges(rest))
    assert found == pytest.approx(np.broadcast_to(turn, (30, 3, 3)), abs=1e-10)


def test_bad_input_and_cancel(scene) -> None:
    truth, xy, camera = scene
    visible = np.ones(xy.shape[:2], dtype=bool)
    sigma = np.full(visible.shape, 0.1)
    with pytest.raises(ObjectError):
        lift([Sight(camera, xy, visible[:, :5], sigma)], truth[0])
    with pytest.raises(ObjectError, match="depth"):
        lift([Sight(camera, xy, visible, sigma)], np.full_like(truth[0], np.nan))
    with pytest.raises(Cancelled):
        lift([Sight(camera, xy, visible, sigma)], truth[0], progress=Progress(cancelled=lambda: True))
