"""The object's masks in a whole clip, packed: a 4K mask is 8 MB in memory, and some kilobytes here."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import overload

import numpy as np

from .errors import WrongTake

WHOLE = 0.9
"""Fraction of an object's largest area from which it counts as seen whole."""

NEAR = 30
"""Frames beside those in which an object is hidden in which it is looked for as a whole."""

DAMAGED = WrongTake("The take's masks are damaged.", "Run `recover` again.")


@dataclass(frozen=True)
class Masks:
    """Masks (T+1, H, W) of one object, read like an array of bool: `masks[t]` is a new array (H, W), which the caller may change.

    Raises:
        WrongTake: fields that contradict each other (a damaged take).
    """

    height: int
    width: int
    windows: np.ndarray
    """(T+1, 4) int32: x0 y0 x1 y1 of the mask's bounding box [px], ends exclusive; zeros for an empty mask."""
    ends: np.ndarray
    """(T+1,) int64: where each mask ends in `packed`."""
    packed: np.ndarray
    """(B,) uint8: the windows' bits, row by row, each mask compressed by zlib."""

    @staticmethod
    def of(masks: Iterable[np.ndarray]) -> Masks:
        """Pack masks (H, W) bool, all of the same size, one after another.

        Raises:
            ValueError: no masks, or masks of different sizes.
        """
        packing = Packing()
        for mask in masks:
            packing.add(mask)
        return packing.masks()

    def __post_init__(self) -> None:
        windows, ends = self.windows, self.ends
        if windows.ndim != 2 or windows.shape[1] != 4 or ends.shape != windows.shape[:1] or self.packed.dtype != np.uint8:
            raise DAMAGED
        inside = (windows[:, :2] >= 0) & (windows[:, :2] <= windows[:, 2:]) & (windows[:, 2:] <= [self.width, self.height])
        if not inside.all() or (np.diff(ends, prepend=0) < 0).any() or (len(ends) and ends[-1] != self.packed.size):
            raise DAMAGED

    @property
    def shape(self) -> tuple[int, int, int]:
        """(T+1, H, W)."""
        return (len(self.windows), self.height, self.width)

    def __len__(self) -> int:
        return len(self.windows)

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self[t] for t in range(len(self)))

    @overload
    def __getitem__(self, index: int) -> np.ndarray: ...
    @overload
    def __getitem__(self, index: slice) -> Masks: ...
    def __getitem__(self, index: int | slice) -> np.ndarray | Masks:
        if isinstance(index, slice):
            return Masks.of(self[t] for t in range(*index.indices(len(self))))
        t = range(len(self))[index]
        x0, y0, x1, y1 = (int(value) for value in self.windows[t])
        mask = np.zeros((self.height, self.width), bool)
        count = (y1 - y0) * (x1 - x0)
        content = self.packed[self.ends[t - 1] if t else 0 : self.ends[t]].tobytes()
        try:
            # No more than the window needs, whatever a damaged take contains.
            bits = zlib.decompressobj().decompress(content, count // 8 + 2)
        except zlib.error as error:
            raise DAMAGED from error
        if len(bits) != (count + 7) // 8:
            raise DAMAGED
        mask[y0:y1, x0:x1] = np.unpackbits(np.frombuffer(bits, np.uint8), count=count).reshape(y1 - y0, x1 - x0) > 0
        return mask

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> np.ndarray:
        """All masks in memory (T+1, H, W) bool, for short clips."""
        whole = np.stack(list(self))
        return whole if dtype is None else whole.astype(dtype)


class Packing:
    """Packs masks of one size one by one, appended to those of `begun` if given."""

    def __init__(self, begun: Masks | None = None) -> None:
        self._shape: tuple[int, ...] = () if begun is None else begun.shape[1:]
        self._windows: list[np.ndarray] = [] if begun is None else list(begun.windows)
        self._ends: list[int] = [] if begun is None else begun.ends.tolist()
        self._parts: list[bytes] = [] if begun is None else [begun.packed.tobytes()]

    def add(self, mask: np.ndarray) -> None:
        """Pack the next `mask` (H, W) bool.

        Raises:
            ValueError: a mask of another size than those before.
        """
        if self._shape and mask.shape != self._shape:
            raise ValueError(f"masks of {self._shape} and {mask.shape}")
        self._shape = mask.shape
        window = box_of(mask)
        bits = np.packbits(mask[rows_columns(window)])
        self._parts.append(zlib.compress(bits.tobytes(), 1))
        self._windows.append(np.array(window, np.int32))
        self._ends.append(len(self._parts[-1]) + (self._ends[-1] if self._ends else 0))

    def masks(self) -> Masks:
        """All masks packed so far.

        Raises:
            ValueError: there are none.
        """
        if len(self._shape) != 2:
            raise ValueError("no masks")
        packed = np.frombuffer(b"".join(self._parts), np.uint8)
        return Masks(self._shape[0], self._shape[1], np.array(self._windows, np.int32), np.array(self._ends, np.int64), packed)


def box_of(mask: np.ndarray, margin: int = 0) -> tuple[int, int, int, int]:
    """Bounding box x0, y0, x1, y1 [px], ends exclusive, of a mask (H, W) bool, widened by `margin` within the frame; 0 if it is empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return 0, 0, 0, 0
    (height, width), low, high = mask.shape, (columns[0] - margin, rows[0] - margin), (columns[-1] + 1 + margin, rows[-1] + 1 + margin)
    return max(int(low[0]), 0), max(int(low[1]), 0), min(int(high[0]), width), min(int(high[1]), height)


def rows_columns(box: tuple[int, int, int, int]) -> tuple[slice, slice]:
    """The index of a box x0, y0, x1, y1 in a frame."""
    return slice(box[1], box[3]), slice(box[0], box[2])


def pixels_of(mask: np.ndarray) -> np.ndarray:
    """(P, 2) float64 x, y [px] of the pixels in a mask (H, W) bool, in the order of `image[mask]`."""
    rows, columns = np.nonzero(mask)
    return np.stack([columns, rows], axis=1).astype(float)


def at_pixels(mask: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Values (...,) of a mask (H, W) bool at the pixels nearest to xy (..., 2); False outside the frame and where xy is not finite."""
    column, row = np.moveaxis(np.round(np.where(np.isfinite(xy), xy, -1.0)).astype(int), -1, 0)
    height, width = mask.shape
    within = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    return within & mask[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]


def at_rim(mask: np.ndarray) -> bool:
    """Whether a mask (H, W) bool reaches the frame's edge."""
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())


def areas(masks: Iterable[np.ndarray]) -> np.ndarray:
    """Number of pixels (T+1,) int64 in each mask."""
    return np.array([int(np.count_nonzero(mask)) for mask in masks], np.int64)


def partly_hidden(sizes: np.ndarray) -> np.ndarray:
    """Frames (T+1,) bool in which a part of an object is probably hidden, from the number of pixels (T+1,) that are seen of it.

    They are next to frames in which all of it is hidden, and much less of it is seen in them than at most in the second before or after, at
    30 frames per second.
    """
    hidden, partly = sizes == 0, np.zeros(len(sizes), bool)
    for way in (slice(None), slice(None, None, -1)):
        seen, found, gone = sizes[way], partly[way], np.flatnonzero(hidden[way])
        for first in gone[np.diff(gone, prepend=-1) > 1]:
            before = seen[max(first - NEAR, 0) : first]
            before = before[int(np.flatnonzero(before == 0)[-1]) + 1 if (before == 0).any() else 0 :]
            whole = np.flatnonzero(before >= WHOLE * before.max())
            found[first - len(before) + whole[-1] + 1 : first] = True
    return partly
