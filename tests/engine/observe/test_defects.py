"""Clips with defects that can be seen in them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import Scene, moving_body, noise, write_video

from seeing_wind.engine.errors import ClipError
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.clip.defects import check_frames, warn_of_defects
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.settings import ObserveSettings


def told(frames: np.ndarray, masks: np.ndarray) -> list[str]:
    messages: list[dict] = []
    warn_of_defects(frames, masks, Progress(messages.append))
    return [one["message"] for one in messages if one["type"] == "warning"]


def test_a_cut_is_named_with_its_frames(disc: Scene, tmp_path: Path) -> None:
    other = noise(np.random.default_rng(3), disc.frames.shape[1:3], (10, 20, 30), (250, 240, 200), 5.0).astype(np.uint8)
    frames = np.concatenate([disc.frames[:7], np.repeat(other[None], 5, axis=0)])
    write_video(tmp_path / "cut.avi", list(frames), 30.0)
    with pytest.raises(ClipError, match="between its frames 6 and 7") as caught:
        observe(tmp_path / "cut.avi", ObserveSettings(box=disc.box, distance=1.5), NoProgress())
    assert "--frames 0:6" in caught.value.hint and "7:11" in caught.value.hint
    with pytest.raises(ClipError, match="12 and 13"):
        check_frames(frames[2:], 8, NoProgress())
    with pytest.raises(ClipError, match="6 and 7") as caught:
        check_frames(frames[6:], 6, NoProgress())
    assert "--frames 7:11" in caught.value.hint and "6:6" not in caught.value.hint, "one frame is no shot"


def test_motion_a_lamp_and_a_moving_camera_are_no_cuts(disc: Scene, ball: Scene) -> None:
    check_frames(disc.frames, 0, NoProgress())
    check_frames(ball.frames, 0, NoProgress())
    lit = disc.frames.copy()
    lit[6:] = np.clip(lit[6:].astype(int) + 60, 0, 255).astype(np.uint8)
    check_frames(lit, 0, NoProgress())
    wide = noise(np.random.default_rng(1), (160, 420), (20, 30, 40), (240, 230, 220), 4.0).astype(np.uint8)
    check_frames(np.stack([wide[:, 12 * t : 12 * t + 220] for t in range(12)]), 0, NoProgress())


def test_black_frames(disc: Scene) -> None:
    black = np.zeros_like(disc.frames[:4])
    with pytest.raises(ClipError, match="is black"):
        check_frames(black, 0, NoProgress())
    with pytest.raises(ClipError, match="begins with 4 black") as caught:
        check_frames(np.concatenate([black, disc.frames]), 10, NoProgress())
    assert "--frames 14" in caught.value.hint


def test_an_object_over_the_edge_is_told(disc: Scene) -> None:
    assert told(disc.frames, disc.masks) == []
    shifted = np.roll(disc.masks, 100, axis=2)
    shifted[:, :, :100] = False
    leaving = [one for one in told(disc.frames, shifted) if "partly out of view" in one]
    assert len(leaving) == 1
    masks = disc.masks.copy()
    masks[:, :, :70] |= masks.any(axis=2, keepdims=True)
    assert any("edge of the first frame" in one for one in told(disc.frames, masks))


def test_motion_blur_is_told(tmp_path: Path) -> None:
    t = np.arange(13.0)
    centers = np.stack([40 + 9.0 * t, np.full(13, 80.0)], axis=1)
    texture = noise(np.random.default_rng(7), (90, 90), (20, 10, 5), (255, 250, 240), 1.2)
    scene = moving_body(tmp_path, centers, 0.0 * t, 30.0, texture)
    assert told(scene.frames, scene.masks) == []
    blurred = scene.frames.copy()
    kernel = np.zeros((11, 11), np.float32)
    kernel[5] = 1 / 11
    for k in range(5, 11):
        blurred[k] = cv2.filter2D(blurred[k], -1, kernel)
    warned = told(blurred, scene.masks)
    assert len(warned) == 1 and "6 of 13 frames, first in frame 5" in warned[0]


def test_a_camera_that_moves_through_the_room_is_told(tmp_path: Path) -> None:
    behind = noise(np.random.default_rng(4), (200, 280), (20, 30, 40), (230, 220, 210), 2.5).astype(np.uint8)
    skin = noise(np.random.default_rng(7), (90, 90), (120, 40, 20), (255, 200, 110), 1.6).astype(np.uint8)
    frames = []
    for t in range(8):
        # It comes nearer: what is seen grows by 4 % a frame, which no turn of a hand does.
        grown = cv2.warpAffine(behind, np.array([[1.04**t, 0.0, -30.0], [0.0, 1.04**t, -20.0]]), (220, 160))
        grown[60:100, 60 + 3 * t : 100 + 3 * t] = skin[20:60, 20:60]
        frames.append(grown)
    write_video(tmp_path / "dolly.avi", frames, 30.0)
    messages: list[dict] = []
    observe(tmp_path / "dolly.avi", ObserveSettings(box=(58.0, 58.0, 102.0, 102.0), distance=1.0), Progress(messages.append))
    assert any("The camera moves" in one["message"] for one in messages if one["type"] == "warning")


def test_a_plain_object_is_followed_by_its_silhouette_and_that_is_told(ball: Scene) -> None:
    messages: list[dict] = []
    seen = observe(ball.path, ObserveSettings(box=ball.box, distance=1.0), Progress(messages.append))
    assert seen.on_centroid.all() and np.abs(seen.xy[:, 0] - ball.centers).max() < 0.3
    assert any("too plain" in one["message"] for one in messages if one["type"] == "warning")
