"""What something still in front of the object hides of it, carried along with what is seen, so that it is known again on the other side;
and what goes on beyond a box.

Such a thing, a post or a branch, is a part of the background. Where it hides the object, the frame looks as the background does, and
the carried silhouette ends. What comes out behind it lies farther away than a silhouette can be off, and would grow back slowly.

Where the object has been seen, nothing stands before it: background that is seen there again was let go of, not hidden.
"""

from __future__ import annotations

import cv2
import numpy as np

from .background import Plate
from .evidence import Colors
from .from_box import FEW
from .motion import Window, cut, joined, paste, placed, window_of, within
from .moving.in_box import NEARBY, Moving, left

THICK = 5
"""Pixels across from which something hides a part: less is a rim that was carried on too far."""

FAR = 8
"""Pixels outside a box that dense flow, a codec's traces and the rim of a thing that fills the box do not reach."""

WIDE = 0.1
"""Length of a box's border across what goes on beyond it, in units of the root of the object's area, at least."""

AROUND = 0.5
"""Part of a box's border across which no other thing goes on: what comes out nearly all round the box is the flow's."""

COMMONER = 0.7
"""Log odds from which a colour is another thing's: twice as common there as in the object."""


class Veil:
    """The hidden part of the object."""

    def __init__(self, mask: np.ndarray) -> None:
        """`mask` (H, W) bool: the object in frame 0."""
        self._clear = mask.copy()
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
        return placed(self._part, self._window, where)

    def keep(self, whole: np.ndarray, found: np.ndarray, background: np.ndarray, where: Window) -> None:
        """After a frame: what was to be expected, what was found and where it looks like the background, (h, w) bool in the window `where`.

        `whole` is the silhouette before, moved without its hidden part.
        """
        inside = np.zeros_like(self._clear)
        paste(inside, cv2.erode(found.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0, where)
        self._clear |= inside
        both = joined(where, self.window)
        whole, found, background = (placed(one, where, both) for one in (whole, found, background))
        clear = cut(self._clear, both, cv2.BORDER_CONSTANT)
        hidden = (self.over(both) | whole & background) & ~found & ~(background & clear)
        if not hidden.any():
            self._part, self._window = np.zeros((0, 0), bool), (0, 0, 0, 0)
            return
        x0, y0, x1, y1 = window_of(hidden, 0)
        self._part = hidden[y0:y1, x0:x1].copy()
        self._window = (x0 + both[0], y0 + both[1], x1 + both[0], y1 + both[1])

    def state(self) -> dict[str, np.ndarray]:
        """All that the frames to come depend on."""
        clear = np.packbits(self._clear)
        return {"veil": self._part, "veil_window": np.array(self._window), "veil_rest": self._rest, "veil_clear": clear}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Go on from what `state` gave."""
        x0, y0, x1, y1 = (int(value) for value in state["veil_window"])
        self._part, self._window, self._rest = state["veil"], (x0, y0, x1, y1), state["veil_rest"]
        self._clear = np.unpackbits(state["veil_clear"], count=self._clear.size).reshape(self._clear.shape) > 0


def beyond_box(frame: np.ndarray, mask: np.ndarray, inside: np.ndarray, plate: Plate, moving: Moving) -> np.ndarray:
    """Another thing (H, W) bool in frame 0 that moves and goes on outside the box `inside` (H, W) bool: a hand that holds the object.

    A box holds all of the object. So what comes out of it and moves outside is something else, and so is what hangs together with that in
    the box and has colours that are commoner there than in the object `mask` (H, W) bool. Nothing for a small object: it has few colours.
    """
    other, least = np.zeros_like(mask), WIDE * np.sqrt(mask.sum())
    if mask.sum() < FEW:
        return other
    near, moves = within(window_of(inside, NEARBY), frame), np.zeros_like(mask)
    paste(moves, moving(near) + left(frame, plate, near) > 0.0, near)
    border = inside & (cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0)
    reaching = border & moves & _hanging_on(moves & inside, mask)
    if reaching.sum() < 2.0 * least:
        return other
    # Near the end of its window, flow leads out of it.
    x0, y0, x1, y1 = window_of(inside, 0)
    window = within((x0 - (x1 - x0) // 2, y0 - (y1 - y0) // 2, x1 + (x1 - x0) // 2, y1 + (y1 - y0) // 2), frame)
    crop, boxed = cut(frame, window), cut(inside, window)
    likely = moving(window) + left(frame, plate, window) > 0.0
    out = _leading_away(likely & ~boxed, boxed, cut(reaching, window), least)
    if not out.any():
        return other
    odds = cv2.GaussianBlur(Colors(crop[out], crop[cut(mask, window)]).odds(crop), (0, 0), 1.5)
    alike = cv2.morphologyEx((odds > COMMONER).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    paste(other, _hanging_on(alike & likely & boxed, out), window)
    return other


def _leading_away(outside: np.ndarray, boxed: np.ndarray, reaching: np.ndarray, least: float) -> np.ndarray:
    """The parts of what moves `outside` a box, (h, w) bool both, that come out of it over `least` [px] of `reaching` (h, w) bool and lead
    away."""
    off = cv2.distanceTransform((~boxed).astype(np.uint8), cv2.DIST_L2, 5)
    count, labels = cv2.connectedComponents(outside.astype(np.uint8), connectivity=4)
    far = np.bincount(labels[outside & (off > FAR)], minlength=count) > 0
    at = cv2.dilate(reaching.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    crossing = np.bincount(labels[outside & (off <= 2.0) & at], minlength=count) / 2.0
    found: np.ndarray = (far & (crossing > least))[labels] & outside
    beside = ~boxed & (off <= 1.0)
    return found & ((found & beside).sum() <= AROUND * beside.sum())


def _hanging_on(parts: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """The `seeds` (h, w) bool with what hangs together with them of the `parts` (h, w) bool."""
    count, labels = cv2.connectedComponents((parts | seeds).astype(np.uint8), connectivity=4)
    touching = np.bincount(labels[seeds], minlength=count) > 0
    touching[0] = False
    return touching[labels]


def out_again(differs: np.ndarray, carried: np.ndarray, band: float) -> np.ndarray:
    """The parts of `differs` (h, w) bool, what was hidden and looks like no background any more, that the silhouette does not reach.

    What lies within `band` [px] of the `carried` silhouette (h, w) bool is found from there, with all that is known of its rim.
    """
    core = cv2.morphologyEx(differs.astype(np.uint8), cv2.MORPH_OPEN, np.ones((THICK, THICK), np.uint8))
    if not core.any():
        return core > 0
    count, labels = cv2.connectedComponents(core, connectivity=8)
    reached = cv2.distanceTransform(1 - carried.astype(np.uint8), cv2.DIST_L2, 5) <= band
    apart = np.bincount(labels[reached], minlength=count) == 0
    apart[0] = False
    return apart[labels]


def adjoining(sure: np.ndarray, own: np.ndarray) -> np.ndarray:
    """`own` (h, w) bool with the parts of `sure` (h, w) bool, THICK at least, that hang together with it."""
    core = cv2.morphologyEx(sure.astype(np.uint8), cv2.MORPH_OPEN, np.ones((THICK, THICK), np.uint8)) > 0
    return _hanging_on(core, own)
