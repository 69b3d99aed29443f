"""The outline from a box around an object that rests in the first frames, until something comes from outside the box and pushes it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import noise, write_video

from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.mask.moving.later import moved_later, unlike
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.settings import ObserveSettings

HEIGHT, WIDTH = 240, 320
RESTS, PUSHED = 8, 8
"""Numbers of frames in which the block lies still, and in which it moves."""


def pushed_block(shade: float, ruled: bool) -> tuple[np.ndarray, np.ndarray]:
    """Frames (T+1, H, W, 3) uint8 and masks (T+1, H, W): a patterned block, pushed to the left by 3 px a frame.

    It never quite leaves its place. The finger that pushes it puts it in the `shade`. The mat is dark and `ruled` with bright lines, or has
    the block's colours.
    """
    rng = np.random.default_rng(6)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    mat = noise(rng, (HEIGHT, WIDTH), (30, 32, 36), (60, 62, 66) if ruled else (210, 200, 190), 2.0)
    mat[ruled & ((rows % 22 < 2) | (columns % 22 < 2))] = 190
    faces = noise(rng, (HEIGHT, WIDTH), (30, 32, 36), (230, 220, 200), 2.0)
    skin = noise(rng, (HEIGHT, WIDTH), (170, 110, 95), (215, 160, 140), 4.0)
    frames, masks = [], []
    for t in range(RESTS + PUSHED):
        pushed = 3 * max(0, t - RESTS)
        tip = max(155 - pushed, 155 + 9 * (RESTS - t))
        block = (np.abs(columns - 130 + pushed) < 25) & (np.abs(rows - 120) < 25)
        finger = (columns > tip) & (np.abs(rows - 120 + 0.25 * (columns - tip)) < 24)
        frame = np.where(block[..., None], np.roll(faces, -pushed, 1), mat)
        dark = cv2.GaussianBlur((np.hypot(columns - tip, rows - 120) < 60).astype(np.float64), (0, 0), 12.0)
        frame = np.where(finger[..., None], np.roll(skin, tip, 1), frame * (1.0 - shade * dark[..., None]))
        frames.append(np.clip(np.round(frame + rng.normal(0, 1.0, frame.shape)), 0, 255).astype(np.uint8))
        masks.append(block & ~finger)
    return np.stack(frames), np.stack(masks)


@pytest.mark.parametrize(("shade", "ruled", "margin"), [(0.2, True, 8), (0.4, True, 20), (0.2, False, 20), (0.4, False, 8)])
def test_a_block_that_rests_until_it_is_pushed_is_found_where_it_lies(tmp_path: Path, shade: float, ruled: bool, margin: int) -> None:
    frames, masks = pushed_block(shade, ruled)
    write_video(tmp_path / "clip.avi", list(frames), 30.0)
    rows, columns = np.nonzero(masks[0])
    box = (columns.min() - margin, rows.min() - margin, columns.max() + margin, rows.max() + margin)
    found = np.asarray(observe(tmp_path / "clip.avi", ObserveSettings(box=box, distance=1.0), NoProgress()).masks)
    overlap = (found & masks).sum(axis=(1, 2)) / (found | masks).sum(axis=(1, 2))
    assert overlap[0] > (0.95 if ruled else 0.8)


def test_what_is_pushed_is_told_from_what_a_finger_only_passes() -> None:
    frames, masks = pushed_block(0.4, True)
    odds = moved_later(frames, (60, 60, 260, 180), 2.5, NoProgress())
    block, finger = masks[0][60:180, 60:260], ~masks[0][60:180, 60:260]
    finger[:, :110] = False
    assert (odds > 0.0)[block].mean() > 0.8
    assert (odds > 0.0)[finger].mean() < 0.2, "the mat that it hides stays"
    assert (odds < 0.0)[:, :20].mean() > 0.8, "what is only shaded stands still"
    assert not (moved_later(frames[:RESTS], (60, 60, 260, 180), 2.5, NoProgress()) > 0.0)[block].any()


def test_a_shade_makes_no_difference_but_another_pattern_does() -> None:
    rng = np.random.default_rng(0)
    one, other = (noise(rng, (60, 80), (60, 60, 60), (200, 200, 200), 2.0).astype(np.uint8) for _ in range(2))
    assert np.median(unlike((0.6 * one).astype(np.uint8), one)) < 3.0
    assert np.median(unlike(other, one)) > 15.0
