"""Other things beside the object, that hold it, push it or meet it: known by how they move, and carried along, so that nothing of them is
taken in where the two touch."""

from __future__ import annotations

import cv2
import numpy as np

from ..background import Plate
from ..carried import Carried
from ..cutting import enclosed, grown, hanging_on, narrowed, opened, widened
from ..evidence import FEW, Colors
from ..motion import Flow, Window, cut, joined, paste, placed, window_of, within
from .in_box import NEARBY, Moving, changes

FAR = 8
"""Pixels outside a box that dense flow, a codec's traces and the rim of a thing that fills the box do not reach."""

WIDE = 0.1
"""Length of a box's border across what goes on beyond it, in units of the root of the object's area, at least."""

AROUND = 0.5
"""Part of a box's border across which no other thing goes on: what comes out nearly all round the box is the flow's."""

COMMONER = 0.7
"""Log odds from which a colour is another thing's: twice as common there as in the object."""

THICK, LARGE = 5, 0.3
"""Thickness of another thing beside the object [px] and in units of the root of the object's area: less is the object's own, missed rim."""

OTHERWISE = 1.0
"""Pixels per frame by which a thing beside the object has to move otherwise: less is what dense flow is off by."""

SAMPLES = 20_000
"""Pixels of other things whose colours are kept."""


class Other(Carried):
    """What is known to be another thing: in frame 0, see `beyond_box`; later, what differs from the background beside the object, is thick
    and moves otherwise. The flow carries it on, until the background or the object is seen there.

    Attributes:
        colors: the object's, against its surroundings and against what was known to be another thing so far.
    """

    def __init__(self, frame: np.ndarray, mask: np.ndarray, other: np.ndarray | None) -> None:
        """`frame` (H, W, 3) uint8; the object `mask` (H, W) bool, and another thing (H, W) bool, if there is one, in it."""
        super().__init__("other", other)
        self._beside = Carried("beside")
        around = window_of(mask, 24)
        near = widened(cut(mask, around), 2)
        self._inside, self._outside, self._seen = frame[mask], cut(frame, around)[~near], np.zeros((0, 3), np.uint8)
        self.colors = self._learnt()

    def move(self, frame: np.ndarray, flow: Flow | None, motion: np.ndarray, sought: Window) -> None:
        """To the next `frame` (H, W, 3) by the `flow` found in the window `sought`, while the object moves by `motion` (2,) [px]."""
        met = self._beside
        if flow is None:
            met.set(np.zeros((1, 1), bool))
            return
        self.set(self.over(sought), sought)
        self.flow(flow)
        if not met.any():
            return
        otherwise = np.linalg.norm(flow.over(met.window) - motion.astype(np.float32), axis=2) > OTHERWISE
        met.set(met.part & otherwise, met.window)
        met.flow(flow)
        both = joined(self.window, met.window) if self.any() else met.window
        self.set(self.over(both) | met.over(both), both)
        self._seen = np.concatenate([self._seen, cut(frame, met.window)[met.part]])[-SAMPLES:]
        self.colors = self._learnt()

    def keep(
        self, differs: np.ndarray, background: np.ndarray, unlike: np.ndarray, found: np.ndarray, whole: np.ndarray, where: Window
    ) -> None:
        """After a frame, (h, w) bool in the window `where`: what `differs` from the background, where that is seen, what is `unlike` the
        object in its colours, what is `found` to be the object, and what may be."""
        if self.any():
            both = joined(self.window, where)
            part, (more, behind, own) = self.over(both), (placed(one, where, both) for one in (differs & unlike, background, found))
            self.set((part & ~behind | grown(part) & more & ~enclosed(own)) & ~own, both)
        rest = differs & ~whole
        thick = max(THICK, int(LARGE * np.sqrt(np.count_nonzero(found)))) | 1
        self._beside.set(hanging_on(rest, opened(rest, thick)), where)

    def state(self) -> dict[str, np.ndarray]:
        """See `Carried.state`."""
        return super().state() | self._beside.state() | {"other_seen": self._seen}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """See `Carried.resume`."""
        super().resume(state)
        self._beside.resume(state)
        self._seen = state["other_seen"]
        self.colors = self._learnt()

    def _learnt(self) -> Colors:
        """Half of the surroundings' colours are those of other things, once some are known."""
        step = max(1, len(self._outside) // max(1, len(self._seen)))
        return Colors(self._inside, np.concatenate([self._seen, self._outside[::step]]) if len(self._seen) else self._outside)


def beyond_box(frame: np.ndarray, mask: np.ndarray, inside: np.ndarray, plate: Plate, moving: Moving) -> np.ndarray:
    """Another thing (H, W) bool in frame 0 that moves and goes on outside the box `inside` (H, W) bool: a hand that holds the object.

    A box holds all of the object. So what comes out of it and moves outside is something else, and so is what hangs together with that in
    the box and has colours that are commoner there than in the object `mask` (H, W) bool. Nothing for a small object: it has few colours.
    """
    other, least = np.zeros_like(mask), WIDE * np.sqrt(np.count_nonzero(mask))
    if np.count_nonzero(mask) < FEW:
        return other
    near, moves = within(window_of(inside, NEARBY), frame), np.zeros_like(mask)
    paste(moves, changes(frame, plate, moving, near) > 0.0, near)
    border = inside & ~narrowed(inside, 2)
    reaching = border & moves & hanging_on(moves & inside, mask)
    if np.count_nonzero(reaching) < 2.0 * least:
        return other
    # Near the end of its window, flow leads out of it.
    x0, y0, x1, y1 = window_of(inside, 0)
    window = within((x0 - (x1 - x0) // 2, y0 - (y1 - y0) // 2, x1 + (x1 - x0) // 2, y1 + (y1 - y0) // 2), frame)
    crop, boxed = cut(frame, window), cut(inside, window)
    likely = changes(frame, plate, moving, window) > 0.0
    out = _leading_away(likely & ~boxed, boxed, cut(reaching, window), least)
    if not out.any():
        return other
    odds = cv2.GaussianBlur(Colors(crop[out], crop[cut(mask, window)]).odds(crop), (0, 0), 1.5)
    paste(other, hanging_on(opened(odds > COMMONER) & likely & boxed, out), window)
    return other


def _leading_away(outside: np.ndarray, boxed: np.ndarray, reaching: np.ndarray, least: float) -> np.ndarray:
    """The parts of what moves `outside` a box, (h, w) bool both, that come out of it over `least` [px] of `reaching` (h, w) bool and lead
    away."""
    off = cv2.distanceTransform((~boxed).astype(np.uint8), cv2.DIST_L2, 5)
    count, labels = cv2.connectedComponents(outside.astype(np.uint8), connectivity=4)
    far = np.bincount(labels[outside & (off > FAR)], minlength=count) > 0
    crossing = np.bincount(labels[outside & (off <= 2.0) & widened(reaching, 3)], minlength=count) / 2.0
    found: np.ndarray = (far & (crossing > least))[labels] & outside
    beside = ~boxed & (off <= 1.0)
    return found & ((found & beside).sum() <= AROUND * beside.sum())
