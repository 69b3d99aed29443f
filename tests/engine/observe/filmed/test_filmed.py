"""How a clip was filmed: each problem is provoked in a small synthetic clip and must be reported; a good clip must give no report."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import HEIGHT, WIDTH, Scene, noise, write_video

from seeing_wind.engine.masks import Masks
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.clip.filmed.beside import touching
from seeing_wind.engine.observe.clip.filmed.combing import Combing
from seeing_wind.engine.observe.clip.filmed.surroundings import camera_doubts
from seeing_wind.engine.observe.mask.background import Plate
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import ObserveSettings

ROOM = noise(np.random.default_rng(4), (HEIGHT + 120, WIDTH + 160), (20, 30, 40), (230, 220, 210), 2.5)
"""The still surroundings, larger than the frame so that the camera can pan."""
SKIN = noise(np.random.default_rng(7), (90, 90), (120, 40, 20), (255, 200, 110), 1.6)
NOWHERE = np.zeros((HEIGHT, WIDTH), bool)


def warped(matrix: np.ndarray, grain: int) -> np.ndarray:
    """An image of the room through an affine map (2, 3) from room to frame pixels, with grain."""
    frame = cv2.warpAffine(ROOM, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.clip(frame + np.random.default_rng(grain).normal(0, 1.5, frame.shape), 0, 255).astype(np.uint8)


def told(frames: list[np.ndarray]) -> list[str]:
    return [one.because for one in camera_doubts(np.stack(frames), NOWHERE, NoProgress())]


def grown(scale: float) -> np.ndarray:
    """The affine map that scales about the frame's middle."""
    middle = np.array([WIDTH / 2, HEIGHT / 2])
    return np.column_stack([scale * np.eye(2), middle - scale * (middle + [80, 60])])


def test_a_lens_that_refocuses_is_told() -> None:
    breathing = [warped(grown(1.0 + 0.012 * np.sin(0.3 * t)), t) for t in range(20)]
    (found,) = told(breathing)
    assert "refocuses" in found and ("1.1 %" in found or "1.2 %" in found)


def test_a_still_camera_and_a_hand_are_no_lens_that_refocuses() -> None:
    assert told([warped(grown(1.0), t) for t in range(12)]) == []
    hand = []
    for t in range(20):
        turn = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), np.sin(0.5 * t), 1.0)
        hand.append(warped(np.column_stack([turn[:, :2], turn[:, 2] - turn[:, :2] @ [80, 60] + 4 * np.sin(t)]), t))
    assert told(hand) == []


def test_sizes_that_jump_are_no_lens_that_refocuses() -> None:
    jump = np.random.default_rng(2).normal(0.0, 0.01, 20)
    assert told([warped(grown(1.0 + jump[t] * (t > 0)), t) for t in range(20)]) == []


def read_by_rows(share: float) -> list[np.ndarray]:
    """Frames of a camera that sways sideways by up to 12 px and reads its rows over a `share` of the time between frames."""
    frames = []
    for t in range(24):
        time = t + share * (np.arange(HEIGHT) / HEIGHT)
        x, y = np.meshgrid(np.arange(WIDTH, dtype=np.float32), np.arange(HEIGHT, dtype=np.float32))
        shift = (80 + 12 * np.sin(0.9 * time)).astype(np.float32)
        frames.append(np.clip(cv2.remap(ROOM.astype(np.float32), x + shift[:, None], y + 60, cv2.INTER_LINEAR), 0, 255).astype(np.uint8))
    return frames


def test_rows_that_are_read_one_after_the_other_are_told() -> None:
    (found,) = told(read_by_rows(0.6))
    share = int(found.split("(")[1].split(" %")[0])
    assert "row by row" in found and 50 <= share <= 70
    assert told(read_by_rows(0.0)) == []


def interlaced(scene: Scene) -> list[np.ndarray]:
    """Every second row of each frame is that of the next one."""
    frames = [frame.copy() for frame in scene.frames]
    for now, after in zip(frames, scene.frames[1:]):
        now[1::2] = after[1::2]
    return frames[:-1]


def test_interlaced_frames_are_told(disc: Scene) -> None:
    for frames, combed in ((interlaced(disc), True), (list(disc.frames), False)):
        combing = Combing()
        for frame in frames:
            combing.add(frame)
        assert (combing.doubt() is not None) == combed


def test_stripes_that_move_are_no_comb() -> None:
    combing = Combing()
    for t in range(14):
        frame = np.full((HEIGHT, WIDTH, 3), 60, np.uint8)
        frame[40:100:2, 20 + 5 * t : 80 + 5 * t] = 200
        frame[40:100, 20 + 5 * t : 80 + 5 * t : 2] = 200
        combing.add(frame)
    assert combing.doubt() is None


def panned(near: float) -> list[np.ndarray]:
    """A camera that slides past a far wall and a post that moves `near` times as fast, before which a disc falls."""
    frames, disc = [], SKIN[20:70, 20:70]
    for t in range(14):
        frame = warped(np.array([[1.0, 0.0, -20.0 - 5.0 * t], [0.0, 1.0, -60.0]]), 0)
        x = round(150 - 5.0 * near * t)
        frame[:, max(x, 0) : max(x + 40, 0)] = cv2.resize(ROOM[:HEIGHT, :40], (40, HEIGHT)).astype(np.uint8)[:, : max(0, min(40, x + 40))]
        frame[20 + 5 * t : 70 + 5 * t, 40:90] = disc
        frames.append(frame)
    return frames


def test_panning_past_near_and_far_things_is_told(tmp_path: Path) -> None:
    write_video(tmp_path / "pan.avi", panned(2.5), 30.0)
    seen = observe(tmp_path / "pan.avi", ObserveSettings(box=(36.0, 16.0, 94.0, 74.0), distance=1.0), NoProgress())
    assert any("camera moves" in one.because for one in seen.doubts)


def tied(scene: Scene, rope: bool) -> np.ndarray:
    """The disc with another object hanging from it, before its still background."""
    frames = scene.frames.copy()
    for frame, center in zip(frames, scene.centers):
        if rope:
            x, y = np.round(center).astype(int)
            frame[: max(y - 33, 0), x - 4 : x + 4] = (250, 250, 250)
    return frames


@pytest.mark.parametrize("rope", [True, False])
def test_a_rope_on_the_object_is_told(disc: Scene, disc_seen: Observation, rope: bool) -> None:
    plate = Plate(disc_seen.background, np.ones(disc.masks[0].shape, bool), 3.0)
    found = touching(tied(disc, rope), Masks.of(disc.masks), plate)
    assert (found is not None) == rope
    assert found is None or ("rope" in found.because and "outline" not in found.because)


def test_an_outline_that_takes_in_a_part_of_the_rope_is_told(disc: Scene, disc_seen: Observation) -> None:
    plate = Plate(disc_seen.background, np.ones(disc.masks[0].shape, bool), 3.0)
    masks = disc.masks.copy()
    x, y = np.round(disc.centers[12]).astype(int)
    masks[12, max(y - 80, 0) : y, x - 40 : x + 20] = True
    found = touching(tied(disc, True), Masks.of(masks), plate)
    times = masks[12].sum() / masks[0].sum()
    assert found is not None and found.severity > 0.65
    assert f"In frame 12, the object's outline has {times:.1f} times its first area" in found.because


def test_nothing_is_told_of_a_good_clip_and_the_take_keeps_what_is(disc_seen: Observation) -> None:
    assert disc_seen.doubts is not None and list(disc_seen.doubts) == []
