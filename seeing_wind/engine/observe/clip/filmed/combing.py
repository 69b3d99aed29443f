"""Interlaced video: the odd rows of a frame were filmed after the even ones, so whatever moves has a comb for a rim."""

from __future__ import annotations

import cv2
import numpy as np

from ....records import Doubt

EVERY, MOST = 6, 8
"""Frames from one that is looked at to the next, as what moves does so for longer, and how many with motion in them are enough."""

CHANGED = 12.0
"""Grey levels by which a pixel differs from the frame before for it to move."""

TOOTH = 10.0
"""Grey levels by which a row differs from both of its neighbours, in the same direction, in a comb."""

LEAST, TIMES = 0.1, 4.0
"""Part of what moves that is comb along the rows, and how many times that along the columns, where no camera makes one: a texture and
grain have as much of both."""

FEWEST = 200
"""Moving pixels below which nothing can be said."""


class Combing:
    """Looks at some of the frames as they are decoded, at the file's own size, which a smaller copy does not keep."""

    def __init__(self) -> None:
        self._count = 0
        self._before: np.ndarray | None = None
        self._found: list[bool] = []

    def add(self, frame: np.ndarray) -> None:
        """The next frame (H, W, 3) uint8 RGB."""
        turn = self._count % EVERY
        self._count += 1
        if turn > 1 or len(self._found) == MOST:
            return
        gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
        if turn == 0:
            self._before = gray
        elif self._before is not None:
            moves = cv2.absdiff(gray, self._before) > CHANGED
            if np.count_nonzero(moves) >= FEWEST:
                x, y, width, height = cv2.boundingRect(moves.astype(np.uint8))
                part = np.s_[max(y - 1, 0) : y + height + 1, max(x - 1, 0) : x + width + 1]
                gray, moves = gray[part], moves[part]
                rows, columns = _comb(gray, moves), _comb(np.ascontiguousarray(gray.T), np.ascontiguousarray(moves.T))
                self._found.append(rows > max(LEAST, TIMES * columns))

    def doubt(self) -> Doubt | None:
        """Said where most frames with motion in them are combed."""
        if not self._found or np.mean(self._found) <= 0.5:
            return None
        return Doubt(
            1.1,
            "The clip is interlaced: every second row was filmed a moment later, so the rim of what moves is a comb.",
            "Deinterlace it, for example with FFmpeg's filter bwdif.",
        )


def _comb(gray: np.ndarray, moves: np.ndarray) -> float:
    """Part of the pixels that `moves` (H, W) bool whose row differs from the rows above and below, which are alike."""
    above, below = gray[1:-1] - gray[:-2], gray[1:-1] - gray[2:]
    tooth = (above * below > 0.0) & (np.minimum(np.abs(above), np.abs(below)) > TOOTH) & (np.abs(above - below) < TOOTH)
    return float((tooth & moves[1:-1]).sum() / max(int(moves[1:-1].sum()), 1))
