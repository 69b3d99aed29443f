"""Corrections of the outline in any frame, carried to the others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from interrupted import assert_same, in_pieces
from scenes import HEIGHT, WIDTH, Scene, noise, painted_scene

from seeing_wind.engine.command.arguments import parser, settings_of
from seeing_wind.engine.errors import ObjectError, UsageError
from seeing_wind.engine.masks import Masks
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.mask.corrected import Marks, corrected, marks_of, with_marks
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.settings import ObserveSettings, words_of

SKIN = noise(np.random.default_rng(7), (90, 90), (120, 40, 20), (255, 200, 110), 1.6)


@pytest.fixture(scope="module")
def patched(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """A patterned disc that swings, with a round patch at its right rim of the paper's own colours, which nobody tells from the paper."""
    paper = noise(np.random.default_rng(6), (HEIGHT, WIDTH), (95, 82, 66), (150, 136, 114), 1.5)

    def body(t: int, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
        skin = cv2.remap(SKIN.astype(np.float32), (dx + 44.5).astype(np.float32), (dy + 44.5).astype(np.float32), cv2.INTER_CUBIC)
        return np.where((np.hypot(dx - 24, dy) < 14)[..., None], paper, skin)

    t = np.arange(13.0)
    centers = np.stack([90 + 14.0 * np.sin(0.5 * t), 80 + 2.0 * np.sin(0.9 * t)], axis=1)
    return painted_scene(tmp_path_factory.mktemp("patched"), centers, 0.0 * t, 34.0, body)


@pytest.fixture(scope="module")
def settings(patched: Scene) -> ObserveSettings:
    return ObserveSettings(box=tuple(np.add(patched.box, (-5, -5, 5, 5))), distance=1.0)


def overlaps(masks: Masks, true: np.ndarray) -> np.ndarray:
    return np.array([(np.asarray(a) & b).sum() / (np.asarray(a) | b).sum() for a, b in zip(masks, true)])


def test_an_outline_of_one_frame_mends_those_before_and_behind(patched: Scene, settings: ObserveSettings, tmp_path: Path) -> None:
    found = overlaps(observe(patched.path, settings, NoProgress()).masks, patched.masks)
    assert cv2.imwrite(str(tmp_path / "true.png"), patched.masks[6].astype(np.uint8) * 255)
    told = replace(settings, outline=str(tmp_path / "true.png"), outline_frame=6)
    mended = overlaps(observe(patched.path, told, NoProgress()).masks, patched.masks)
    assert mended[6] == 1.0
    assert np.delete(mended, 6).min() > found.max() + 0.03, "before it and behind it"


def test_an_outline_of_a_later_frame_alone_marks_the_object(disc: Scene, tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "true.png"), disc.masks[8].astype(np.uint8) * 255)
    alone = ObserveSettings(outline=str(tmp_path / "true.png"), outline_frame=8, distance=1.0)
    assert overlaps(observe(disc.path, alone, NoProgress()).masks, disc.masks).min() > 0.93
    # Frames are counted in the file, whatever part of it is chosen.
    part = observe(disc.path, replace(alone, frames=(4, 10)), NoProgress())
    assert overlaps(part.masks, disc.masks[4:11]).min() > 0.93


def test_an_outline_of_the_first_frame_is_where_the_object_is_followed_from(tmp_path: Path) -> None:
    """A falling drop: one sees the wall through it, but for a dark rim and lower part."""
    wall = noise(np.random.default_rng(6), (HEIGHT, WIDTH), (110, 106, 100), (140, 136, 130), 4.0)

    def drop(t: int, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
        return wall * np.where(np.hypot(dx, dy) > 31, 0.75, 1.0)[..., None] * np.where(dy > 18, 0.6, 1.0)[..., None]

    t = np.arange(12.0)
    scene = painted_scene(tmp_path, np.stack([90 + 1.5 * t, 50 + 5.0 * t], axis=1), 0.0 * t, 34.0, drop)
    boxed = ObserveSettings(box=tuple(np.add(scene.box, (-5, -5, 5, 5))), distance=1.0)
    found = overlaps(observe(scene.path, boxed, NoProgress()).masks, scene.masks)
    assert cv2.imwrite(str(tmp_path / "true.png"), scene.masks[0].astype(np.uint8) * 255)
    drawn = replace(boxed, outline=str(tmp_path / "true.png"))
    seen = observe(scene.path, drawn, NoProgress())
    better = overlaps(seen.masks, scene.masks)
    assert better[0] == 1.0 and better.min() > 0.7
    gained = (better - found)[1:]
    assert gained.min() > -0.01 and np.median(gained) > 0.1
    again, kills, _ = in_pieces(scene.path, drawn, tmp_path, 7)
    assert kills > 3
    assert_same(again, seen)


def two_halves() -> tuple[np.ndarray, np.ndarray]:
    """A disc, left half red and right half blue, before green; and its mask."""
    rng = np.random.default_rng(1)
    rows, columns = np.mgrid[:120, :160]
    disc = np.hypot(columns - 80, rows - 60) < 36
    frame = np.where(disc[..., None], np.where((columns < 80)[..., None], (190, 60, 50), (50, 70, 190)), (70, 130, 60))
    return np.clip(frame + rng.normal(0, 6, (120, 160, 3)), 0, 255).astype(np.uint8), disc


def test_points_add_what_was_left_out_and_take_away_what_was_taken_in() -> None:
    frame, disc = two_halves()
    columns = np.arange(160)[None]
    half = disc & (columns < 80)
    added = with_marks(frame, half, Marks(np.array([[98.0, 60.0]]), np.zeros((0, 2))), NoProgress())
    assert (added ^ disc).sum() < 0.05 * disc.sum() < 0.5 * (half ^ disc).sum()
    taken = with_marks(frame, disc, Marks(np.zeros((0, 2)), np.array([[98.0, 60.0]])), NoProgress())
    assert (taken ^ half).sum() < 0.05 * disc.sum()


def test_a_point_takes_away_no_more_than_the_mistake_in_whose_middle_it_is() -> None:
    rng = np.random.default_rng(2)
    rows, columns = np.mgrid[:120, :160]
    away = np.hypot(columns - 80, rows - 60)
    # A dark disc in a ring that is nearly as pale as what is behind it, as on an air puck; the outline found is 8 px too large.
    gray = np.where(away < 28, 50.0, np.where(away < 36, 186.0, 196.0)) + rng.normal(0, 5, (120, 160))
    frame = np.repeat(np.clip(gray, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    puck, large = away < 36, away < 44
    taken = with_marks(frame, large, Marks(np.zeros((0, 2)), np.array([[80.0 - 40.0, 60.0]])), NoProgress())
    assert not (taken & ~large).any(), "it adds nothing"
    assert (large & ~taken).sum() > 150 and (puck & ~taken).sum() < 0.02 * puck.sum()


def test_a_point_on_a_tiny_thing_is_taken_at_its_word() -> None:
    frame, _ = two_halves()
    tiny = np.zeros((120, 160), bool)
    tiny[50:60, 50:60] = True
    taken = with_marks(frame, tiny, Marks(np.zeros((0, 2)), np.array([[55.0, 55.0]])), NoProgress())
    assert not taken[55, 55] and taken.sum() > 80
    with pytest.raises(ObjectError, match="nothing of the object"):
        everywhere = np.argwhere(tiny)[:, ::-1].astype(float)
        with_marks(frame, tiny, Marks(np.zeros((0, 2)), everywhere), NoProgress())


def test_where_the_outline_is_wrong_in_another_way_it_stays(patched: Scene) -> None:
    cut = patched.masks & (np.arange(WIDTH) < patched.centers[:, 0].round()[:, None, None] + 20)
    wrong = cut.copy()
    wrong[9:] = patched.masks[9:]  # found right there
    masks = corrected(patched.frames, Masks.of(wrong), {4: patched.masks[4]}, NoProgress())
    assert overlaps(masks, patched.masks)[:9].min() > 0.95 > overlaps(Masks.of(cut), patched.masks)[:9].max()
    assert all((masks[t] == wrong[t]).all() for t in range(9, 13))


def test_points_of_a_later_frame_reach_the_observation(patched: Scene, settings: ObserveSettings) -> None:
    x, y = patched.centers[6]
    seen = observe(patched.path, settings, NoProgress())
    told = observe(patched.path, replace(settings, correct=(6.0, x - 10.0, y, 0.0)), NoProgress())
    at = round(y), round(x - 10.0)
    assert seen.masks[6][at] and not told.masks[6][at]


def test_corrections_are_read_and_written_and_refused(disc: Scene, tmp_path: Path) -> None:
    words = ["observe", str(disc.path), "--take", str(tmp_path / "a.take")]
    read = settings_of(ObserveSettings, parser().parse_args([*words, "--correct", "12+30,40.5", "0-7,8"]))
    assert read.correct == (12.0, 30.0, 40.5, 1.0, 0.0, 7.0, 8.0, 0.0)
    assert words_of(read) == ["--correct", "12+30,40.5", "0-7,8"]
    for wrong in ("30,40", "1+2", "x+1,2", "1.5+2,3", "+1,2", "1+nan,2"):
        with pytest.raises(UsageError, match="--correct"):
            parser().parse_args([*words, "--correct", wrong])
    assert sorted(marks_of((5.0, 1.0, 2.0, 1.0, 5.0, 3.0, 4.0, 0.0), 4, (3, 50, 50))) == [1]
    for outside in ((3.0, 1.0, 2.0, 1.0), (7.0, 1.0, 2.0, 1.0), (5.0, 60.0, 2.0, 1.0)):
        with pytest.raises(UsageError, match="outside"):
            marks_of(outside, 4, (3, 50, 50))


@pytest.mark.parametrize(("frame", "pixels", "error"), [(40, 100, UsageError), (2, 0, ObjectError)])
def test_outlines_refused(disc: Scene, tmp_path: Path, frame: int, pixels: int, error: type[Exception]) -> None:
    outline = np.zeros((HEIGHT, WIDTH), np.uint8)
    outline[40 : 40 + pixels // 10, 40:50] = 255
    assert cv2.imwrite(str(tmp_path / "a.png"), outline)
    with pytest.raises(error, match="outline"):
        observe(disc.path, ObserveSettings(outline=str(tmp_path / "a.png"), outline_frame=frame, distance=1.0), NoProgress())


def test_a_frame_without_an_outline_is_refused(disc: Scene) -> None:
    with pytest.raises(UsageError, match="--outline-frame"):
        observe(disc.path, ObserveSettings(box=disc.box, outline_frame=3, distance=1.0), NoProgress())
    with pytest.raises(UsageError, match="--mask-model"):
        observe(disc.path, ObserveSettings(box=disc.box, mask_model="sam", correct=(0.0, 1.0, 1.0, 1.0), distance=1.0), NoProgress())
