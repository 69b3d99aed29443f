"""Decoded frames on disk: a long clip takes up room in the folder for temporary files, not in memory."""

from __future__ import annotations

import errno
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterator
from typing import overload

import numpy as np

from ...errors import SeeingWindError
from ...progress import Progress


class StoredFrames:
    """Frames of one size in a temporary file that vanishes with this object, or with the process.

    Reads like an array (T+1, H, W, 3) uint8 RGB: `frames[t]` is a frame, `frames[t, top:bottom]` some of its rows. Each read is a copy
    that the caller owns; nothing is kept in memory. Several threads may read.
    """

    dtype = np.dtype(np.uint8)

    def __init__(self, height: int, width: int) -> None:
        self._frame = (height, width, 3)
        self._count = 0
        self._file = tempfile.TemporaryFile(prefix="seeing_wind_", buffering=0)
        self._lock = threading.Lock()
        weakref.finalize(self, self._file.close)

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(T+1, H, W, 3)."""
        return (self._count, *self._frame)

    def append(self, frame: np.ndarray) -> None:
        """Add a `frame` (H, W, 3) uint8 RGB at the end.

        Raises:
            SeeingWindError: the disk of the temporary folder is full, or a file may not be so large.
        """
        rest = np.ascontiguousarray(frame, dtype=np.uint8).reshape(-1).data
        try:
            self._file.seek(self._count * len(rest))
            while len(rest):
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            after = f" after the first {self._count}" if self._count else ""
            limited = error.errno == errno.EFBIG
            why = "no file may be so large here" if limited else error.strerror or str(error)
            more = "Raise that limit (`ulimit -f`)" if limited else "Free some space there"
            raise SeeingWindError(
                f"{tempfile.gettempdir()} has no room for the clip's frames{after}: {why}.",
                f"{more}, set TMPDIR to a folder on a larger disk, or choose a shorter range with --frames.",
            ) from error
        self._count += 1

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self[t] for t in range(self._count))

    @overload
    def __getitem__(self, index: int) -> np.ndarray: ...
    @overload
    def __getitem__(self, index: tuple[int, slice]) -> np.ndarray: ...
    def __getitem__(self, index: int | tuple[int, slice]) -> np.ndarray:
        t, rows = index if isinstance(index, tuple) else (index, slice(None))
        first, last, step = rows.indices(self._frame[0])
        if step != 1:
            raise IndexError("rows are read without gaps")
        t = int(t)
        if not -self._count <= t < self._count:
            raise IndexError(f"frame {t} of {self._count}")
        height, width, _ = self._frame
        part = np.empty((max(0, last - first), width, 3), np.uint8)
        rest = part.reshape(-1).data
        with self._lock:
            self._file.seek(((t % self._count) * height + first) * width * 3)
            while len(rest):
                read = self._file.readinto(rest)
                if not read:
                    short = "The clip's decoded frames were cut short on disk."
                    raise SeeingWindError(short, "Was the temporary folder emptied? Run it again.")
                rest = rest[read:]
        return part

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> np.ndarray:
        """All frames in memory, for short clips."""
        whole = np.stack(list(self)) if self._count else np.empty(self.shape, np.uint8)
        return whole if dtype is None else whole.astype(dtype)


Frames = np.ndarray | StoredFrames
"""The frames of a clip, (T+1, H, W, 3) uint8 RGB, in memory or on disk."""


def each(frames: Frames, function: Callable[[int, np.ndarray], np.ndarray], progress: Progress) -> StoredFrames:
    """`function(t, frame)` for every frame, again stored on disk; it must keep the frame's size.

    Raises:
        SeeingWindError: see `StoredFrames.append`. Cancelled: between frames.
    """
    out = StoredFrames(*frames.shape[1:3])
    for t in range(len(frames)):
        progress.check()
        out.append(function(t, frames[t]))
    return out


def some_of(count: int, most: int) -> np.ndarray:
    """At most `most` of the numbers from 0 to `count` - 1, ascending: the first, the last, and others spread evenly between them."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(int))
