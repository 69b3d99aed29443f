"""Parts at a silhouette that are not the object: its shadow and things that the box cuts through; and what a filter removes from a small
object."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from seeing_wind.engine.observe.mask.background import Plate
from seeing_wind.engine.observe.mask.evidence import Contrast, against_plate, cut_out
from seeing_wind.engine.observe.mask.rim import core, cut_again, cut_back, halved, without_cut_parts, without_shadow
from seeing_wind.engine.progress import NoProgress

SIZE = 120
ROWS, COLUMNS = np.mgrid[:SIZE, :SIZE].astype(np.float64)
FLOOR = np.array([205.0, 200.0, 190.0])
BALL = np.hypot(ROWS - 55, COLUMNS - 60) < 26


def plate(noise: float = 2.0) -> Plate:
    return Plate(np.tile(np.round(FLOOR).astype(np.uint8), (SIZE, SIZE, 1)), np.ones((SIZE, SIZE), bool), noise)


def overlap(found: np.ndarray, true: np.ndarray) -> float:
    return float((found & true).sum() / (found | true).sum())


def painted(thing: np.ndarray, color: tuple[float, float, float], light: np.ndarray | float = 1.0) -> np.ndarray:
    """A `thing` (SIZE, SIZE) bool on the floor, which has the `light` (SIZE, SIZE) of the plate, through a lens; uint8."""
    frame = np.tile(FLOOR, (SIZE, SIZE, 1)) * np.broadcast_to(light, (SIZE, SIZE))[..., None]
    frame = np.where(thing[..., None], np.array(color), frame)
    return np.round(cv2.GaussianBlur(frame, (0, 0), 0.8)).astype(np.uint8)


def under(blur: float) -> tuple[np.ndarray, np.ndarray]:
    """A shadow below the ball: the light that it leaves (SIZE, SIZE), and where that is missing (SIZE, SIZE) bool."""
    shade = cv2.GaussianBlur(((((ROWS - 81) / 4) ** 2 + ((COLUMNS - 60) / 17) ** 2) < 1).astype(np.float64), (0, 0), blur)
    return 1.0 - 0.6 * shade, (0.6 * shade > 0.05) & ~BALL


def test_a_shadow_that_moves_along_is_left_out() -> None:
    light, dark = under(3.0)
    found = without_shadow(painted(BALL, (230, 200, 60), light), BALL | dark, plate())
    assert overlap(BALL | dark, BALL) < 0.87
    assert overlap(found, BALL) > 0.91


def test_a_dark_part_with_an_edge_as_sharp_as_the_object_s_is_no_shadow() -> None:
    light, _ = under(0.5)
    part = (light < 0.7) & ~BALL
    whole = BALL | part
    assert np.array_equal(without_shadow(painted(BALL, (230, 200, 60), light), whole, plate()), whole)


@pytest.mark.parametrize("color", [(60, 60, 60), (230, 200, 60)])
def test_an_object_without_a_shadow_stays_as_it_is(color: tuple[float, float, float]) -> None:
    assert np.array_equal(without_shadow(painted(BALL, color), BALL, plate()), BALL)
    nothing = np.zeros_like(BALL)
    assert not without_shadow(painted(BALL, color), nothing, plate()).any()


def test_a_bright_part_that_fades_out_is_no_shadow() -> None:
    light, dark = under(3.0)
    whole = BALL | dark
    dim = Plate(np.full((SIZE, SIZE, 3), 40, np.uint8), np.ones((SIZE, SIZE), bool), 2.0)
    assert np.array_equal(without_shadow(painted(BALL, (250, 240, 90), light), whole, dim), whole)


def test_what_the_box_cuts_through_is_something_else() -> None:
    """A rod that goes on outside the box, taken in with the ball; a handle that ends at the border belongs to it."""
    inside = np.zeros_like(BALL)
    inside[22:88, 26:94] = True
    rod = (np.abs(ROWS - 55) < 5) & (COLUMNS > 60) & ~BALL
    frame = painted(BALL | rod, (60, 60, 200))
    frame[rod & (COLUMNS > 87)] = (250, 250, 250)
    frame[rod & (COLUMNS <= 87)] = (250, 250, 250)
    found = without_cut_parts(frame, (BALL | rod) & inside, inside, plate())
    assert overlap(found, BALL) > 0.97
    short = rod & (COLUMNS < 94)
    frame = painted(BALL, (60, 60, 200))
    frame[short] = (250, 250, 250)
    assert overlap(without_cut_parts(frame, BALL | short, inside, plate()), BALL | short) > 0.99


def test_a_tight_box_takes_nothing_off_the_object() -> None:
    rows, columns = np.nonzero(BALL)
    tight = np.zeros_like(BALL)
    tight[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
    colors = np.where((((ROWS // 6) + (COLUMNS // 6)) % 2 == 0)[..., None], (230.0, 60.0, 60.0), (40.0, 60.0, 220.0))
    frame = np.where(BALL[..., None], colors, FLOOR).astype(np.uint8)
    assert np.array_equal(without_cut_parts(frame, BALL, tight, plate()), BALL)


def test_an_outline_that_was_carried_a_little_off_is_found_again() -> None:
    frame, off = painted(BALL, (120, 150, 170)), np.roll(BALL, (2, -2), (0, 1))
    assert overlap(off, BALL) < 0.88
    assert overlap(cut_again(frame, off, NoProgress()), BALL) > 0.97
    nothing = np.zeros_like(BALL)
    assert not cut_back(frame, nothing, None, NoProgress()).any()


@pytest.mark.parametrize(("apart", "grain", "half"), [(6.0, 8.0, 2), (6.0, 20.0, 4), (20.0, 20.0, 2)])
def test_a_stem_that_hardly_stands_out_keeps_its_length_below_a_thick_head(apart: float, grain: float, half: int) -> None:
    head, stem = np.hypot(ROWS - 35, COLUMNS - 60) < 26, (np.abs(COLUMNS - 60) < half) & (ROWS > 40)
    frame = np.tile(FLOOR, (SIZE, SIZE, 1)) - apart * stem[..., None] + np.random.default_rng(0).normal(0.0, grain, (SIZE, SIZE, 3))
    frame = np.clip(np.where(head[..., None], np.array([90.0, 40.0, 30.0]), frame), 0, 255).astype(np.uint8)
    found = cut_back(frame, head | stem, None, NoProgress())
    assert found[:, 60][stem[:, 60]].all() and overlap(found, head | stem) > 0.9


def test_an_outline_ends_where_half_of_a_blur_is_its_own() -> None:
    """Also where nothing is known of the background; what has no inside stays as it is."""
    light, line = painted(BALL, (250, 250, 250)), np.abs(COLUMNS - 60) < 1
    for frame in (light, 255 - light):
        larger = cv2.dilate(BALL.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        assert overlap(larger, BALL) < 0.94 and overlap(halved(frame, larger), BALL) > 0.97
    assert np.array_equal(halved(painted(line, (20, 20, 20)), line), line)


def test_the_object_is_not_learnt_from_a_smear_beside_it() -> None:
    """A codec's smear that was taken in with the object in one of the frames it is learnt from is no part of it in the others."""
    smear = (np.abs(ROWS - 55) < 24) & (np.abs(COLUMNS - 85) < 7)
    tint = cv2.GaussianBlur(smear.astype(np.float64), (0, 0), 2.0)[..., None] * np.array([-14.0, 8.0, -16.0])
    frame = np.round(painted(BALL, (60, 60, 200)) + np.where(BALL[..., None], 0.0, tint)).astype(np.uint8)
    whole = BALL | smear
    assert overlap(whole, BALL) < 0.85 and overlap(core(cv2.GaussianBlur(frame, (0, 0), 1.0), whole), BALL) > 0.95
    learnt = Contrast(plate(), [(frame, whole), (frame, BALL), (frame, BALL)])
    odds, _ = against_plate(frame, plate(), (0, 0, SIZE, SIZE), learnt)
    assert np.median(odds[smear & (COLUMNS > 88)]) < 0.0 < np.median(odds[BALL])


def test_a_small_thing_is_not_rounded_off_by_its_surroundings() -> None:
    small = np.hypot(ROWS - 60, COLUMNS - 60) < 6.5
    odds = np.where(small, 2.5, -8.0).astype(np.float32)
    frame = np.full((SIZE, SIZE, 3), 90, np.uint8)
    assert overlap(cut_out(odds, frame, float(small.sum())), small) > 0.7 > 0.6 > overlap(cut_out(odds, frame, 1000.0), small)
