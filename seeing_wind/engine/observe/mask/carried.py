"""A set of pixels that is carried from one frame to the next, such as the outline that a network finds in every few frames."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np

from .cutting import closed
from .motion import Flow, Window, placed, shifted, window_of

EVERY, SELDOM, ASKED = 3, 12, 15
"""Least and greatest number of frames from one that a network outlines to the next, and about how often it is asked in a clip at most: a
frame takes it 1.5 CPU seconds."""

STEADY = 0.9
"""Overlap of a network's outline with the one before, carried by the flow, from which that number of frames doubles."""

ALIKE = 0.96
"""Overlap from which a network's outline confirms the one found without it, which is then kept as it is: the little by which the two differ
is the network's error as often as not, and it changes from frame to frame."""


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

    def place(self, corner: np.ndarray) -> None:
        """Move the whole set so that its bounding box begins at `corner` (2,) [px]."""
        self.shift(corner - self.window[:2] - self._rest)

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


class Segmenter(Protocol):
    """A network that outlines the object in single frames."""

    def outline(
        self, frame: np.ndarray, expected: np.ndarray, box: tuple[float, float, float, float] | None = None
    ) -> np.ndarray | None:
        """The object (H, W) bool in `frame` (H, W, 3) uint8 RGB; None where the network does not help, because the object is too small for
        it or because it outlines something else.

        Args:
            expected: (H, W) bool, about where the object is.
            box: the user's box (x0, y0, x1, y1) [px]; it counts more than `expected`, which may be far off then.
        """


class Segmented:
    """The object as a network outlines it in every few frames, and as the flow carries that outline in between.

    Attributes:
        fresh: whether the outline is of the newest frame.
    """

    def __init__(self, network: Segmenter, mask: np.ndarray, frames: int) -> None:
        """`mask` (H, W) bool is frame 0's; `frames`: the clip's length."""
        self._network, self._part = network, Carried("segmented", mask)
        self._least = max(EVERY, -(-frames // ASKED))
        self._interval = self._left = self._longer = self._least
        self.fresh = False

    def advance(self, frame: np.ndarray, flow: Flow | None, motion: np.ndarray, expected: np.ndarray, where: Window) -> None:
        """Go on to the next `frame` (H, W, 3) uint8 RGB.

        Args:
            flow, motion: that to this frame, dense if it is known, and (2,) [px] of the whole object.
            expected: (h, w) bool in the window `where`, the silhouette carried from the frame before.
        """
        if flow is None:
            self._part.shift(motion)
        else:
            self._part.flow(flow)
        self._left -= 1
        self.fresh = self._left == 0
        if not self.fresh:
            return
        height, width = frame.shape[:2]
        whole = (0, 0, width, height)
        found, before = self._network.outline(frame, placed(expected, where, whole)), self._part.over(whole)
        self._part.set(np.zeros((1, 1), bool) if found is None else found)
        self._longer = min(2 * self._interval, max(SELDOM, self._least))
        self._next(self._longer if found is not None and alike(before, found, STEADY) else self._least)

    def confirms(self, unaided: np.ndarray, where: Window) -> bool:
        """Whether the network has found in this frame about what was found without it, `unaided` (h, w) bool in the window `where`.

        If so, it has no outline until it is asked again, and that is after twice as many frames as the last time.
        """
        if not self.fresh:
            return False
        outline = self.over(where)
        if outline is None or not alike(unaided, outline):
            return False
        self._next(self._longer)
        self._part.set(np.zeros((1, 1), bool))
        self.fresh = False
        return True

    def _next(self, frames: int) -> None:
        """Ask the network again after so many `frames`."""
        self._interval = self._left = frames

    def over(self, where: Window) -> np.ndarray | None:
        """The outline's pixels (h, w) bool in the window `where`; None without an outline."""
        return self._part.over(where) if self._part.any() else None

    def state(self) -> dict[str, np.ndarray]:
        """All that later frames depend on."""
        return self._part.state() | {"segmented_next": np.array([self._interval, self._left])}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Continue from what `state()` returned."""
        self._part.resume(state)
        self._interval, self._left = (int(value) for value in state["segmented_next"])


def alike(one: np.ndarray, other: np.ndarray, least: float = ALIKE) -> bool:
    """Whether two outlines (h, w) bool, at least one of which has pixels, overlap by `least` or more."""
    return bool(np.count_nonzero(one & other) >= least * np.count_nonzero(one | other))
