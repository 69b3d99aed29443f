"""A panning camera: what moves before the surroundings is distinguished from what stands still, although the colours of both differ from
the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from interrupted import assert_same, in_pieces
from scenes import noise, write_video

from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.mask.from_box import better_drawn, by_colors
from seeing_wind.engine.observe.mask.moving.registered import registered
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import ObserveSettings

HEIGHT, WIDTH, FRAMES = 180, 240, 20
PAN, DRIFT, RADIUS = 5, 3, 26
"""Motion of the camera to the right, and of the disc over the wall [px per frame]; radius of the disc [px]."""

Filmed = tuple[list[np.ndarray], np.ndarray]
"""Frames (H, W, 3) uint8, and masks (T+1, H, W) bool."""


def overlap(found: np.ndarray, true: np.ndarray) -> float:
    return float((found & true).sum() / (found | true).sum())


@pytest.fixture(scope="module")
def panned() -> Filmed:
    """A red disc moves away from between two blue boards on a mottled wall."""
    rng = np.random.default_rng(4)
    wall = noise(rng, (HEIGHT, WIDTH + PAN * FRAMES), (60, 70, 60), (190, 180, 170), 2.5)
    for top in (32, 130):
        wall[top : top + 14, 40:95] = noise(rng, (14, 55), (40, 40, 150), (80, 90, 230), 2.5)
    disc = noise(rng, (2 * RADIUS + 1, 2 * RADIUS + 1), (150, 40, 40), (230, 90, 80), 2.5)
    return filmed(wall, disc, rng)


def filmed(wall: np.ndarray, disc: np.ndarray, rng: np.random.Generator) -> Filmed:
    """The disc that drifts over the wall, from a camera that follows it slowly."""
    own = np.hypot(*np.mgrid[-RADIUS : RADIUS + 1, -RADIUS : RADIUS + 1]) <= RADIUS
    frames, masks = [], []
    for t in range(FRAMES):
        frame, mask = wall.copy(), np.zeros(wall.shape[:2], bool)
        place = np.s_[60 : 61 + 2 * RADIUS, 40 + (DRIFT + PAN) * t : 41 + 2 * RADIUS + (DRIFT + PAN) * t]
        frame[place][own], mask[place] = disc[own], own
        seen = np.s_[:, PAN * t : PAN * t + WIDTH]
        frames.append(np.clip(np.round(frame[seen] + rng.normal(0, 1.0, (HEIGHT, WIDTH, 3))), 0, 255).astype(np.uint8))
        masks.append(mask[seen])
    return frames, np.stack(masks)


def test_what_stands_still_in_the_box_before_a_panning_camera_is_left_out(panned: Filmed, tmp_path: Path) -> None:
    frames, masks = panned
    write_video(tmp_path / "clip.avi", frames, 30.0)
    box = box_round(masks[0], 12.0, 36.0)
    seen = observe(tmp_path / "clip.avi", ObserveSettings(box=box, distance=1.0), NoProgress())
    assert any("camera moves" in one for one in seen.doubts.because)
    assert overlap(np.asarray(seen.masks[0]), masks[0]) > 0.9
    inside = np.zeros_like(masks[0])
    inside[int(box[1]) : int(box[3]) + 1, int(box[0]) : int(box[2]) + 1] = True
    assert overlap(by_colors(frames[0], inside, NoProgress()), masks[0]) < 0.75


def test_registered_frames_show_the_wall_where_frame_0_does(panned: Filmed) -> None:
    frames, masks = panned
    views = registered(np.stack(frames), masks[0], NoProgress())
    assert views is not None and len(views) == FRAMES
    for t in (5, 12, 19):
        # Beyond what the disc ever hides, and what the camera leaves behind on the left shows frame 0 itself.
        off = np.ones_like(masks[0])
        off[55 : 66 + 2 * RADIUS] = False
        away = np.abs(views[t].astype(int) - frames[0])[off]
        assert np.median(away) <= 3 and np.percentile(away, 99) < 12
        assert np.array_equal(views[t][:40, : PAN * t - 2], frames[0][:40, : PAN * t - 2])


def test_a_plain_wall_registers_nothing(panned: Filmed) -> None:
    frames, masks = panned
    assert registered(np.full_like(np.stack(frames), 120), masks[0], NoProgress()) is None


def test_an_outline_along_steeper_edges_is_taken_where_it_spans_as_much() -> None:
    frame = np.full((80, 80, 3), 60, np.uint8)
    true, inside, loose = np.zeros((3, 80, 80), bool)
    true[25:55, 25:55], inside[10:70, 10:70] = True, True
    frame[true] = 200
    frame = np.clip(frame + np.random.default_rng(0).normal(0, 2, frame.shape), 0, 255).astype(np.uint8)
    loose[12:68, 12:68] = True
    small, nowhere = np.zeros_like(true), np.zeros((80, 80), bool)
    small[25:55, 25:35] = True
    assert np.array_equal(better_drawn(frame, loose, true, inside, nowhere), loose), "it spans less of the box"
    loose[:] = False
    loose[22:56, 24:57] = True
    assert np.array_equal(better_drawn(frame, loose, true, inside, nowhere), true)
    assert np.array_equal(better_drawn(frame, true, loose, inside, nowhere), true)
    assert np.array_equal(better_drawn(frame, true, small, inside, nowhere), true)
    assert np.array_equal(better_drawn(frame, true, np.zeros_like(true), inside, nowhere), true)
    assert np.array_equal(better_drawn(frame, loose, true, inside, true & ~small), loose), "most of it stands still"


@pytest.fixture(scope="module")
def alike(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A disc of the wall's own colours before it; the clip and masks (T+1, H, W) bool."""
    rng = np.random.default_rng(8)
    wall = noise(rng, (HEIGHT, WIDTH + PAN * FRAMES), (60, 60, 60), (200, 195, 190), 6.0)
    disc = noise(rng, (2 * RADIUS + 1, 2 * RADIUS + 1), (60, 60, 60), (200, 195, 190), 6.0)
    frames, masks = filmed(wall, disc, rng)
    path = tmp_path_factory.mktemp("alike") / "clip.avi"
    write_video(path, frames, 30.0)
    return path, masks


def box_round(mask: np.ndarray, across: float, down: float) -> tuple[float, float, float, float]:
    rows, columns = np.nonzero(mask)
    return columns.min() - across, rows.min() - down, columns.max() + across, rows.max() + down


@pytest.fixture(scope="module")
def whole(alike: tuple[Path, np.ndarray]) -> Observation:
    """The observation of the clip, made without interruption."""
    path, masks = alike
    return observe(path, ObserveSettings(box=box_round(masks[0], 12.0, 12.0), distance=1.0), NoProgress())


def test_what_a_panning_camera_has_shown_beside_a_thing_does_not_come_in_later(alike: tuple[Path, np.ndarray], whole: Observation) -> None:
    seen, (_, masks) = whole, alike
    overlaps = [overlap(np.asarray(seen.masks[t]), masks[t]) for t in range(FRAMES)]
    assert min(overlaps) > 0.75 and overlaps[-1] > 0.9


def test_a_killed_observation_of_a_panned_clip_goes_on_to_the_same(
    alike: tuple[Path, np.ndarray], whole: Observation, tmp_path: Path
) -> None:
    path, masks = alike
    settings = ObserveSettings(box=box_round(masks[0], 12.0, 12.0), distance=1.0)
    found, kills, _ = in_pieces(path, settings, tmp_path, 9)
    assert_same(found, whole)
    assert kills > 2
