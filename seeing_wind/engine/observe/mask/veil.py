"""What something still in front of the object hides of it, carried along with what is seen, so that it is known again on the other side.

Such a thing, a post or a branch, is a part of the background. Where it hides the object, the frame looks as the background does, and
the carried silhouette ends. What comes out behind it lies farther away than a silhouette can be off, and would grow back slowly.

Where the object has been seen, nothing stands before it: background that is seen there again was let go of, not hidden.
"""

from __future__ import annotations

import cv2
import numpy as np

from .carried import Carried
from .motion import Window, cut, joined, paste, placed

THICK = 5
"""Pixels across of what comes out again: less is a rim that was carried on too far."""


class Veil(Carried):
    """The hidden part of the object."""

    def __init__(self, mask: np.ndarray) -> None:
        """`mask` (H, W) bool: the object in frame 0."""
        super().__init__("veil")
        self._clear, self._rest = mask.copy(), np.zeros(2)

    def move(self, motion: np.ndarray) -> None:
        """Along with the object, by `motion` (2,) [px]."""
        whole = np.round(motion + self._rest)
        self._rest = motion + self._rest - whole
        x0, y0, x1, y1 = self.window
        dx, dy = int(whole[0]), int(whole[1])
        self.window = (x0 + dx, y0 + dy, x1 + dx, y1 + dy)

    def keep(self, whole: np.ndarray, found: np.ndarray, background: np.ndarray, where: Window) -> None:
        """After a frame: what was to be expected, what was found and where it looks like the background, (h, w) bool in the window `where`.

        `whole` is the silhouette before, moved without its hidden part.
        """
        inside = np.zeros_like(self._clear)
        paste(inside, cv2.erode(found.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0, where)
        self._clear |= inside
        both = joined(where, self.window if self.any() else None)
        whole, found, background = (placed(one, where, both) for one in (whole, found, background))
        clear = cut(self._clear, both, cv2.BORDER_CONSTANT)
        self.set((self.over(both) | whole & background) & ~found & ~(background & clear), both)

    def state(self) -> dict[str, np.ndarray]:
        """See `Carried.state`."""
        return super().state() | {"veil_rest": self._rest, "veil_clear": np.packbits(self._clear)}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """See `Carried.resume`."""
        super().resume(state)
        self._rest = state["veil_rest"]
        self._clear = np.unpackbits(state["veil_clear"], count=self._clear.size).reshape(self._clear.shape) > 0
