"""What else moves beside the object, comes up to it or holds it, carried along too, so that it is another thing where the two touch."""

from __future__ import annotations

from typing import ClassVar

import cv2
import numpy as np

from ..cutting import enclosed, grown
from ..evidence import Colors
from ..motion import Flow, Window, cut, joined, placed, window_of

THICK = 5
"""Pixels across from which something counts: less is a rim that was carried on too far."""

OTHERWISE = 1.0
"""Pixels per frame by which a thing beside the object has to move otherwise: less is what dense flow is off by."""

LARGE = 0.3
"""Thickness of another thing beside the object, in units of the root of the object's area: less is the object's own, missed rim."""

SAMPLES = 20_000
"""Pixels of what comes up to the object whose colours are kept."""


class _Carried:
    """A part of the frame that is carried from one frame to the next: the pixels `_part` of the box `_window`."""

    name: ClassVar[str]
    """Of its arrays."""

    def __init__(self) -> None:
        self._part, self._window = np.zeros((0, 0), bool), (0, 0, 0, 0)

    def over(self, where: Window) -> np.ndarray:
        """(h, w) bool in a window."""
        return placed(self._part, self._window, where)

    def any(self) -> bool:
        """Whether anything is left of it."""
        return bool(self._part.any())

    def state(self) -> dict[str, np.ndarray]:
        """All that the frames to come depend on."""
        return {self.name: self._part, f"{self.name}_window": np.array(self._window)}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Go on from what `state` gave."""
        x0, y0, x1, y1 = (int(value) for value in state[f"{self.name}_window"])
        self._part, self._window = state[self.name], (x0, y0, x1, y1)


class Beside(_Carried):
    """Another thing that moves beside the object: what differs from the background there and moves otherwise. It is not taken in where the
    two touch."""

    name = "beside"

    def move(self, flow: Flow | None, motion: np.ndarray) -> None:
        """Each pixel by the `flow` to the next frame; what moves by `motion` (2,) [px], as the object does, is dropped."""
        if flow is None or not self._part.any():
            self._part = np.zeros((0, 0), bool)
            return
        moved = flow.over(self._window)
        rows, columns = np.nonzero(self._part & (np.linalg.norm(moved - motion.astype(np.float32), axis=2) > OTHERWISE))
        if not len(rows):
            self._part = np.zeros((0, 0), bool)
            return
        to = np.stack([columns, rows], axis=1) + np.rint(moved[rows, columns]).astype(np.int64)
        low, high = to.min(axis=0) - 2, to.max(axis=0) + 3
        part = np.zeros((high - low)[::-1], np.uint8)
        part[tuple((to - low).T[::-1])] = 1
        # Pixels drift apart where it grows.
        self._part = cv2.morphologyEx(part, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0
        x0, y0 = self._window[:2]
        self._window = (x0 + int(low[0]), y0 + int(low[1]), x0 + int(high[0]), y0 + int(high[1]))

    @property
    def window(self) -> Window:
        """The box round it."""
        return self._window

    def colors(self, frame: np.ndarray) -> np.ndarray:
        """Its colours (N, 3) in `frame` (H, W, 3)."""
        return cut(frame, self._window)[self._part]

    def keep(self, differs: np.ndarray, found: np.ndarray, where: Window) -> None:
        """After a frame: what `differs` from the background and what is `found` to be the object, (h, w) bool in the window `where`."""
        rest = (differs & ~found).astype(np.uint8)
        thick = max(THICK, int(LARGE * np.sqrt(found.sum()))) | 1  # OpenCV moves what it opens by an even number
        if rest.sum() < thick * thick:
            self._part = np.zeros((0, 0), bool)
            return
        core = cv2.morphologyEx(rest, cv2.MORPH_OPEN, np.ones((thick, thick), np.uint8))
        count, labels = cv2.connectedComponents(rest, connectivity=4)
        other = np.bincount(labels[core > 0], minlength=count) > 0
        self._part, self._window = other[labels], where


class Along(_Carried):
    """Another thing that moves along with the object, as a hand that holds it does: known in frame 0, then carried by the flow, whatever is
    behind it."""

    name = "along"

    def __init__(self, mask: np.ndarray | None) -> None:
        """`mask` (H, W) bool: the other thing in frame 0, if there is one."""
        super().__init__()
        if mask is not None and mask.any():
            self._window = window_of(mask, 0)
            self._part = cut(mask, self._window).copy()

    def move(self, flow: Flow | None, sought: Window) -> None:
        """Each pixel by the `flow` to the next frame, in the window `sought` alone; where the object is hidden, without one, it stays."""
        if flow is None or not self._part.any():
            return
        inside = placed(self._part, self._window, sought)
        rows, columns = np.nonzero(inside)
        to = np.stack([columns, rows], axis=1) + np.rint(flow.over(sought)[rows, columns]).astype(np.int64)
        size = np.array(inside.shape[::-1])
        to = to[((to >= 0) & (to < size)).all(axis=1)]
        part = np.zeros(inside.shape, np.uint8)
        part[tuple(to.T[::-1])] = 1
        # Pixels drift apart where it grows.
        self._part, self._window = cv2.morphologyEx(part, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0, sought

    def join(self, beside: Beside) -> None:
        """What was `beside` the object belongs to it, too."""
        both = joined(self._window, beside.window) if self.any() else beside.window
        self._part, self._window = self.over(both) | beside.over(both), both

    def keep(self, more: np.ndarray, background: np.ndarray, found: np.ndarray, where: Window) -> None:
        """After a frame, (h, w) bool in the window `where`: what may be `more` of it beside it, where the `background` is seen, and what is
        `found` to be the object."""
        both = joined(self._window, where)
        part, (more, background, found) = self.over(both), (placed(one, where, both) for one in (more, background, found))
        self._part, self._window = (part & ~background | grown(part) & more & ~enclosed(found)) & ~found, both


class Arrives:
    """Another thing that comes up to the object while that rests, as the hand does that will push it. Later it moves along, so it is known
    by having come, and by its colours."""

    def __init__(self, inside: np.ndarray, outside: np.ndarray) -> None:
        """`inside` (N, 3) and `outside` (M, 3) uint8: colours of the object and of its surroundings in frame 0."""
        self._inside, self._outside, self._seen, self._way = inside, outside, np.zeros((0, 3), np.uint8), np.zeros(2)

    def meet(self, frame: np.ndarray, motion: np.ndarray, beside: Beside, along: Along) -> Colors | None:
        """After a step of the object by `motion` (2,) [px]: what is `beside` it is `along` from now on; the colours, if more is known."""
        self._way = self._way + motion
        if np.linalg.norm(self._way) >= OTHERWISE or not beside.any():
            return None
        along.join(beside)
        self._seen = np.concatenate([self._seen, beside.colors(frame)])[-SAMPLES:]
        return self._colors()

    def _colors(self) -> Colors | None:
        """Half of the surroundings' colours are those of what came."""
        step = max(1, len(self._outside) // max(1, len(self._seen)))
        return Colors(self._inside, np.concatenate([self._seen, self._outside[::step]])) if len(self._seen) else None

    def state(self) -> dict[str, np.ndarray]:
        """All that the frames to come depend on."""
        return {"arrives_way": self._way, "arrives_seen": self._seen}

    def resume(self, state: dict[str, np.ndarray]) -> Colors | None:
        """Go on from what `state` gave; the colours, if more is known."""
        self._way, self._seen = state["arrives_way"], state["arrives_seen"]
        return self._colors()
