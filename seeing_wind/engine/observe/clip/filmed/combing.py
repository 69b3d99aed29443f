"""Interlaced video: the odd rows of a frame were filmed after the even ones, so the rims of moving things look like combs."""

from __future__ import annotations

import cv2
import numpy as np

from ....records import Doubt

EVERY, MOST = 6, 8
"""One frame in EVERY is examined, as motion lasts longer than that; MOST frames with motion in them are enough."""

CHANGED = 12.0
"""Difference from the frame before from which a pixel counts as moving [grey levels]."""

TOOTH = 10.0
"""Difference between a row and both of its neighbours, of the same sign, from which there is a comb [grey levels]."""

LEAST, TIMES = 0.1, 4.0
"""Least fraction of the moving pixels that are comb along the rows, and its least ratio to the fraction along the columns, which no camera
combs: a texture and grain have as much of both."""

FEWEST = 200
"""Least number of moving pixels in a frame to judge it."""


class Combing:
    """Examines some of the frames as they are decoded, at the file's own size: a smaller copy would not keep the comb."""

    def __init__(self) -> None:
        self._count = 0
        self._before: np.ndarray | None = None
        self._found: list[bool] = []

    def add(self, frame: np.ndarray) -> None:
        """Add the next frame (H, W, 3) uint8 RGB."""
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
        """The doubt to report if most frames with motion in them are combed; else None."""
        if not self._found or np.mean(self._found) <= 0.5:
            return None
        return Doubt(
            1.1,
            "The clip is interlaced: every second row was filmed a moment later, so the rims of moving things look like combs.",
            "Deinterlace it, for example with FFmpeg's filter bwdif.",
        )


def _comb(gray: np.ndarray, moves: np.ndarray) -> float:
    """Fraction of the moving pixels, `moves` (H, W) bool, at which the row differs from the rows above and below while these are alike."""
    above, below = gray[1:-1] - gray[:-2], gray[1:-1] - gray[2:]
    tooth = (above * below > 0.0) & (np.minimum(np.abs(above), np.abs(below)) > TOOTH) & (np.abs(above - below) < TOOTH)
    return float((tooth & moves[1:-1]).sum() / max(int(moves[1:-1].sum()), 1))
