"""Reading clips: videos, folders, patterns, ranges, and what is refused."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import Scene, write_video

from seeing_wind.engine.errors import ClipError, UsageError
from seeing_wind.engine.observe.clip import read_clip


def test_video_in_rgb_with_its_own_rate(disc: Scene) -> None:
    clip = read_clip(disc.path)
    assert clip.frames.shape == disc.frames.shape and clip.frames.dtype == np.uint8
    assert clip.fps == pytest.approx(30.0) and clip.first_frame == 0
    # RGB: the disc is orange, so red stands above blue.
    inside = clip.frames[0][disc.masks[0]].mean(axis=0)
    assert inside[0] > inside[2] + 30
    assert np.abs(clip.frames.astype(int) - disc.frames).mean() < 4


def test_range_is_inclusive_and_rate_can_be_given(disc: Scene) -> None:
    clip = read_clip(disc.path, (3, 6), 120.0)
    assert len(clip.frames) == 4 and clip.first_frame == 3 and clip.fps == 120.0
    assert np.array_equal(clip.frames[0], read_clip(disc.path).frames[3])


@pytest.mark.parametrize("pattern", ["", "shot_%03d.png", "shot_*.png"])
def test_pictures(disc: Scene, tmp_path: Path, pattern: str) -> None:
    for index in (8, 9, 10):
        cv2.imwrite(str(tmp_path / f"shot_{index:03d}.png"), cv2.cvtColor(disc.frames[index], cv2.COLOR_RGB2BGR))
    clip = read_clip(tmp_path / pattern if pattern else tmp_path, fps=25.0)
    assert np.array_equal(clip.frames, disc.frames[8:11])


def test_pictures_are_sorted_by_number(disc: Scene, tmp_path: Path) -> None:
    for place, index in (("2", 0), ("10", 1)):
        cv2.imwrite(str(tmp_path / f"p{place}.png"), cv2.cvtColor(disc.frames[index], cv2.COLOR_RGB2BGR))
    assert np.array_equal(read_clip(tmp_path, fps=25.0).frames, disc.frames[:2])


def test_pictures_without_rate_are_refused(disc: Scene, tmp_path: Path) -> None:
    for index in range(2):
        cv2.imwrite(str(tmp_path / f"{index}.png"), disc.frames[index])
    with pytest.raises(UsageError, match="frame rate") as caught:
        read_clip(tmp_path)
    assert "--fps" in caught.value.hint


@pytest.mark.parametrize("frames", [(5, 2), (-1, 4), (4, 4), (5, 40), (40, 50)])
def test_ranges_refused(disc: Scene, frames: tuple[int, int]) -> None:
    with pytest.raises(ClipError) as caught:
        read_clip(disc.path, frames)
    assert caught.value.hint


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(ClipError, match="no clip"):
        read_clip(tmp_path / "none.mp4")


def test_not_a_video(tmp_path: Path) -> None:
    (tmp_path / "notes.mp4").write_text("this is no film")
    with pytest.raises(ClipError, match="not a video"):
        read_clip(tmp_path / "notes.mp4")


def test_one_picture(disc: Scene, tmp_path: Path) -> None:
    write_video(tmp_path / "one.avi", [disc.frames[0]], 25.0)
    with pytest.raises(ClipError, match="one picture"):
        read_clip(tmp_path / "one.avi")


def test_empty_folder_and_mixed_sizes(disc: Scene, tmp_path: Path) -> None:
    with pytest.raises(ClipError, match="No pictures"):
        read_clip(tmp_path, fps=25.0)
    cv2.imwrite(str(tmp_path / "0.png"), disc.frames[0])
    cv2.imwrite(str(tmp_path / "1.png"), disc.frames[0][:50])
    with pytest.raises(ClipError, match="same size|first one"):
        read_clip(tmp_path, fps=25.0)


@pytest.mark.parametrize("fps", [0.0, -5.0, float("nan")])
def test_rate_must_be_positive(disc: Scene, fps: float) -> None:
    with pytest.raises(UsageError):
        read_clip(disc.path, fps=fps)
