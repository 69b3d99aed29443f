"""What something still in front of the object hides of it, carried along with what is seen, so that it is known again on the other side.

Such a thing, a post or a branch, is a part of the background. Where it hides the object, the frame looks as the background does, and
the carried silhouette ends. What comes out behind it lies farther away than a silhouette can be off, and would grow back slowly.
"""

from __future__ import annotations

import cv2
import numpy as np

from .motion import Window, cut, paste, window_of

THICK = 5
"""Pixels across from which something hides a part: less is a rim that was carried on too far."""


class Veil:
    """The hidden part of the object."""

    def __init__(self) -> None:
        self._part, self._window = np.zeros((0, 0), bool), (0, 0, 0, 0)
        self._rest = np.zeros(2)

    @property
    def window(self) -> Window | None:
        """The box round it, None where nothing is hidden."""
        return self._window if self._part.any() else None

    def move(self, motion: np.ndarray) -> None:
        """Along with the object, by `motion` (2,) [px]."""
        whole = np.round(motion + self._rest)
        self._rest = motion + self._rest - whole
        x0, y0, x1, y1 = self._window
        dx, dy = int(whole[0]), int(whole[1])
        self._window = (x0 + dx, y0 + dy, x1 + dx, y1 + dy)

    def over(self, where: Window) -> np.ndarray:
        """(h, w) bool in a window."""
        part = np.zeros((where[3] - where[1], where[2] - where[0]), bool)
        if self._part.any():
            x0, y0, x1, y1 = self._window
            paste(part, self._part, (x0 - where[0], y0 - where[1], x1 - where[0], y1 - where[1]))
        return part

    def keep(self, hidden: np.ndarray, where: Window) -> None:
        """From now on `hidden` (h, w) bool in the window `where` is hidden."""
        if not hidden.any():
            self._part, self._window = np.zeros((0, 0), bool), (0, 0, 0, 0)
            return
        x0, y0, x1, y1 = window_of(hidden, 0)
        self._part = cut(hidden, (x0, y0, x1, y1)).copy()
        self._window = (x0 + where[0], y0 + where[1], x1 + where[0], y1 + where[1])

    def state(self) -> dict[str, np.ndarray]:
        """All that the frames to come depend on."""
        return {"veil": self._part, "veil_window": np.array(self._window), "veil_rest": self._rest}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Go on from what `state` gave."""
        x0, y0, x1, y1 = (int(value) for value in state["veil_window"])
        self._part, self._window, self._rest = state["veil"], (x0, y0, x1, y1), state["veil_rest"]


def thick(part: np.ndarray) -> np.ndarray:
    """`part` (h, w) bool where it is `THICK` pixels across."""
    return cv2.morphologyEx(part.astype(np.uint8), cv2.MORPH_OPEN, np.ones((THICK, THICK), np.uint8)) > 0
