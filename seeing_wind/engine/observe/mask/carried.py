"""A part of the frame that is carried along from one frame to the next."""

from __future__ import annotations

import cv2
import numpy as np

from .cutting import closed
from .motion import Flow, Window, placed, shifted, window_of


class Carried:
    """Some pixels.

    Attributes:
        part: (h, w) bool, those of them in the window; window: the smallest that holds them.
    """

    def __init__(self, name: str, part: np.ndarray | None = None) -> None:
        """`name`: of its arrays; `part` (H, W) bool, of the whole frame, if there is one."""
        self._name, self._rest = name, np.zeros(2)
        self.set(np.zeros((1, 1), bool) if part is None else part)

    def set(self, part: np.ndarray, window: Window = (0, 0, 0, 0)) -> None:
        """It is `part` (h, w) bool of a window from now on."""
        x0, y0, x1, y1 = own = window_of(part, 0) if part.any() else (0, 0, 0, 0)
        self.part, self.window = part[y0:y1, x0:x1].copy(), shifted(own, *window[:2])

    def any(self) -> bool:
        """Whether anything is left of it."""
        return bool(self.part.any())

    def over(self, where: Window) -> np.ndarray:
        """(h, w) bool in a window."""
        return placed(self.part, self.window, where)

    def shift(self, motion: np.ndarray) -> None:
        """As a whole, by `motion` (2,) [px]; what whole pixels leave of it is kept for the next time."""
        whole = np.round(motion + self._rest)
        self._rest = motion + self._rest - whole
        self.window = shifted(self.window, int(whole[0]), int(whole[1]))

    def flow(self, flow: Flow) -> None:
        """Each pixel by the `flow` to the next frame."""
        if not self.any():
            return
        at = cv2.findNonZero(self.part.astype(np.uint8))[:, 0]
        # Apart, as NumPy is many times slower over pairs.
        to_x, to_y = np.ascontiguousarray((at + np.rint(flow.of(self.part, self.window)).astype(np.int64)).T)
        (left, right), (top, bottom) = ((int(one.min()) - 4, int(one.max()) + 5) for one in (to_x, to_y))  # as far as closing looks
        part = np.zeros((bottom - top, right - left), bool)
        part[to_y - top, to_x - left] = True
        # Pixels drift apart where it grows.
        x0, y0 = self.window[0] + left, self.window[1] + top
        self.set(closed(part, 5), (x0, y0, x0, y0))

    def state(self) -> dict[str, np.ndarray]:
        """All that the frames to come depend on."""
        return {self._name: self.part, f"{self._name}_window": np.array(self.window), f"{self._name}_rest": self._rest}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Go on from what `state` gave."""
        x0, y0, x1, y1 = (int(value) for value in state[f"{self._name}_window"])
        self.part, self.window, self._rest = state[self._name], (x0, y0, x1, y1), state[f"{self._name}_rest"]
