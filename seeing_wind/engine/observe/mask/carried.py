"""A set of pixels that is carried from one frame to the next."""

from __future__ import annotations

import cv2
import numpy as np

from .cutting import closed
from .motion import Flow, Window, placed, shifted, window_of


class Carried:
    """A set of pixels of the newest frame.

    Attributes:
        part: (h, w) bool, the pixels of `window` that belong to the set; window: the set's bounding box [px].
    """

    def __init__(self, name: str, part: np.ndarray | None = None) -> None:
        """`name`: the key of its stored arrays; `part`: (H, W) bool of the whole frame, None for an empty set."""
        self._name, self._rest = name, np.zeros(2)
        self.set(np.zeros((1, 1), bool) if part is None else part)

    def set(self, part: np.ndarray, window: Window = (0, 0, 0, 0)) -> None:
        """Replace the set by `part` (h, w) bool, whose top left corner is that of `window`."""
        x0, y0, x1, y1 = own = window_of(part, 0) if part.any() else (0, 0, 0, 0)
        self.part, self.window = part[y0:y1, x0:x1].copy(), shifted(own, *window[:2])

    def any(self) -> bool:
        """Whether the set has any pixels."""
        return bool(self.part.any())

    def over(self, where: Window) -> np.ndarray:
        """The set's pixels (h, w) bool in the window `where`."""
        return placed(self.part, self.window, where)

    def shift(self, motion: np.ndarray) -> None:
        """Shift the whole set by `motion` (2,) [px], rounded to whole pixels; the remainder is added to the next shift."""
        whole = np.round(motion + self._rest)
        self._rest = motion + self._rest - whole
        self.window = shifted(self.window, int(whole[0]), int(whole[1]))

    def flow(self, flow: Flow) -> None:
        """Move each pixel by the `flow` to the next frame."""
        if not self.any():
            return
        at = cv2.findNonZero(self.part.astype(np.uint8))[:, 0]
        # x and y apart, as NumPy is many times slower over pairs.
        to_x, to_y = np.ascontiguousarray((at + np.rint(flow.of(self.part, self.window)).astype(np.int64)).T)
        (left, right), (top, bottom) = ((int(one.min()) - 4, int(one.max()) + 5) for one in (to_x, to_y))  # as far as closing looks
        part = np.zeros((bottom - top, right - left), bool)
        part[to_y - top, to_x - left] = True
        # Where the set is stretched, its pixels drift apart.
        x0, y0 = self.window[0] + left, self.window[1] + top
        self.set(closed(part, 5), (x0, y0, x0, y0))

    def state(self) -> dict[str, np.ndarray]:
        """All that later frames depend on."""
        return {self._name: self.part, f"{self._name}_window": np.array(self.window), f"{self._name}_rest": self._rest}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Continue from what `state()` returned."""
        x0, y0, x1, y1 = (int(value) for value in state[f"{self._name}_window"])
        self.part, self.window, self._rest = state[self._name], (x0, y0, x1, y1), state[f"{self._name}_rest"]
