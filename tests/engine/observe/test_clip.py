"""Reading clips: videos, folders, patterns, ranges, and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import Scene, write_video

from seeing_wind.engine.errors import ClipError, TakeError, UsageError
from seeing_wind.engine.observe.clip.frames import read_clip
from seeing_wind.engine.observe.clip.video import video_writer
from seeing_wind.engine.progress import Progress


def test_video_in_rgb_with_its_own_rate(disc: Scene) -> None:
    clip = read_clip(disc.path)
    assert clip.frames.shape == disc.frames.shape and clip.frames.dtype == np.uint8
    assert clip.fps == pytest.approx(30.0) and clip.first_frame == 0
    # RGB: the disc is orange, so red stands above blue.
    inside = clip.frames[0][disc.masks[0]].mean(axis=0)
    assert inside[0] > inside[2] + 30
    assert np.abs(np.asarray(clip.frames).astype(int) - disc.frames).mean() < 4


def test_range_is_inclusive_and_rate_can_be_given(disc: Scene) -> None:
    clip = read_clip(disc.path, (3, 6), 120.0)
    assert len(clip.frames) == 4 and clip.first_frame == 3 and clip.fps == 120.0
    assert np.array_equal(clip.frames[0], read_clip(disc.path).frames[3])


@pytest.mark.parametrize("pattern", ["", "shot_%03d.png", "shot_*.png"])
def test_sequences_of_images(disc: Scene, tmp_path: Path, pattern: str) -> None:
    for index in (8, 9, 10):
        cv2.imwrite(str(tmp_path / f"shot_{index:03d}.png"), cv2.cvtColor(disc.frames[index], cv2.COLOR_RGB2BGR))
    clip = read_clip(tmp_path / pattern if pattern else tmp_path, fps=25.0)
    assert np.array_equal(clip.frames, disc.frames[8:11])


def test_frames_are_sorted_by_number(disc: Scene, tmp_path: Path) -> None:
    for place, index in (("2", 0), ("10", 1)):
        cv2.imwrite(str(tmp_path / f"p{place}.png"), cv2.cvtColor(disc.frames[index], cv2.COLOR_RGB2BGR))
    assert np.array_equal(read_clip(tmp_path, fps=25.0).frames, disc.frames[:2])


def test_a_frame_that_is_missing_is_told(disc: Scene, tmp_path: Path) -> None:
    told: list[dict] = []
    for index in (2, 4, 6, 10):  # every second one of a clip, but the eighth
        cv2.imwrite(str(tmp_path / f"s_{index:04d}.png"), disc.frames[index])
    read_clip(tmp_path, (0, 2), 30.0, Progress(told.append))
    assert not told
    read_clip(tmp_path, None, 30.0, Progress(told.append))
    assert "between s_0006.png and s_0010.png" in told[0]["message"]


def test_a_file_may_have_a_pattern_for_a_name(disc: Scene, tmp_path: Path) -> None:
    place = tmp_path / f"leaf %d{Path(disc.path).suffix}"
    place.write_bytes(Path(disc.path).read_bytes())
    assert len(read_clip(place).frames) == len(disc.frames)


def test_frames_without_rate_are_refused(disc: Scene, tmp_path: Path) -> None:
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


def test_a_list_of_files_is_no_video(disc: Scene, tmp_path: Path) -> None:
    """FFmpeg would play it; what it names could change, or lie anywhere."""
    (tmp_path / "list.ffconcat").write_text(f"ffconcat version 1.0\nfile {Path(disc.path).name}\n")
    with pytest.raises(ClipError, match="a list of files"):
        read_clip(tmp_path / "list.ffconcat")


def test_one_frame(disc: Scene, tmp_path: Path) -> None:
    write_video(tmp_path / "one.avi", [disc.frames[0]], 25.0)
    with pytest.raises(ClipError, match="one frame"):
        read_clip(tmp_path / "one.avi")


def test_empty_folder_and_mixed_sizes(disc: Scene, tmp_path: Path) -> None:
    with pytest.raises(ClipError, match="No images"):
        read_clip(tmp_path, fps=25.0)
    cv2.imwrite(str(tmp_path / "0.png"), disc.frames[0])
    cv2.imwrite(str(tmp_path / "1.png"), disc.frames[0][:50])
    with pytest.raises(ClipError, match="same size|first one"):
        read_clip(tmp_path, fps=25.0)


@pytest.mark.parametrize("fps", [0.0, -5.0, float("nan")])
def test_rate_must_be_positive(disc: Scene, fps: float) -> None:
    with pytest.raises(UsageError):
        read_clip(disc.path, fps=fps)


def mp4(path: Path) -> bytearray:
    """An MP4 of ten frames at 25 per second, whose upper left corner is bright."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (64, 48))
    for t in range(10):
        frame = np.full((48, 64, 3), 40 + 5 * t, np.uint8)
        frame[:12, :12] = 250
        writer.write(frame)
    writer.release()
    return bytearray(path.read_bytes())


@pytest.mark.parametrize(
    ("matrix", "size", "corner"),
    [
        ((0, 1, -1, 0), (64, 48), (0, -1)),  # 90 degrees clockwise
        ((-1, 0, 0, -1), (48, 64), (-1, -1)),
        ((0, -1, 1, 0), (64, 48), (-1, 0)),
        ((1, 0, 0, 1), (48, 64), (0, 0)),
    ],
)
def test_a_phones_rotation_is_undone(tmp_path: Path, matrix: tuple, size: tuple, corner: tuple) -> None:
    data = mp4(tmp_path / "a.mp4")
    place = data.find(b"tkhd") + 44  # the track header's matrix: a b u c d v x y w, 16.16 fixed point (w 2.30)
    a, b, c, d = (value << 16 for value in matrix)
    data[place : place + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    (tmp_path / "turned.mp4").write_bytes(data)
    frames = read_clip(tmp_path / "turned.mp4").frames
    assert frames.shape[1:3] == size
    corners = {(row, column): frames[0][row * 5 if row else 4, column * 5 if column else 4].mean() for row in (0, -1) for column in (0, -1)}
    assert max(corners, key=lambda key: corners[key]) == corner


def wider(data: bytearray, place: int, extra: int, start: int = 0, end: int | None = None) -> None:
    """Add `extra` to the size of every MP4 box that holds byte `place`."""
    end = len(data) if end is None else end
    while start + 8 <= end:
        size, kind = struct.unpack(">I4s", data[start : start + 8])
        if start < place < start + size:
            data[start : start + 4] = struct.pack(">I", size + extra)
            if kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
                wider(data, place, extra, start + 8, start + size)
            return
        start += size


def test_a_variable_frame_rate_is_told_and_its_mean_taken(tmp_path: Path) -> None:
    data = mp4(tmp_path / "a.mp4")
    place = data.find(b"stts") - 4
    count, delta = struct.unpack(">II", data[place + 16 : place + 24])
    wider(data, place + 8, 8)
    data[place + 12 : place + 24] = struct.pack(">5I", 2, 5, delta, count - 5, 2 * delta)  # from the fifth frame on half the rate
    (tmp_path / "uneven.mp4").write_bytes(data)
    clip = read_clip(tmp_path / "uneven.mp4")
    steps = len(clip.frames) - 1
    assert clip.fps == pytest.approx(steps / (5 * 0.04 + (steps - 5) * 0.08), rel=1e-3)
    (told,) = clip.doubts
    assert "40 to 80 ms" in told.because
    # An even part of it has the rate of that part, and what the user says goes before.
    even, given = read_clip(tmp_path / "uneven.mp4", (0, 4)), read_clip(tmp_path / "uneven.mp4", fps=30.0)
    assert even.fps == pytest.approx(25.0) and given.fps == 30.0
    assert not even.doubts and not given.doubts


def test_a_video_that_nobody_can_read_is_no_video(tmp_path):
    with pytest.raises(TakeError, match="wrote cannot be read"), video_writer(tmp_path / "empty.mp4", 25.0, (64, 48)):
        pass  # as one whose frames a full disk has swallowed
