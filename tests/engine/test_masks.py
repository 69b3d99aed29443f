"""Packed masks: the same as they were, small, and refused when damaged."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from seeing_wind.engine.errors import TakeError
from seeing_wind.engine.masks import Masks, areas, at_pixels, partly_hidden
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.take import Take


def some() -> np.ndarray:
    """A blob that moves, vanishes, fills the frame, and is a single pixel in the corner."""
    masks = np.zeros((5, 37, 53), bool)
    masks[0, 5:20, 7:31] = np.random.default_rng(0).random((15, 24)) > 0.4
    masks[1, 9:24, 20:44] = masks[0, 5:20, 7:31]
    masks[3] = True
    masks[4, 36, 52] = True
    return masks


def test_masks_come_back_as_they_were(tmp_path) -> None:
    masks = some()
    packed = Masks.of(masks)
    assert packed.shape == masks.shape and len(packed) == 5
    assert np.array_equal(packed, masks) and np.array_equal(packed[-1], masks[-1]) and np.array_equal(packed[1:3], masks[1:3])
    assert np.array_equal(areas(packed), masks.sum(axis=(1, 2)))
    take = Take(tmp_path)
    take.write_arrays("masks.npz", to_arrays(packed))
    assert np.array_equal(from_arrays(Masks, take.read_arrays("masks.npz")), masks)


def test_a_large_mask_is_small() -> None:
    rows, columns = np.mgrid[:2160, :3840]
    disc = (rows - 1000) ** 2 + (columns - 2000) ** 2 < 600**2
    assert len(Masks.of([disc]).packed) < 10_000


@pytest.mark.parametrize(
    "change",
    [
        {"windows": np.array([[0, 0, 54, 37]], np.int32)},
        {"windows": np.array([[9, 0, 3, 37]], np.int32)},
        {"ends": np.array([10_000_000])},
        {"ends": np.array([1, 2])},
        {"packed": np.zeros(3, np.int64)},
    ],
)
def test_parts_that_contradict_each_other_are_refused(change: dict) -> None:
    packed = Masks.of(some()[:1])
    with pytest.raises(TakeError, match="damaged"):
        dataclasses.replace(packed, **change)


@pytest.mark.parametrize("content", [b"no zlib at all", b""])
def test_content_that_is_none_is_refused(content: bytes) -> None:
    packed = Masks.of(some()[:1])
    other = np.frombuffer(content, np.uint8)
    broken = dataclasses.replace(packed, packed=other, ends=np.array([len(other)]))
    with pytest.raises(TakeError, match="damaged"):
        broken[0]
    with pytest.raises(ValueError, match="no masks"):
        Masks.of([])


def test_a_mask_is_looked_up_at_the_nearest_pixel_and_holds_nothing_beyond_the_frame():
    mask = np.zeros((4, 6), bool)
    mask[1, 5] = True
    xy = np.array([[[5.4, 0.6], [4.4, 1.0]], [[5.6, 1.0], [-1.0, 1.0]], [[np.nan, 1.0], [np.inf, 1.0]]])
    np.testing.assert_array_equal(at_pixels(mask, xy), [[True, False], [False, False], [False, False]])


@pytest.mark.parametrize(
    ("sizes", "partly"),
    [
        ([100, 100, 95, 60, 20, 0, 0, 15, 50, 92, 100], [3, 4, 7, 8]),
        ([100, 70, 40, 40, 70, 100], []),  # it turns and is seen again
        ([10, 0, 0], []),
        ([0, 0, 30, 100, 100], [2]),
        ([100, 30, 0, 25, 30, 10, 0, 100], [1, 3, 5]),  # between two times that it is hidden, nothing more is known
    ],
)
def test_what_is_seen_next_to_frames_in_which_it_is_hidden_is_a_part(sizes: list[int], partly: list[int]) -> None:
    assert np.flatnonzero(partly_hidden(np.array(sizes))).tolist() == partly
