"""Whether the camera stands still, in clips in which so much moves that no corner stays in place."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes import noise

from seeing_wind.engine.observe.clip.camera import find_camera
from seeing_wind.engine.observe.clip.stillness import path_doubt, stands_still
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.settings import ObserveSettings

HEIGHT, WIDTH, COUNT = 240, 320, 9
NOWHERE = np.zeros((HEIGHT, WIDTH), bool)
CAMERA, _ = find_camera(ObserveSettings(distance=1.0), WIDTH, HEIGHT, COUNT, 0, None, NoProgress())


def leaves(camera: np.ndarray) -> np.ndarray:
    """Frames (COUNT, HEIGHT, WIDTH, 3) of twelve patterned leaves that drift independently before a meadow out of focus.

    `camera` (COUNT, 2) [px]: how far the frame has moved over the meadow and the leaves.
    """
    rng = np.random.default_rng(5)
    meadow = noise(rng, (HEIGHT + 80, WIDTH + 80), (40, 60, 30), (190, 200, 120), 14.0)
    places = [np.array([40.0 + 80 * (k % 4), 40.0 + 80 * (k // 4)]) for k in range(12)]
    ways = [3.0 * np.array([np.cos(a), np.sin(a)]) for a in rng.uniform(0, 2 * np.pi, 12)]
    patterns = [noise(rng, (44, 44), (20, 40, 20), (250, 230, 210), 1.5) for _ in places]
    frames = []
    for t in range(COUNT):
        dx, dy = (int(value) for value in camera[t])
        frame = meadow[40 + dy : 40 + dy + HEIGHT, 40 + dx : 40 + dx + WIDTH].copy()
        for place, way, pattern in zip(places, ways, patterns):
            x, y = (int(value) for value in np.round(place + t * way - camera[t]) - 22)
            rows, columns = np.mgrid[y : y + 44, x : x + 44]
            own = (np.hypot(rows - y - 22, columns - x - 22) < 22) & (rows >= 0) & (rows < HEIGHT) & (columns >= 0) & (columns < WIDTH)
            frame[rows[own], columns[own]] = pattern[own]
        frames.append(frame)
    return np.clip(np.round(np.stack(frames) + rng.normal(0, 1.0, (COUNT, HEIGHT, WIDTH, 3))), 0, 255).astype(np.uint8)


def test_it_stands_still_though_every_sharp_thing_moves_by_itself() -> None:
    frames = leaves(np.zeros((COUNT, 2)))
    gray = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in (frames[0], frames[-1])]
    corners = cv2.goodFeaturesToTrack(gray[0], 200, 0.01, 8.0)
    moved, found, _ = cv2.calcOpticalFlowPyrLK(*gray, corners, None, winSize=(15, 15), maxLevel=3)
    shift = np.linalg.norm((moved - corners)[found.ravel() > 0].reshape(-1, 2), axis=1)
    assert np.mean(shift < 1.5) < 0.3, "hardly a corner stays"
    assert stands_still(frames, CAMERA, NOWHERE)


@pytest.mark.parametrize("pixels", [2.0, 4.0])
def test_it_moves_where_it_carries_the_meadow_along(pixels: float) -> None:
    path = pixels * np.stack([np.arange(COUNT), 0.5 * np.arange(COUNT)], axis=1)
    assert not stands_still(leaves(np.round(path)), CAMERA, NOWHERE)


@pytest.mark.parametrize("width", [130, 160])
def test_one_large_thing_that_moves_has_no_more_say_than_its_place(width: int) -> None:
    """A patterned slab with all the sharp corners in it slides over much of a wall that stays."""
    rng = np.random.default_rng(2)
    wall = noise(rng, (HEIGHT, WIDTH), (40, 40, 36), (220, 216, 210), 5.0)
    slab = noise(rng, (HEIGHT, 2 * WIDTH), (10, 10, 20), (250, 240, 230), 1.5)
    frames = []
    for t in range(COUNT):
        frame, left = wall.copy(), 110 + 5 * t
        frame[20:220, left : left + width] = slab[20:220, : min(width, WIDTH - left)]
        frames.append(frame)
    seen = np.clip(np.round(np.stack(frames) + rng.normal(0, 1.0, (COUNT, HEIGHT, WIDTH, 3))), 0, 255).astype(np.uint8)
    assert stands_still(seen, CAMERA, NOWHERE)


def test_a_path_that_the_frames_contradict_is_said() -> None:
    path = np.tile(CAMERA.pose(0), (COUNT, 1, 1))
    path[:, 0, 3] += 0.01 * np.arange(COUNT)
    moving, still = replace(CAMERA, camera_to_world=path), leaves(np.zeros((COUNT, 2)))
    pixels = 0.01 * CAMERA.fx * np.arange(COUNT)
    said = path_doubt(still, moving, NOWHERE, 1.0)
    assert said is not None and f"by {pixels[-1]:.0f} px" in str(said)
    filmed = leaves(np.round(np.stack([pixels, np.zeros(COUNT)], axis=1)))
    assert path_doubt(filmed, moving, NOWHERE, 1.0) is None
    assert path_doubt(still, CAMERA, NOWHERE, 1.0) is None, "a camera that says itself that it stands still"
    assert path_doubt(np.full_like(still, 120), moving, NOWHERE, 1.0) is None, "a plain wall tells nothing"
