"""The outline from a box alone where colours mislead: a shadow, two parts of different colours, a thing of the background's tint."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import noise, write_video

from seeing_wind.engine.masks import Masks
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.mask.background import Plate, plate_behind
from seeing_wind.engine.observe.mask.carried import Carried
from seeing_wind.engine.observe.mask.cutting import tidy
from seeing_wind.engine.observe.mask.evidence import Contrast, against_plate, against_shape, cut_out, total_odds
from seeing_wind.engine.observe.mask.follow import MaskFollower, Surroundings
from seeing_wind.engine.observe.mask.motion import Flow
from seeing_wind.engine.observe.mask.moving.in_box import moving_in
from seeing_wind.engine.observe.mask.moving.soon import moving_odds
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.settings import ObserveSettings

HEIGHT, WIDTH = 180, 240


def parts_scene(folder: Path, shadow: float) -> tuple[Path, np.ndarray]:
    """A bright disc over a dark square, moving together before a mottled wall, with a soft shadow of strength `shadow`; path and masks."""
    rng = np.random.default_rng(3)
    wall = noise(rng, (HEIGHT, WIDTH), (120, 112, 100), (170, 160, 142), 3.0)
    pattern = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)), (0, 0), 1.5)
    pattern = 22.0 * pattern / pattern.std()
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    frames, masks = [], []
    for t in range(16):
        x, y = 60 + 7 * t, 60 + round(0.2 * t * t)
        disc = np.hypot(columns - x, rows - y) < 20
        square = (np.abs(columns - x) < 14) & (np.abs(rows - y - 32) < 14)
        own = np.roll(pattern, (y, x), (0, 1))[..., None]
        dark = cv2.GaussianBlur(np.roll((disc | square).astype(np.float64), (12, 14), (0, 1)), (0, 0), 3.0)
        frame = wall * (1.0 - shadow * dark[..., None])
        frame = np.where(disc[..., None], np.array([225, 190, 60]) + own, frame)
        frame = np.where(square[..., None], np.array([40, 60, 130]) + own, frame)
        frames.append(np.clip(np.round(frame + rng.normal(0, 1.5, frame.shape)), 0, 255).astype(np.uint8))
        masks.append(disc | square)
    write_video(folder / "clip.avi", frames, 30.0)
    return folder / "clip.avi", np.stack(masks)


def box_of(mask: np.ndarray, margin: float = 6.0) -> tuple[float, float, float, float]:
    rows, columns = np.nonzero(mask)
    return columns.min() - margin, rows.min() - margin, columns.max() + margin, rows.max() + margin


@pytest.mark.parametrize(
    ("size", "count", "step"), [(20, 5, 4), (24, 6, 4), (30, 5, 60)], ids=["shorter path", "hardly longer path", "leaps twice its size"]
)
def test_a_plain_thing_is_whole_whatever_its_path(tmp_path: Path, size: int, count: int, step: int) -> None:
    frames, masks = np.full((count, 120, 320, 3), 90, np.uint8), np.zeros((count, 120, 320), bool)
    for t in range(count):
        masks[t, 40 : 40 + size, 20 + step * t : 20 + step * t + size] = True
    frames[masks] = 200
    write_video(tmp_path / "clip.avi", list(frames), 25.0)
    seen = observe(tmp_path / "clip.avi", ObserveSettings(box=box_of(masks[0], 4.0), distance=1.0), NoProgress())
    found = np.asarray(seen.masks)
    assert ((found & masks).sum(axis=(1, 2)) > 0.75 * (found | masks).sum(axis=(1, 2))).all()


@pytest.mark.parametrize("shadow", [0.0, 0.4])
def test_parts_of_two_colours_move_together_and_their_shadow_is_left_out(tmp_path: Path, shadow: float) -> None:
    path, masks = parts_scene(tmp_path, shadow)
    found = np.asarray(observe(path, ObserveSettings(box=box_of(masks[0]), distance=1.0), NoProgress()).masks)
    iou = (found & masks).sum(axis=(1, 2)) / (found | masks).sum(axis=(1, 2))
    assert np.median(iou) > 0.9 and iou.min() > 0.8


def test_what_stands_still_in_a_loose_box_is_background(tmp_path: Path) -> None:
    path, masks = parts_scene(tmp_path, 0.0)
    loose = box_of(masks[0], 25.0)
    first = np.asarray(observe(path, ObserveSettings(box=loose, distance=1.0), NoProgress()).masks[0])
    assert (first & ~masks[0]).sum() < 0.1 * masks[0].sum()


def test_a_box_in_which_nothing_moves_is_told(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    wall = noise(rng, (HEIGHT, WIDTH), (120, 112, 100), (170, 160, 142), 3.0)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    still = (np.abs(columns - 180) < 20) & (np.abs(rows - 50) < 15)
    moves = [np.hypot(columns - 60 - 4 * t, rows - 130) < 20 for t in range(12)]
    frames = [np.where((still | one)[..., None], (190.0, 40.0, 30.0), wall) + rng.normal(0, 1.5, wall.shape) for one in moves]
    write_video(tmp_path / "clip.avi", [np.clip(one, 0, 255).astype(np.uint8) for one in frames], 30.0)
    for thing, told in ((moves[0], False), (still, True)):
        seen = observe(tmp_path / "clip.avi", ObserveSettings(box=box_of(thing), distance=1.0), NoProgress())
        assert any("Next to nothing in the box" in one.because for one in seen.doubts) == told


def test_the_background_in_a_ring_s_hole_is_not_the_ring(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    wall = noise(rng, (HEIGHT, WIDTH), (120, 112, 100), (170, 160, 142), 3.0)
    skin = noise(rng, (HEIGHT, WIDTH), (150, 40, 30), (240, 120, 60), 1.5)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    away = [np.hypot(columns - 45 - 7 * t, rows - 80) for t in range(18)]
    rings = np.stack([(one < 30) & (one >= 12) for one in away])
    frames = [np.where(ring[..., None], np.roll(skin, 7 * t, 1), wall) + rng.normal(0, 1.5, wall.shape) for t, ring in enumerate(rings)]
    write_video(tmp_path / "clip.avi", [np.clip(one, 0, 255).astype(np.uint8) for one in frames], 30.0)
    found = np.asarray(observe(tmp_path / "clip.avi", ObserveSettings(box=box_of(rings[0]), distance=1.0), NoProgress()).masks)
    assert ((found & rings).sum(axis=(1, 2)) / (found | rings).sum(axis=(1, 2))).min() > 0.9
    assert not (found & (np.stack(away) < 9)).any()


def test_a_small_hole_is_filled_and_a_large_one_is_not() -> None:
    rows, columns = np.mgrid[:100, :100]
    away = np.hypot(columns - 50, rows - 50)
    for hole, filled in ((10.0, True), (20.0, False)):
        ring = (away < 40) & (away >= hole)
        assert tidy(ring)[50, 50] == filled


def test_the_background_is_not_learnt_from_a_part_of_the_object_that_its_outline_missed() -> None:
    wall = np.full((80, 160, 3), 90, np.uint8)
    columns, rows = np.meshgrid(np.arange(160), np.arange(80))
    away = np.stack([np.hypot(columns - 40 - 4 * t, rows - 40) for t in range(21)])
    frames = np.where((away < 26)[..., None], np.uint8(150), wall)
    found = Masks.of((away < 26) & (away >= 20))
    median = np.median(frames, axis=0).astype(np.uint8)
    before = Plate(median, np.zeros((80, 160), bool), 2.0)
    plate = plate_behind(frames, found, before, median, NoProgress())
    # The ring alone leaves its middle open in twelve frames, and what is seen there is the disc.
    assert plate.reliable[40, 60:101].all() and (plate.color[40, 60:101] == 90).all()


def test_what_was_lost_of_a_silhouette_grows_back_at_once() -> None:
    rng = np.random.default_rng(8)
    wall = noise(rng, (HEIGHT, WIDTH), (90, 96, 110), (120, 126, 140), 3.0)
    skin = noise(rng, (HEIGHT, WIDTH), (150, 40, 30), (240, 120, 60), 1.5)
    square = np.zeros((HEIGHT, WIDTH), bool)
    square[40:140, 60:200] = True
    frame = np.where(square[..., None], skin, wall).astype(np.uint8)
    follower = MaskFollower(frame, square, Surroundings(Plate(wall.astype(np.uint8), np.ones_like(square), 2.0)), NoProgress())
    state = follower.state()
    state |= {"shape": state["shape"][:, :40], "template": state["template"][:, :40], "shape_window": np.array([60, 40, 100, 140])}
    part = square.copy()
    part[:, 100:] = False
    follower.resume(frame, part, state)
    found = follower.advance(frame)
    # By three bands of nine pixels and what filters reach alone, it would be half.
    assert (found & square).sum() > 0.75 * square.sum() and not (found & ~square).any()


def test_another_thing_that_touches_the_object_is_not_taken_in(tmp_path: Path) -> None:
    """Two discs collide on a dark ground, and one pushes the other on."""
    rng = np.random.default_rng(9)
    ground = noise(rng, (HEIGHT, WIDTH), (16, 20, 14), (60, 66, 56), 3.0)
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    frames, masks = [], []
    for t in range(24):
        met, after = min(t, 10), max(t - 10, 0)
        own = np.hypot(columns - 50 - 7.0 * met - 1.5 * after, rows - 90 + 2.5 * after) < 18
        other = np.hypot(columns - 184 + 3.0 * met - 3.5 * after, rows - 90 - 5.5 * (10 - met) + 1.0 * after) < 18
        frame = np.where(other[..., None], np.array([150, 90, 70]), ground)
        frame = np.where(own[..., None], np.array([90, 110, 150]), frame)
        frame = cv2.GaussianBlur(frame.astype(np.float64), (0, 0), 0.8) + rng.normal(0, 2, frame.shape)
        frames.append(np.clip(frame, 0, 255).astype(np.uint8))
        masks.append(own)
    write_video(tmp_path / "clip.avi", frames, 30.0)
    true = np.stack(masks)
    found = np.asarray(observe(tmp_path / "clip.avi", ObserveSettings(box=box_of(true[0]), distance=1.0), NoProgress()).masks)
    assert ((found & true).sum(axis=(1, 2)) / (found | true).sum(axis=(1, 2))).min() > 0.8


def test_motion_tells_the_object_from_what_stands_still(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    wall, thing = noise(rng, (100, 140), (60, 60, 60), (200, 200, 200), 1.5), noise(rng, (40, 40), (60, 60, 60), (200, 200, 200), 1.5)
    frames = np.repeat(wall[None], 6, axis=0)
    for t in range(6):
        frames[t, 30:70, 40 + 2 * t : 80 + 2 * t] = thing
    odds = moving_odds(np.clip(frames + rng.normal(0, 1, frames.shape), 0, 255).astype(np.uint8), (0, 0, 140, 100), 2.0)
    assert odds[40:60, 50:70].min() > 0.0
    assert odds[:20].max() <= 0.0 and odds[:20].mean() < -1.0


def test_a_shadow_is_background_unless_the_object_looks_so() -> None:
    rng = np.random.default_rng(2)
    color = noise(rng, (60, 60), (120, 110, 100), (170, 160, 150), 4.0).astype(np.uint8)
    plate = Plate(color, np.ones((60, 60), bool), 2.0)
    dark = np.full((60, 60), 1.0)
    dark[15:45, 15:45] = 0.6
    shaded = (color * cv2.GaussianBlur(dark, (0, 0), 3.0)[..., None]).astype(np.uint8)
    mask = np.zeros((60, 60), bool)
    mask[22:38, 22:38] = True
    window = (0, 0, 60, 60)
    odds, known = against_plate(shaded, plate, window, Contrast())
    assert known.all() and (odds[25:35, 25:35] < -1.0).mean() > 0.95
    gray, _ = against_plate(shaded, plate, window, Contrast(plate, [(shaded, mask)]))
    assert np.median(gray[25:35, 25:35]) > odds[25:35, 25:35].max(), "a thing that is the wall's colour, only darker, would be lost"
    red = shaded.copy()
    red[mask] = (180, 30, 30)
    # The shadow was taken for a part of the thing, and is not.
    odds, _ = against_plate(red, plate, window, Contrast(plate, [(red, dark < 1.0)]))
    assert odds[25:35, 25:35].min() > 2.0
    assert np.median(odds[(dark < 1.0) & ~cv2.dilate(mask.astype(np.uint8), np.ones((5, 5))).astype(bool)]) < -1.0


def test_what_a_codec_leaves_round_a_thing_is_not_the_thing() -> None:
    plate = Plate(np.full((80, 80, 3), 90, np.uint8), np.ones((80, 80), bool), 1.0)
    mask, trace = np.zeros((80, 80), bool), np.zeros((80, 80), bool)
    mask[30:50, 30:50] = trace[22:58, 22:58] = True
    frame = plate.color.copy()
    frame[trace], frame[mask] = (98, 90, 84), (200, 40, 40)
    usual, _ = against_plate(frame, plate, (0, 0, 80, 80), Contrast())
    learnt, _ = against_plate(frame, plate, (0, 0, 80, 80), Contrast(plate, [(frame, mask)]))
    beside = trace & ~cv2.dilate(mask.astype(np.uint8), np.ones((9, 9))).astype(bool)
    assert np.median(usual[beside]) > 0.0 > np.median(learnt[beside]) + 1.0
    assert learnt[33:47, 33:47].min() > 3.0


def test_what_shows_beside_a_thing_in_a_later_frame_only_is_learnt_there() -> None:
    plate = Plate(np.full((80, 80, 3), 90, np.uint8), np.ones((80, 80), bool), 1.0)
    mask, beside = np.zeros((80, 80), bool), np.zeros((80, 80), bool)
    mask[30:50, 30:50] = beside[30:50, 52:60] = True
    first = plate.color.copy()
    first[mask] = (200, 40, 40)
    later = first.copy()
    later[beside] = (97, 90, 84)
    once, _ = against_plate(later, plate, (0, 0, 80, 80), Contrast(plate, [(first, mask)]))
    often, _ = against_plate(later, plate, (0, 0, 80, 80), Contrast(plate, [(first, mask), (later, mask)]))
    inner = np.s_[34:46, 55:57]
    assert np.median(once[inner]) > 0.0 > np.median(often[inner]), "it is no part of the thing"
    assert often[33:47, 33:47].min() > 3.0


def test_motion_in_a_window_is_found_once() -> None:
    frames = np.random.default_rng(0).integers(0, 256, (4, 60, 60, 3)).astype(np.uint8)
    moving = moving_in(frames, 2.0)
    assert moving((5, 5, 50, 50)) is moving((5, 5, 50, 50))
    assert np.array_equal(moving((5, 5, 50, 50)), moving_odds(frames, (5, 5, 50, 50), 2.0))


def test_what_is_carried_goes_on_where_an_interrupted_run_left_it() -> None:
    part, everywhere = np.zeros((60, 80), bool), (0, 0, 80, 60)
    part[20:31, 10:25] = True
    one, other = Carried("part", part), Carried("part")
    one.shift(np.array([0.4, -2.0]))
    other.resume(one.state())
    for each in (one, other):
        each.shift(np.array([0.4, 0.0]))  # with what was left of the former
        assert np.array_equal(each.over(everywhere), np.roll(part, (-2, 1), (0, 1)))
        each.flow(Flow(0, 0, np.full((60, 80, 2), (5.0, 3.0), np.float32)))
        assert np.array_equal(each.over(everywhere), np.roll(part, (1, 6), (0, 1))), "its border stays where it is"


def test_beside_another_thing_colours_tell_what_is_no_background() -> None:
    nothing, colors = np.zeros((20, 20), bool), np.where(np.arange(20) < 10, 1.0, -1.0) * np.ones((20, 1))
    seen, other = (np.full((20, 20), 3.0), ~nothing), nothing.copy()
    assert (total_odds(np.zeros((20, 20)), seen, colors, nothing) > 0.0).all(), "it is no background"
    other[:, 16:] = True
    odds = total_odds(np.zeros((20, 20)), seen, colors, other, 2.0)
    assert (odds[:, :10] > 0.0).all() and (odds[:, 12:] < 0.0).all(), "nor does motion tell the two apart there"


def test_evidence_is_cut_along_the_edges_of_the_frame() -> None:
    frame = np.full((60, 60, 3), 40, np.uint8)
    frame[:, 30:] = 200
    expected = np.zeros((60, 60), bool)
    expected[:, 32:] = True
    found = cut_out(against_shape(expected, 8.0), frame, 1800.0)
    assert abs(found.sum() - 60 * 30) < 60 * 3
    assert against_shape(expected, 8.0)[30, 59] > 0.0 > against_shape(expected, 8.0)[30, 0]


