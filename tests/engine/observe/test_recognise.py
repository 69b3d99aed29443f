"""Points that were hidden and reappear: they are found by their appearance, and only where they really are."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from scenes import noise

from seeing_wind.engine.command.arguments import observe_settings, parser
from seeing_wind.engine.masks import Masks
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.clip.shake import as_filmed, homography
from seeing_wind.engine.observe.tracks.recognise import are_lost, recognise
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.records import Camera, Recognised
from seeing_wind.engine.settings import ObserveSettings

HEIGHT, WIDTH, SIDE = 240, 320, 120
MOTIONS = [
    np.array([[1.0, 0.0, 60.0], [0.0, 1.0, 50.0]]),
    np.array([[1.0, 0.0, 75.0], [0.05, 1.0, 55.0]]),
    np.array([[0.8, 0.2, 120.0], [-0.25, 0.95, 80.0]]),
]
"""Affine maps (2, 3) of the printed square into each frame."""


def print_of(seed: int) -> np.ndarray:
    """(SIDE, SIDE, 3) float32."""
    return noise(np.random.default_rng(seed), (SIDE, SIDE), (120, 40, 10), (255, 190, 90), 2.0).astype(np.float32)


def filmed(prints: list[np.ndarray | None]) -> tuple[np.ndarray, Masks]:
    """Frames (T+1, H, W, 3) uint8 and masks, each with its print, or without one (None) where it is hidden."""
    rng, frames, masks = np.random.default_rng(3), [], []
    behind = noise(rng, (HEIGHT, WIDTH), (70, 75, 80), (110, 115, 120), 2.0)
    for one, motion in zip(prints, [*MOTIONS, MOTIONS[-1]]):
        frame, mask = behind.astype(np.float32), np.zeros((HEIGHT, WIDTH), bool)
        if one is not None:
            mask = cv2.warpAffine(np.ones((SIDE, SIDE), np.float32), motion, (WIDTH, HEIGHT)) > 0.5
            frame = np.where(mask[..., None], cv2.warpAffine(one, motion, (WIDTH, HEIGHT)), frame)
        frames.append(np.clip(frame + rng.normal(0.0, 1.0, frame.shape), 0, 255).astype(np.uint8))
        masks.append(mask)
    return np.stack(frames), Masks.of(masks)


def through(motion: np.ndarray, xy: np.ndarray) -> np.ndarray:
    return xy @ motion[:, :2].T + motion[:, 2]


def test_what_was_hidden_is_found_where_it_comes_out_again():
    own = print_of(0)
    found = recognise(*filmed([own, None, own]), NoProgress())
    assert set(found.frame) == {2} and len(found.frame) > 40
    inverse = cv2.invertAffineTransform(MOTIONS[0])
    off = np.linalg.norm(through(MOTIONS[2], through(inverse, found.first)) - found.xy, axis=1)
    assert np.median(off) < 0.7 and off.max() < 4.0


def test_another_print_in_the_same_place_is_not_taken_for_it():
    found = recognise(*filmed([print_of(0), print_of(1), print_of(0)]), NoProgress())
    assert (found.frame == 1).sum() <= 0.05 * (found.frame == 2).sum()


def test_nothing_is_found_on_a_plain_body():
    plain = np.full((SIDE, SIDE, 3), 128.0, np.float32)
    assert len(recognise(*filmed([plain, plain, plain]), NoProgress()).frame) == 0


def test_it_is_looked_for_only_where_tracks_get_lost():
    visible = np.ones((5, 20), bool)
    visible[3, :4] = False
    assert not are_lost(visible)
    visible[3, :6] = False
    assert are_lost(visible)
    assert not are_lost(np.zeros((5, 0), bool))


def test_only_what_may_be_a_sheet_is_recognised_in_a_clip(tmp_path):
    folded = filmed([print_of(0)] * 2)[0][:1].repeat(6, axis=0)
    folded[3:5, 50:170, 100:180] = 128  # a fold hides two thirds of the print
    for number, frame in enumerate(folded):
        cv2.imwrite(str(tmp_path / f"{number:04d}.png"), frame[..., ::-1])
    asked = ObserveSettings(fps=25.0, box=(55.0, 45.0, 185.0, 175.0), distance=1.0)
    assert observe(tmp_path, asked, NoProgress()).recognised is None
    again = observe(tmp_path, dataclasses.replace(asked, recognise=True), NoProgress()).recognised
    assert again is not None and (again.frame == 5).sum() > 40


@pytest.mark.parametrize(
    ("words", "sought"),
    [
        ([], False),
        (["--material", "cotton"], True),
        (["--material", "cotton", "--form", "solid"], False),
        (["--material", "leaf", "--form", "sheet"], True),
        (["--material", "cotton", "--law", "von_mises", "--yield-stress", "1e4"], False),
        (["--material-endpoint", "http://localhost:1", "--material-model", "any"], True),
    ],
)
def test_which_body_is_recognised(words, sought):
    asked = parser().parse_args(["recover", "clip.mp4", "--take", "a.take", "--box", "0", "0", "9", "9", *words])
    assert observe_settings(asked).recognise == sought


def test_it_can_be_cancelled():
    class Stopped(Progress):
        def check(self) -> None:
            raise Cancelled()

    own = print_of(0)
    with pytest.raises(Cancelled):
        recognise(*filmed([own, own, own]), Stopped())


def test_points_of_steadied_frames_in_the_filmed_ones():
    camera = Camera(WIDTH, HEIGHT, 300.0, 300.0, 159.5, 119.5, np.eye(4))
    turns = np.stack([np.eye(3), cv2.Rodrigues(np.array([0.01, -0.02, 0.005]))[0]])
    filmed_at = np.array([[20.0, 30.0], [200.0, 150.0]])
    steady = np.c_[filmed_at, np.ones(2)] @ homography(turns[1], camera).T
    steady = steady[:, :2] / steady[:, 2:]
    seen = Recognised(np.array([1, 1], np.int32), filmed_at, steady)
    back = as_filmed(np.zeros((2, 0, 2)), Masks.of(np.zeros((2, HEIGHT, WIDTH), bool)), seen, turns, camera)[2]
    assert back is not None
    np.testing.assert_allclose(back.xy, filmed_at, atol=1e-9)
    np.testing.assert_allclose(back.first, filmed_at, atol=1e-9)


def test_kept_as_arrays():
    seen = Recognised(np.array([1, 2], np.int32), np.ones((2, 2)), np.zeros((2, 2)))
    again = from_arrays(Recognised, to_arrays(seen))
    assert all(np.array_equal(getattr(again, name), getattr(seen, name)) for name in ("frame", "first", "xy"))
