"""Where an object was seen last, and where it may be seen again once something hides it."""

from __future__ import annotations

import numpy as np

from ....masks import WHOLE
from ..cutting import opened
from ..motion import Window, body_shift, cut, window_of, within

FADES = 0.97
"""What the largest area counts for from one frame to the next: what moves away gets smaller without being hidden."""

ASTRAY, TURNS, LONGEST = (0.5, 0.05), 0.3, 15
"""How far a hidden object may be from where it would be if it moved on as when it was last seen whole: in sizes of the object, at once and
more for each frame since, and in units of the distance that it would have moved; and the frames after which that grows no more."""

SPECK = 0.02
"""Fraction of the object's area below which what may be a part of it is too little to tell."""

THICK = 5
"""Least thickness [px] of a part that reappears, unless the object itself is thinner: thinner parts are rims that were carried too far."""

SAME = 16.0
"""Median difference of colour [grey levels] up to which pixels are those of the object as it was last seen whole."""


class LastSeen:
    """The last sight of an object, and the last in which all of it was seen.

    Attributes:
        pace: (2,) [px per frame], its motion when it was last seen whole.
        thick: least thickness [px] of a part of it.
    """

    def __init__(self, frame: np.ndarray, mask: np.ndarray) -> None:
        """`frame` (H, W, 3) uint8 RGB and `mask` (H, W) bool are frame 0's."""
        self.pace, self._since, self._area = np.zeros(2), 0, 0.0
        self._window = self._last = window_of(mask, 0)
        self.seen(frame, cut(mask, self._window), self._window, None)

    def seen(self, frame: np.ndarray, part: np.ndarray, window: Window, motion: np.ndarray | None) -> None:
        """After a frame in which `part` (h, w) bool of the `window` was found; it moved by `motion` (2,) [px], None if that is unknown."""
        area = float(np.count_nonzero(part))
        x0, y0, x1, y1 = window_of(part, 0)
        self._last = (window[0] + x0, window[1] + y0, window[0] + x1, window[1] + y1)
        if motion is not None and not self.pace.any():
            self.pace = motion
        self._area = max(area, FADES * self._area)
        if area < WHOLE * self._area:
            self._since += 1
            return
        self._since, self._window, self._part = 0, self._last, part[y0:y1, x0:x1].copy()
        self._template = cut(frame, self._window).copy()
        self.thick = next(one for one in (THICK, 3, 1) if 4 * one**2 <= area and np.count_nonzero(opened(self._part, one)) >= 0.5 * area)
        if motion is not None:
            self.pace = motion

    def missed(self) -> None:
        """After a frame in which nothing of it was found."""
        self._since += 1

    @property
    def expected(self) -> Window:
        """Its bounding box in the next frame, if it moves on as when it was last seen whole."""
        dx, dy = (int(value) for value in np.round((self._since + 1) * self.pace))
        x0, y0, x1, y1 = self._window
        return x0 + dx, y0 + dy, x1 + dx, y1 + dy

    def sought(self, frame: np.ndarray) -> list[Window]:
        """Where in the next `frame` (H, W, 3) it may come out again: round its expected place, or where it was seen last."""
        size, gone = float(np.sqrt(self._area)), min(self._since + 1, LONGEST)
        near = (ASTRAY[0] + ASTRAY[1] * gone) * size
        reaches = (self.expected, near + TURNS * gone * float(np.linalg.norm(self.pace))), (self._last, near)
        grown = [(x0 - int(r), y0 - int(r), x1 + int(r), y1 + int(r)) for (x0, y0, x1, y1), r in reaches]
        return [one for one in (within(window, frame) for window in grown) if one[0] < one[2] and one[1] < one[3]]

    def enough(self, part: np.ndarray, least: int) -> bool:
        """Whether `part` (h, w) bool has at least `least` pixels, and is no speck of the object."""
        return bool(np.count_nonzero(part) >= max(least, SPECK * self._area))

    def again(self, frame: np.ndarray) -> tuple[np.ndarray, Window] | None:
        """The object as it was last seen whole (h, w) bool, and its window in the next `frame` (H, W, 3), if it looks the same there.

        This finds what sways in one place, where the background is not known.
        """
        (x0, y0, _, _), (ahead, top) = self._window, self.expected[:2]
        found = [self._match(frame, np.array(shift)) for shift in ((ahead - x0, top - y0), (0, 0))]
        apart, there = min(found, key=lambda one: one[0])
        return (self._part, there) if apart <= SAME else None

    def _match(self, frame: np.ndarray, expected: np.ndarray) -> tuple[float, Window]:
        """The median difference of colour [grey levels] from the object as it was last seen whole, and its window, where it fits best near
        the `expected` shift (2,) [px]; infinite if a part would be outside the `frame`."""
        x0, y0, x1, y1 = self._window
        reach = max(3.0, ASTRAY[0] * float(np.sqrt(self._area)))
        dx, dy = (int(value) for value in np.round(body_shift(self._template, self._part, (x0, y0), frame, expected, reach)))
        there = (x0 + dx, y0 + dy, x1 + dx, y1 + dy)
        if within(there, frame) != there:
            return np.inf, there
        apart = np.abs(cut(frame, there).astype(np.int16) - self._template).max(axis=2)
        return float(np.median(apart[self._part])), there

    def state(self) -> dict[str, np.ndarray]:
        """All that later frames depend on."""
        return {
            "last_pace": self.pace,
            "last_counts": np.array([self._since, self._area, self.thick]),
            "last_windows": np.array([self._window, self._last]),
            "last_part": self._part,
            "last_template": self._template,
        }

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Continue from what `state()` returned."""
        self.pace, self._part, self._template = state["last_pace"], state["last_part"], state["last_template"]
        since, self._area, thick = (float(value) for value in state["last_counts"])
        self._since, self.thick = int(since), int(thick)
        self._window, self._last = (tuple(int(value) for value in row) for row in state["last_windows"])  # type: ignore[assignment]
