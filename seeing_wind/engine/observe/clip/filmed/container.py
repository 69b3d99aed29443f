"""The metadata of an MP4 or QuickTime file (ISO/IEC 14496-12; Android's and QuickTime's metadata keys)."""

from __future__ import annotations

import struct
from pathlib import Path

from ....records import Doubt

LARGEST_INDEX = 64_000_000
"""Size of a file's index beyond which it is not read [bytes]; an hour of video has some megabytes."""

CAPTURED = b"com.android.capture.fps"
"""Key under which Android's camera stores the rate at which it filmed, if the file plays more slowly."""

VALUE = b"data" + struct.pack(">II", 23, 0)
"""The bytes before the value of such a key, a big-endian single without language."""

CURVES = {16: "PQ", 18: "HLG"}
"""Transfer characteristics of high dynamic range (ITU-T H.273)."""

SLOWER = 0.05
"""Relative difference between two rates up to which it is rounding."""


def container_doubts(path: str | Path, fps: float, told: bool) -> list[Doubt]:
    """Doubts from the index of the MP4 `path`, which plays at `fps`; none for other files. `told`: the rate was given by the user."""
    index = _index(Path(path))
    return [one for one in (None if told else _slow_motion(index, fps), _high_range(index)) if one is not None]


def _index(path: Path) -> bytes:
    """The box `moov` of an MP4; empty if there is none, or it is too large."""
    with open(path, "rb") as file:
        while len(head := file.read(16)) >= 8:
            size, kind = struct.unpack(">I4s", head[:8])
            header = 8
            if size == 1 and len(head) == 16:
                size, header = struct.unpack(">Q", head[8:])[0], 16
            if kind == b"moov":
                file.seek(header - len(head), 1)
                return file.read(size - header) if header <= size <= LARGEST_INDEX else b""
            if size < header:
                return b""
            file.seek(size - len(head), 1)
    return b""


def _slow_motion(index: bytes, fps: float) -> Doubt | None:
    place = index.find(VALUE) + len(VALUE) if CAPTURED in index and VALUE in index else 0
    if not place or len(index) < place + 4:
        return None
    captured = struct.unpack(">f", index[place : place + 4])[0]
    if not captured > (1.0 + SLOWER) * fps:
        return None
    return Doubt(
        1.5,
        f"The phone filmed {captured:.4g} frames a second, but the file plays {fps:.4g}: it is slow motion, and forces are "
        f"{(captured / fps) ** 2:.3g} times too small.",
        f"Give --fps {captured:.4g}.",
    )


def _high_range(index: bytes) -> Doubt | None:
    place = index.find(b"colrnclx")
    curve = CURVES.get(struct.unpack(">H", index[place + 10 : place + 12])[0]) if place >= 0 and len(index) >= place + 12 else None
    if curve is None:
        return None
    return Doubt(
        0.3,
        f"The clip has a high dynamic range ({curve}), but its colours are read as standard range: they are pale, with little contrast.",
        "If the outline is wrong, convert the clip to standard range.",
    )
