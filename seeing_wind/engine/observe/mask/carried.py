"""A part of the frame that is carried along from one frame to the next."""

from __future__ import annotations

import cv2
import numpy as np

from .motion import Flow, Window, placed, window_of


class Carried:
    """The pixels of a part of the frame, in the box round it."""

    def __init__(self, name: str) -> None:
        """`name`: of its arrays."""
        self._name = name
        self.set(np.zeros((0, 0), bool), (0, 0, 0, 0))

    def set(self, part: np.ndarray, window: Window) -> None:
        """It is `part` (h, w) bool of a window from now on."""
        self._part, self.window = part, window
        if part.any():
            x0, y0, x1, y1 = window_of(part, 0)
            self._part, self.window = part[y0:y1, x0:x1].copy(), (x0 + window[0], y0 + window[1], x1 + window[0], y1 + window[1])

    def any(self) -> bool:
        """Whether anything is left of it."""
        return bool(self._part.any())

    def over(self, where: Window) -> np.ndarray:
        """(h, w) bool in a window."""
        return placed(self._part, self.window, where)

    def flow(self, flow: Flow, sought: Window) -> None:
        """Each pixel by the `flow` to the next frame, in the window `sought` alone."""
        if not self.any():
            return
        inside = self.over(sought)
        rows, columns = np.nonzero(inside)
        to = np.stack([columns, rows], axis=1) + np.rint(flow.over(sought)[rows, columns]).astype(np.int64)
        to = to[((to >= 0) & (to < inside.shape[::-1])).all(axis=1)]
        part = np.zeros(inside.shape, np.uint8)
        part[tuple(to.T[::-1])] = 1
        # Pixels drift apart where it grows.
        self.set(cv2.morphologyEx(part, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0, sought)

    def state(self) -> dict[str, np.ndarray]:
        """All that the frames to come depend on."""
        return {self._name: self._part, f"{self._name}_window": np.array(self.window)}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Go on from what `state` gave."""
        x0, y0, x1, y1 = (int(value) for value in state[f"{self._name}_window"])
        self._part, self.window = state[self._name], (x0, y0, x1, y1)
