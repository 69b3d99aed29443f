"""Other things beside the object, which hold it, push it or meet it: recognised by their motion and carried along, so that none of their
pixels get into the mask where the two touch."""

from __future__ import annotations

import cv2
import numpy as np

from ..background import Plate
from ..carried import Carried
from ..cutting import connected_to, enclosed, grown, narrowed, opened, widened
from ..evidence import FEW, Colors
from ..motion import Flow, Window, cut, joined, paste, placed, window_of, within
from .in_box import NEARBY, Moving, change_odds

FAR = 8
"""Distance [px] outside a box that dense flow, a codec's artefacts and the rim of an object that fills the box do not reach."""

WIDE = 0.1
"""Least length of a box's border that a thing must cross to count as going on beyond it, in units of the root of the object's area."""

AROUND = 0.5
"""Largest fraction of a box's border that another thing may cross: motion nearly all round the box is an artefact of the flow."""

COMMONER = 0.7
"""Log odds from which a colour counts as another thing's: twice as common there as in the object."""

THICK, LARGE = 5, 0.3
"""Least thickness of another thing beside the object, in pixels, and in units of the root of the object's area: thinner parts are the
object's own rim that the mask missed."""

OTHERWISE = 1.0
"""Least difference [px per frame] between another thing's motion and the object's: smaller ones are errors of dense flow."""

SAMPLES = 20_000
"""Number of pixels of other things whose colours are kept."""


class Other(Carried):
    """The pixels known to be another thing: in frame 0 by `beyond_box`; later those beside the object that differ from the background, are
    thick and move differently from the object. The flow carries them on, until the background or the object is seen in their place.

    Attributes:
        colors: of the object, against its surroundings and against all that was known to be another thing so far.
    """

    def __init__(self, frame: np.ndarray, mask: np.ndarray, other: np.ndarray | None) -> None:
        """`frame` (H, W, 3) uint8; in it, the object's `mask` (H, W) bool and `other` (H, W) bool, another thing, None if there is none."""
        super().__init__("other", other)
        self._beside = Carried("beside")
        around = window_of(mask, 24)
        near = widened(cut(mask, around), 2)
        self._inside, self._outside, self._seen = frame[mask], cut(frame, around)[~near], np.zeros((0, 3), np.uint8)
        self.colors = self._learnt()

    def move(self, frame: np.ndarray, flow: Flow | None, motion: np.ndarray, sought: Window) -> None:
        """Move on to the next `frame` (H, W, 3) by the `flow` found in the window `sought`; the object moves by `motion` (2,) [px]."""
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
        """Update the other things after a frame, from (h, w) bool arrays in the window `where`.

        `differs`: pixels that differ from the background; `background`: that show it; `unlike`: that do not have the object's colours;
        `found`: the object; `whole`: all that may be the object.
        """
        if self.any():
            both = joined(self.window, where)
            part, (more, behind, own) = self.over(both), (placed(one, where, both) for one in (differs & unlike, background, found))
            self.set((part & ~behind | grown(part) & more & ~enclosed(own)) & ~own, both)
        rest = differs & ~whole
        thick = max(THICK, int(LARGE * np.sqrt(np.count_nonzero(found)))) | 1
        self._beside.set(connected_to(rest, opened(rest, thick)), where)

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
        """The object's colours against its surroundings', of which half are sampled from other things once some are known."""
        step = max(1, len(self._outside) // max(1, len(self._seen)))
        return Colors(self._inside, np.concatenate([self._seen, self._outside[::step]]) if len(self._seen) else self._outside)


def beyond_box(frame: np.ndarray, mask: np.ndarray, inside: np.ndarray, plate: Plate, moving: Moving) -> np.ndarray:
    """Another moving thing (H, W) bool in frame 0 that goes on outside the box `inside` (H, W) bool, such as a hand that holds the object.

    The box contains all of the object. So what comes out of it and moves outside is something else, and so is anything in the box that is
    connected to it and whose colours are commoner there than in the object `mask` (H, W) bool. None is found beside a small object, which
    has too few colours.
    """
    other, least = np.zeros_like(mask), WIDE * np.sqrt(np.count_nonzero(mask))
    if np.count_nonzero(mask) < FEW:
        return other
    near, moves = within(window_of(inside, NEARBY), frame), np.zeros_like(mask)
    paste(moves, change_odds(frame, plate, moving, near) > 0.0, near)
    border = inside & ~narrowed(inside, 2)
    reaching = border & moves & connected_to(moves & inside, mask)
    if np.count_nonzero(reaching) < 2.0 * least:
        return other
    # A wide window, because flow near a window's edge may lead out of it.
    x0, y0, x1, y1 = window_of(inside, 0)
    window = within((x0 - (x1 - x0) // 2, y0 - (y1 - y0) // 2, x1 + (x1 - x0) // 2, y1 + (y1 - y0) // 2), frame)
    crop, boxed = cut(frame, window), cut(inside, window)
    likely = change_odds(frame, plate, moving, window) > 0.0
    out = _leading_away(likely & ~boxed, boxed, cut(reaching, window), least)
    if not out.any():
        return other
    odds = cv2.GaussianBlur(Colors(crop[out], crop[cut(mask, window)]).odds(crop), (0, 0), 1.5)
    paste(other, connected_to(opened(odds > COMMONER) & likely & boxed, out), window)
    return other


def _leading_away(outside: np.ndarray, boxed: np.ndarray, reaching: np.ndarray, least: float) -> np.ndarray:
    """The parts (h, w) bool of what moves `outside` a box that come out of the box and lead away from it.

    `outside`, `boxed`: (h, w) bool, moving pixels outside the box, and the box; `reaching`: (h, w) bool, the moving pixels of the box's
    border, of which a part must cross more than `least` [px].
    """
    off = cv2.distanceTransform((~boxed).astype(np.uint8), cv2.DIST_L2, 5)
    count, labels = cv2.connectedComponents(outside.astype(np.uint8), connectivity=4)
    far = np.bincount(labels[outside & (off > FAR)], minlength=count) > 0
    crossing = np.bincount(labels[outside & (off <= 2.0) & widened(reaching, 3)], minlength=count) / 2.0
    found: np.ndarray = (far & (crossing > least))[labels] & outside
    beside = ~boxed & (off <= 1.0)
    return found & ((found & beside).sum() <= AROUND * beside.sum())
