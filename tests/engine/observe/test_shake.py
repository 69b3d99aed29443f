"""A trembling camera: its rotations are found, removed from the images, and kept as poses."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from interrupted import assert_same, in_pieces
from scenes import HEIGHT, WIDTH, Scene, disc_scene, noise, write_video

from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.clip.camera import find_camera
from seeing_wind.engine.observe.clip.shake import as_filmed, camera_turns, homography, stabilise, through, without_spikes
from seeing_wind.engine.progress import Journal, NoProgress, Progress
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import ObserveSettings

CAMERA, DISTANCE = find_camera(ObserveSettings(distance=1.0), WIDTH, HEIGHT, 13, 0, None, NoProgress())


def turns_of_a_hand() -> np.ndarray:
    """Rotations (13, 3, 3): up to eight pixels of sway with a little roll."""
    t = np.arange(13)
    turns = []
    # Exact axes: about y to the right, about x downwards, about z clockwise.
    for pan, tilt, roll in zip(8 * np.sin(0.5 * t) / CAMERA.fx, 6 * np.sin(0.31 * t) / CAMERA.fy, 0.01 * np.sin(0.4 * t)):
        spin = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
        right = np.array([[np.cos(pan), 0, np.sin(pan)], [0, 1, 0], [-np.sin(pan), 0, np.cos(pan)]])
        down = np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
        turns.append(right @ down @ spin)
    return np.stack(turns)


@pytest.fixture(scope="module")
def trembling(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, np.ndarray]:
    folder = tmp_path_factory.mktemp("tremble")
    scene, turns = disc_scene(folder), turns_of_a_hand()
    detail = noise(np.random.default_rng(11), (HEIGHT, WIDTH), (0, 0, 0), (60, 60, 60), 1.5)
    frames = [
        np.where(mask[..., None], frame, np.clip(frame + detail, 0, 255)).astype(np.uint8) for frame, mask in zip(scene.frames, scene.masks)
    ]
    filmed = [
        cv2.warpPerspective(
            frame, np.linalg.inv(homography(turn, CAMERA)), (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
        )
        for frame, turn in zip(frames, turns)
    ]
    write_video(folder / "clip.avi", filmed, 30.0)
    return scene, turns


def test_turns_are_found(trembling: tuple[Scene, np.ndarray]) -> None:
    scene, turns = trembling
    video = cv2.VideoCapture(str(scene.path))
    frames = np.stack([cv2.cvtColor(video.read()[1], cv2.COLOR_BGR2RGB) for _ in range(13)])
    found = camera_turns(frames, CAMERA, scene.masks[0], NoProgress(), Journal())
    assert found is not None
    grid = np.stack(np.meshgrid(np.arange(20.0, WIDTH, 60), np.arange(20.0, HEIGHT, 60)), -1).reshape(-1, 2)
    for ours, true in zip(found, turns):
        assert np.linalg.norm(through(homography(ours, CAMERA), grid) - through(homography(true, CAMERA), grid), axis=1).max() < 0.5


@pytest.fixture(scope="module")
def seen_whole(trembling: tuple[Scene, np.ndarray]) -> tuple[Observation, list[dict]]:
    """The observation made without interruption, and the messages sent meanwhile."""
    told: list[dict] = []
    return observe(trembling[0].path, ObserveSettings(box=trembling[0].box, distance=DISTANCE), Progress(told.append)), told


def test_object_in_the_world_is_free_of_tremble(
    trembling: tuple[Scene, np.ndarray], seen_whole: tuple[Observation, list[dict]]
) -> None:
    (scene, turns), (seen, told) = trembling, seen_whole
    assert any("turn" in message["message"] for message in told if message["type"] == "warning")
    assert seen.camera.camera_to_world.shape == (13, 4, 4)
    # In file pixels the tracks tremble with the frame ...
    body = np.stack([scene.moved(seen.xy[0], t) for t in range(13)])
    filmed = np.stack([through(np.linalg.inv(homography(turn, CAMERA)), points) for turn, points in zip(turns, body)])
    off = np.linalg.norm(seen.xy - filmed, axis=2)[seen.visible]
    assert np.median(off) < 0.35
    # ... and seen through the poses they do not.
    still = CAMERA.project(np.stack([seen.camera.unproject(seen.xy[t], np.ones(seen.xy.shape[1]), t) for t in range(13)]))[0]
    assert np.median(np.linalg.norm(still - body, axis=2)[seen.visible]) < 0.35


def test_a_kill_costs_no_frame_of_a_trembling_camera(
    trembling: tuple[Scene, np.ndarray], seen_whole: tuple[Observation, list[dict]], tmp_path: Path
) -> None:
    settings = ObserveSettings(box=trembling[0].box, distance=DISTANCE)
    found, kills, frames = in_pieces(trembling[0].path, settings, tmp_path, 4)
    assert_same(found, seen_whole[0])
    assert kills == 5 and frames == 24


def test_steadying_and_back_again() -> None:
    turns = turns_of_a_hand()
    rng = np.random.default_rng(2)
    frames = np.stack([noise(rng, (HEIGHT, WIDTH), (0, 0, 0), (255, 255, 255), 4.0).astype(np.uint8)] * 13)
    assert np.array_equal(stabilise(frames, np.tile(np.eye(3), (13, 1, 1)), CAMERA, NoProgress()), frames)
    xy = rng.uniform(40, 120, (13, 5, 2))
    back, _, _ = as_filmed(xy, np.zeros(frames.shape[:3], bool), None, turns, CAMERA)
    assert np.allclose(np.stack([through(homography(turn, CAMERA), points) for turn, points in zip(turns, back)]), xy)


def test_a_turn_that_jumps_away_and_back_is_a_mistake() -> None:
    turns = turns_of_a_hand()
    assert np.array_equal(without_spikes(turns, CAMERA), turns)
    jump = cv2.Rodrigues(np.array([0.0, 9.0 / CAMERA.fx, 0.0]))[0]
    wrong = turns.copy()
    wrong[6] = jump @ wrong[6]
    middle = np.array([[0.5 * WIDTH, 0.5 * HEIGHT]])
    places = [through(homography(turn, CAMERA), middle)[0] for turn in (turns[6], wrong[6], without_spikes(wrong, CAMERA)[6])]
    assert np.linalg.norm(places[1] - places[0]) > 8.0 and np.linalg.norm(places[2] - places[0]) < 2.0
    # A camera that is pushed stays where it was pushed to.
    pushed = np.concatenate([turns[:6], jump @ turns[6:]])
    assert np.array_equal(without_spikes(pushed, CAMERA), pushed)


def test_unrelated_frames_are_no_tremble() -> None:
    rng = np.random.default_rng(4)
    frames = np.stack([noise(rng, (HEIGHT, WIDTH), (0, 0, 0), (255, 255, 255), 3.0).astype(np.uint8) for _ in range(3)])
    assert camera_turns(frames, CAMERA, np.zeros((HEIGHT, WIDTH), bool), NoProgress(), Journal()) is None


def test_another_thing_before_a_plain_wall_is_no_moving_camera(tmp_path: Path) -> None:
    """All corners beside the object are on the second one, which moves on its own."""
    rng = np.random.default_rng(5)
    patches = [noise(rng, (40, 40), (20, 20, 20), (230, 230, 230), 2.0).astype(np.uint8) for _ in range(2)]
    frames = []
    for t in range(13):
        frame = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
        for patch, (x, y) in zip(patches, ((20 + 2 * t, 20 + t), (WIDTH - 60 - 2 * t, HEIGHT - 50 - t))):
            frame[y : y + 40, x : x + 40] = patch
        frames.append(frame)
    write_video(tmp_path / "two.avi", frames, 30.0)
    told: list[dict] = []
    seen = observe(tmp_path / "two.avi", ObserveSettings(box=(15, 15, 65, 65), distance=1.0), Progress(told.append))
    assert not [message for message in told if "camera" in message.get("message", "").lower() and message["type"] == "warning"]
    assert np.ndim(seen.camera.camera_to_world) == 2
    shift = np.nanmedian(np.where(seen.visible[-1][:, None], seen.xy[-1] - seen.xy[0], np.nan), axis=0)
    assert shift == pytest.approx([24.0, 12.0], abs=0.5)
