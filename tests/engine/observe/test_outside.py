"""Tracks that are given and leave the object's outline: given up, unless the outline is what is wrong."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import Scene

from seeing_wind.engine.masks import Masks
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.preview.verdicts import judge
from seeing_wind.engine.observe.tracks.outside import LONG, Outside, long, outside
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import ObserveSettings

AWAY = 2
"""The last frame in which wrong tracks follow the object."""


def given(disc: Scene, wrong: int, count: int = 12, slide: float = 12.0) -> tuple[np.ndarray, np.ndarray]:
    """Tracks (T+1, count, 2) [px] on the disc, of which the first `wrong` slide off it by `slide` px a frame, and their visibility."""
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    start = disc.centers[0] + 20.0 * np.stack([np.cos(around), np.sin(around)], axis=1)
    xy = np.stack([disc.moved(start, t) for t in range(len(disc.frames))])
    late = np.maximum(np.arange(len(xy)) - AWAY, 0)
    xy[:, :wrong] -= (late[:, None] * [slide, 0.0])[:, None]
    return xy, np.ones(xy.shape[:2], bool)


def seen_with(
    disc: Scene, folder: Path, xy: np.ndarray, visible: np.ndarray, told: list[dict]
) -> tuple[Observation, ObserveSettings]:
    """The observation with these tracks, its messages added to `told`, and its settings."""
    np.savez(folder / "points.npz", xy=xy, visible=visible)
    x0, y0, x1, y1 = disc.box
    settings = ObserveSettings(box=(x0 - 3.0, y0 - 3.0, x1 + 3.0, y1 + 3.0), distance=1.0, tracks=str(folder / "points.npz"))
    return observe(disc.path, settings, Progress(told.append)), settings


def test_many_given_tracks_that_leave_the_outline_are_given_up_and_told(disc: Scene, tmp_path: Path) -> None:
    told: list[dict] = []
    xy, visible = given(disc, 5)
    seen, settings = seen_with(disc, tmp_path, xy, visible, told)
    assert seen.visible[:, 5:].all(), "those on the object are kept to the end"
    ends = seen.visible[:, :5].sum(axis=0)
    assert (ends > AWAY).all() and (ends <= AWAY + 7).all() and not seen.visible[-1, :5].any()
    assert all(seen.visible[:end, k].all() for k, end in enumerate(ends)), "each from the frame on in which it is outside"
    worst = judge(seen, settings, None)[0]
    assert worst.severity == pytest.approx(0.5 + 5 / 12)
    assert worst.because.startswith(f"5 of 12 tracks of points.npz leave the outline, the first in frame {ends.min()}, and are left out")
    assert any("5 of 12 tracks" in one["message"] for one in told if one["type"] == "warning")


def test_a_few_are_given_up_with_a_warning(disc: Scene, tmp_path: Path) -> None:
    told: list[dict] = []
    xy, visible = given(disc, 1)
    seen, _ = seen_with(disc, tmp_path, xy, visible, told)
    assert not seen.visible[-1, 0] and seen.visible[:, 1:].all()
    assert not any("points.npz" in one.because for one in seen.doubts)
    assert any("1 of 12 tracks of points.npz leave" in one["message"] for one in told if one["type"] == "warning")


def compared(disc: Scene, xy: np.ndarray, corners: np.ndarray, masks: np.ndarray | None = None) -> Outside:
    """Tracks (T+1, K, 2) that are always visible, compared with the disc's true outline or with these masks (T+1, H, W)."""
    sigma = np.full(xy.shape[:2], 0.3)
    return outside(xy, np.ones(xy.shape[:2], bool), sigma, Masks.of(disc.masks if masks is None else masks), corners)


FOLLOWED, LOST, PLAIN = np.ones((13, 20), bool), np.arange(13)[:, None] < np.full(20, 3), np.zeros((13, 0), bool)


def test_tracks_are_not_given_up_where_the_outline_may_be_wrong(disc: Scene) -> None:
    xy, _ = given(disc, 5)
    assert (compared(disc, xy, FOLLOWED).left[:5] < 13).all()
    unsure = compared(disc, xy, LOST)
    assert (unsure.left == 13).all() and (unsure.disputed[:5] < 13).all() and (unsure.disputed[5:] == 13).all()
    doubt = unsure.doubt("points.npz", 13)
    assert doubt is not None and "the outline may be wrong as well" in doubt.because


def test_most_tracks_together_outweigh_an_outline_of_a_plain_object(disc: Scene) -> None:
    few, most = (compared(disc, given(disc, wrong)[0], PLAIN) for wrong in (5, 8))
    assert (few.left[:5] < 13).all() and (few.left[5:] == 13).all()
    assert (most.left == 13).all() and (most.disputed[:8] < 13).all()
    assert compared(disc, given(disc, 8)[0], FOLLOWED).left[:8].max() < 13, "unless its corners stay within the outline"


def test_tracks_on_a_part_that_the_outline_misses_are_kept(disc: Scene) -> None:
    xy, _ = given(disc, 0, 40)
    masks = disc.masks.copy()
    for t in range(4, 13):  # a third of the disc is missing from then on
        masks[t, :, int(disc.centers[t, 0]) + 8 :] = False
    lost = compared(disc, xy, FOLLOWED, masks)
    assert (lost.left == 13).all(), "they move with the others"


def test_a_few_frames_outside_are_not_enough(disc: Scene) -> None:
    xy, _ = given(disc, 0)
    xy[4 : 4 + LONG - 1, 0] -= [90.0, 0.0]
    assert (compared(disc, xy, FOLLOWED).left == 13).all()
    xy[4 + LONG - 1, 0] -= [90.0, 0.0]
    assert compared(disc, xy, FOLLOWED).left.tolist() == [4, *[13] * 11]


def test_in_a_short_clip_a_third_of_its_frames_is_enough(disc: Scene) -> None:
    assert [long(count) for count in (2, 6, 8, 9, 10, 13, 200)] == [2, 2, 3, 3, 4, 5, LONG]
    wrong, right = given(disc, 12, slide=20.0)[0][:8], given(disc, 0)[0][:8]
    assert (compared(disc, wrong, FOLLOWED[:8], disc.masks[:8]).left < 8).all()
    assert (compared(disc, right, FOLLOWED[:8], disc.masks[:8]).left == 8).all()
    right[3:5, 0] -= [90.0, 0.0]
    assert (compared(disc, right, FOLLOWED[:8], disc.masks[:8]).left == 8).all(), "two frames may be the outline's"


def test_a_track_is_outside_by_more_than_its_own_uncertainty(disc: Scene) -> None:
    xy, _ = given(disc, 1)
    unsure = np.full(xy.shape[:2], 60.0)
    found = outside(xy, np.ones(xy.shape[:2], bool), unsure, Masks.of(disc.masks), FOLLOWED)
    assert (found.left == 13).all()


def test_a_large_clip_names_the_users_file(disc: Scene, tmp_path: Path) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "large.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (1760, 1280))
    for frame in disc.frames:
        writer.write(np.ascontiguousarray(cv2.resize(frame, (1760, 1280), interpolation=cv2.INTER_CUBIC)[..., ::-1]))
    writer.release()
    xy, visible = given(disc, 5)
    np.savez(tmp_path / "points.npz", xy=8.0 * (xy + 0.5) - 0.5, visible=visible)
    box = tuple(8.0 * value for value in disc.box)
    seen = observe(tmp_path / "large.avi", ObserveSettings(box=box, distance=1.0, tracks=str(tmp_path / "points.npz")), NoProgress())
    assert not seen.visible[-1, :5].any() and seen.visible[:, 5:].all()
    assert seen.doubts is not None and "tracks of points.npz" in seen.doubts.because[0]
