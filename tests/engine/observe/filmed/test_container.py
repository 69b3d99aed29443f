"""What a file's metadata state: bit depth, dynamic range, slow motion, high rates."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from seeing_wind.engine.observe.clip.filmed.container import container_doubts
from seeing_wind.engine.observe.clip.frames import read_clip


def filmed(path: Path, fps: float = 30.0) -> bytearray:
    """An MP4 of ten frames."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, (64, 48))
    for t in range(10):
        writer.write(np.full((48, 64, 3), 40 + 5 * t, np.uint8))
    writer.release()
    return bytearray(path.read_bytes())


def with_box(data: bytearray, box: bytes) -> bytes:
    """The MP4 with `box` as the last one of its index, which stands behind the frames."""
    place = data.find(b"moov") - 4
    size = struct.unpack(">I", data[place : place + 4])[0]
    data[place : place + 4] = struct.pack(">I", size + len(box))
    return bytes(data[: place + size] + box + data[place + size :])


def box(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind) + content


def captured(rate: float) -> bytes:
    """The metadata that Android's camera writes for slow motion."""
    key = b"com.android.capture.fps"
    keys = box(b"keys", struct.pack(">III4s", 0, 1, 8 + len(key), b"mdta") + key)
    value = box(struct.pack(">I", 1), box(b"data", struct.pack(">IIf", 23, 0, rate)))
    return box(b"meta", box(b"hdlr", bytes(8) + b"mdta" + bytes(13)) + keys + box(b"ilst", value))


def doubts(path: Path, **options: float) -> list[str]:
    return [str(one) for one in read_clip(path, **options).doubts]


def test_slow_motion_is_told_with_the_rate_it_was_filmed_at(tmp_path: Path) -> None:
    (tmp_path / "slow.mp4").write_bytes(with_box(filmed(tmp_path / "a.mp4"), captured(240.0)))
    (told,) = doubts(tmp_path / "slow.mp4")
    assert "240 frames a second" in told and "64 times" in told and "--fps 240" in told
    assert doubts(tmp_path / "slow.mp4", fps=240.0) == []
    (tmp_path / "usual.mp4").write_bytes(with_box(filmed(tmp_path / "a.mp4"), captured(30.0)))
    assert doubts(tmp_path / "usual.mp4") == []


def test_a_rate_of_240_is_read(tmp_path: Path) -> None:
    filmed(tmp_path / "fast.mp4", 240.0)
    clip = read_clip(tmp_path / "fast.mp4")
    assert clip.fps == pytest.approx(240.0) and clip.doubts == ()


@pytest.mark.parametrize(("transfer", "name"), [(16, "PQ"), (18, "HLG"), (1, "")])
def test_a_high_dynamic_range_is_named(tmp_path: Path, transfer: int, name: str) -> None:
    color = box(b"colr", b"nclx" + struct.pack(">HHHB", 9, transfer, 9, 0))
    (tmp_path / "hdr.mp4").write_bytes(with_box(filmed(tmp_path / "a.mp4"), color))
    told = [str(one) for one in container_doubts(tmp_path / "hdr.mp4", 30.0, told=False)]
    assert [name in one and "high dynamic range" in one for one in told] == [True] * bool(name)
    if name == "PQ":  # to read such a clip takes OpenCV seconds
        assert doubts(tmp_path / "hdr.mp4") == told


@pytest.mark.parametrize("content", [b"", b"\0\0\0\1moov", b"\0\0\0\3moov", b"\xff\xff\xff\xffmoov" + bytes(20)])
def test_an_index_that_is_damaged_says_nothing(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "cut.mp4").write_bytes(content)
    assert container_doubts(tmp_path / "cut.mp4", 30.0, told=False) == []


def test_sixteen_bits_are_read_as_eight(tmp_path: Path) -> None:
    deep = np.full((48, 64), 200 * 257, np.uint16)
    deep[:, :20] = 40 * 257
    form = [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U, cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    writer = cv2.VideoWriter(str(tmp_path / "deep.mkv"), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (64, 48), form)
    assert writer.isOpened()
    for t in range(3):
        writer.write(deep)
        assert cv2.imwrite(str(tmp_path / f"deep_{t}.png"), np.dstack([deep] * 3))
    writer.release()
    for clip in (read_clip(tmp_path / "deep.mkv"), read_clip(tmp_path / "deep_%d.png", fps=25.0)):
        assert clip.frames[2].dtype == np.uint8
        assert np.abs(clip.frames[2][:, [5, 50]].astype(int) - [[[40], [200]]]).max() <= 2
