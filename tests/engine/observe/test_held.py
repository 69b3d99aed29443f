"""An object held by another thing, which moves with it and extends beyond the object's box."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scenes import noise, write_video

from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.mask.motion import Flow
from seeing_wind.engine.observe.mask.moving.others import Other
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.settings import ObserveSettings

HEIGHT, WIDTH, COUNT = 240, 320, 20
COLUMNS, ROWS = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))


def held(folder: Path) -> tuple[Path, np.ndarray]:
    """A clip, and masks (COUNT, HEIGHT, WIDTH) of the dark can in it that a patterned arm from the right holds and carries."""
    rng = np.random.default_rng(4)
    wall = noise(rng, (HEIGHT, WIDTH), (150, 148, 140), (236, 232, 226), 3.0)
    skin = noise(rng, (HEIGHT, 2 * WIDTH), (150, 96, 70), (226, 172, 140), 2.5)
    can = noise(rng, (HEIGHT, WIDTH), (12, 12, 14), (72, 72, 80), 2.0)
    frames, masks = [], []
    for t in range(COUNT):
        x, y = round(110 + 4.0 * t), round(105 + 16 * np.sin(0.3 * t))
        body = (np.abs(COLUMNS - x) < 24) & (np.abs(ROWS - y) < 48)
        arm = (COLUMNS > x - 8) & (np.abs(ROWS - y) < 15 + 0.06 * np.maximum(COLUMNS - x, 0))
        shift = np.float32([[1, 0, x - 110], [0, 1, y - 105]])
        pattern = cv2.warpAffine(can, shift, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
        frame = np.where(body[..., None], pattern, wall)
        flesh = cv2.warpAffine(skin, shift, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
        frame = np.where(arm[..., None], flesh, frame)
        frame = cv2.GaussianBlur(frame.astype(np.float64), (0, 0), 0.8) + rng.normal(0, 1.5, frame.shape)
        frames.append(np.clip(np.round(frame), 0, 255).astype(np.uint8))
        masks.append(body & ~arm)
    write_video(folder / "clip.avi", frames, 30.0)
    return folder / "clip.avi", np.stack(masks)


def test_the_arm_that_holds_a_thing_is_not_the_thing(tmp_path: Path) -> None:
    clip, true = held(tmp_path)
    rows, columns = np.nonzero(true[0])
    box = (columns.min() - 6.0, rows.min() - 6.0, columns.max() + 6.0, rows.max() + 6.0)
    found = np.asarray(observe(clip, ObserveSettings(box=box, distance=1.0), NoProgress()).masks)
    overlap = (found & true).sum(axis=(1, 2)) / (found | true).sum(axis=(1, 2))
    assert overlap.min() > 0.9, overlap.round(2)


def test_what_moves_along_is_carried_by_the_flow_and_gives_way_to_the_object() -> None:
    frame, nothing = np.full((HEIGHT, WIDTH, 3), 90, np.uint8), np.zeros((HEIGHT, WIDTH), bool)
    held, arm = (ROWS > 100) & (ROWS < 120) & (COLUMNS > 30) & (COLUMNS <= 60), (ROWS > 100) & (ROWS < 120) & (COLUMNS > 60)
    other = Other(frame, held, arm)
    everywhere, flow = (0, 0, WIDTH, HEIGHT), Flow(0, 0, np.full((HEIGHT, WIDTH, 2), (5.0, -3.0), np.float32))
    other.move(frame, flow, np.array([5.0, -3.0]), everywhere)
    moved = (ROWS > 97) & (ROWS < 117) & (COLUMNS > 65)
    assert np.array_equal(other.over(everywhere)[4:-4, 4:-4], moved[4:-4, 4:-4])
    thing, wall = moved & (COLUMNS < 90), moved & (COLUMNS > 200)
    again = Other(frame, held, None)
    again.resume(other.state())
    again.keep(nothing, wall, nothing, thing, thing, everywhere)
    assert np.array_equal(again.over(everywhere)[4:-4, 4:-4], (moved & ~thing & ~wall)[4:-4, 4:-4])


def test_what_moves_otherwise_beside_the_object_is_another_thing_and_no_more_than_that() -> None:
    """Of an object 21 px in size the thickness asked for would be even, which shifts what is opened."""
    thing = (np.abs(ROWS - 100) < 11) & (np.abs(COLUMNS - 100) < 11)
    assert int(0.3 * np.sqrt(thing.sum())) % 2 == 0
    beside = (np.abs(ROWS - 100) < 12) & (COLUMNS > 130) & (COLUMNS < 160)
    frame, nothing, everywhere = np.full((HEIGHT, WIDTH, 3), 90, np.uint8), np.zeros_like(thing), (0, 0, WIDTH, HEIGHT)
    frame[thing], frame[beside] = (230, 200, 40), (220, 160, 140)
    flow = Flow(0, 0, np.full((HEIGHT, WIDTH, 2), (3.0, 0.0), np.float32))
    for motion, known in ((0.2, True), (3.0, False)):
        other = Other(frame, thing, None)
        other.keep(thing | beside, nothing, nothing, thing, thing, everywhere)
        assert not other.any(), "it may be the object's own"
        other.move(np.roll(frame, 3, axis=1), flow, np.array([motion, 0.0]), everywhere)
        assert np.array_equal(other.over(everywhere), np.roll(beside, 3, axis=1) & known)
        odds = other.colors.odds(frame)
        assert odds[thing].min() > 0.0 > odds[beside].max(), "its colours are the surroundings'"
        again = Other(frame, thing, None)
        again.resume(other.state())
        assert np.array_equal(again.colors.odds(frame), odds), "an interrupted run goes on alike"
