"""Carrying the object's mask from one frame to the next."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...masks import WHOLE
from ...progress import Progress
from .background import Plate
from .carried import Carried, Segmented, Segmenter
from .cutting import LEAST_PIXELS, connected_to, opened, tidy
from .evidence import Contrast, against_network, against_plate, against_shape, cut_out, total_odds
from .motion import Flow, FlowSolver, Window, band_of, body_shift, cut, median_of, middle_of, paste, placed, shifted, window_of, within
from .moving.last_seen import LastSeen
from .moving.others import Other
from .moving.panned import PannedPlate
from .rim import cut_back

LOST = 0.3
"""Fraction of the expected area below which the object counts as hidden or gone; the last shape seen is then kept for the search."""

LEAP = 80.0
"""Distance [px] up to which a small object may move several times its own width from frame 0 to the next."""

SURELY = 2.0
"""Log odds from the background which the object's missing part must have at least; it is looked for while less than WHOLE of it is seen."""

FILTERS = 8
"""Pixels that filters reach beyond the window whose values are needed."""


@dataclass(frozen=True)
class Surroundings:
    """What is known at the start about the background and about other things beside the object."""

    plate: Plate | None = None
    """The background."""
    contrast: Contrast | None = None
    """How the object differs from the background; if None, this is learnt from frame 0."""
    other: np.ndarray | None = None
    """(H, W) bool: another thing that moves along with the object in frame 0, see `others.beyond_box`."""
    panned: bool = False
    """The camera moves, so the plate holds for frame 0 only."""
    network: Segmenter | None = None
    """A network that helps to outline the object."""
    frames: int = 0
    """The clip's length; only a network needs it."""

    @property
    def still(self) -> Plate | None:
        """The background of all frames; None where it is unknown or the camera moves."""
        return None if self.panned else self.plate


class MaskFollower:
    """Follows one object (a `through.Follower`): whole-body search, then flow, then all evidence near the silhouette carried by them.

    Where the camera moves, the background is what was seen beside the object so far, see `moving.panned`.

    Attributes:
        mask: (H, W) bool, of the newest frame.
        flow: motion from the frame before to the newest one; None if the object was hidden before the newest frame.
        velocity: (2,) [px per frame], the motion of the whole object.
        hidden: whether the object was not found in the newest frame.
    """

    def __init__(self, frame: np.ndarray, mask: np.ndarray, known: Surroundings, progress: Progress, *, trim: bool = True) -> None:
        """`frame` (H, W, 3) uint8 RGB and `mask` (H, W) bool are frame 0's; `progress` can cancel several times a frame.

        `trim`: finished masks end in the middle of a blurred rim.
        """
        self._trim = trim
        self._progress = progress
        self._still, self._behind, self._contrast = known.still, known.plate, known.contrast
        if known.plate is not None and known.contrast is None:
            self._contrast = Contrast(known.plate, [(frame, mask)])
        self._panned = PannedPlate(frame, mask, known.plate) if known.panned and known.plate is not None else None
        self._solver = FlowSolver(rough=True)
        self._gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        self._shape, self._whole = Carried("shape", mask), Carried("whole", mask)
        self._template = cut(frame, self._shape.window).copy()
        self._steps = 0
        self._missed = 0
        self._last = LastSeen(frame, mask)
        self._most = float(np.count_nonzero(mask))
        self._other = Other(frame, mask, known.other)
        self._segmented = None if known.network is None else Segmented(known.network, mask, known.frames)
        self.mask = mask
        self.velocity = np.zeros(2)
        self.hidden = False
        self.flow: Flow | None = None

    def advance(self, frame: np.ndarray) -> np.ndarray:
        """The mask (H, W) bool of the next `frame` (H, W, 3) uint8 RGB; all False where the object is hidden or gone."""
        gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        if self._panned is not None:
            self._behind = self._panned.carried(gray)
        comes_back = self.hidden and self._behind is not None
        shift = self._last.pace if comes_back else self._search(frame)
        self._progress.check()
        window = self._shape.window
        side = max(window[2] - window[0], window[3] - window[1])
        margin = int(np.clip(0.25 * side, 12, 80))
        wide = (window[0] - margin, window[1] - margin, window[2] + margin, window[3] + margin)
        self.flow = None if self.hidden else self._solver.between(self._gray, gray, wide, shift)
        self._progress.check()
        motion = self._motion()
        if comes_back:
            self._whole.place(np.array(self._last.expected[:2]))
        else:
            self._whole.shift(motion)
        self._other.move(frame, self.flow, motion, wide)
        carried, where = self._coming_back(frame) if comes_back else self._carry(shift, margin)
        if self._segmented is not None:
            self._segmented.advance(frame, self.flow, motion, carried, where)
            self._progress.check()
        found, where = self._with_what_comes_back(frame, self._silhouette(frame, carried, where), where)
        self._remember(frame, gray, shift, motion, carried, found, where)
        mask = np.zeros(gray.shape, bool)
        if not self.hidden:
            paste(mask, found, where)
        if self._panned is not None:
            self._panned.learn(frame, mask)
        self.mask = mask
        return mask

    def finished(self, frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """See `through.Follower.finished`."""
        return cut_back(frame, mask, self._still, self._progress) if self._trim else mask

    def state(self) -> dict[str, np.ndarray]:
        """See `through.Follower.state`."""
        own = {
            "template": self._template,
            "velocity": self.velocity,
            "counts": np.array([self._steps, self._missed, self.hidden, self._most]),
        } | self._shape.state() | self._whole.state() | self._last.state() | self._other.state()
        for more in (self._panned, self._segmented):
            own |= {} if more is None else more.state()
        return own

    def resume(self, frame: np.ndarray, mask: np.ndarray, state: dict[str, np.ndarray]) -> None:
        """See `through.Follower.resume`."""
        steps, missed, hidden, most = (int(value) for value in state["counts"])
        self._template = state["template"]
        self._steps, self._missed, self._most = steps, missed, float(most)
        self.hidden, self.velocity = hidden > 0, state["velocity"]
        self._gray, self.mask, self.flow = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), mask, None
        for carried in (self._shape, self._whole, self._last, self._other):
            carried.resume(state)
        if self._panned is not None:
            self._panned.resume(frame, state)
        if self._segmented is not None:
            self._segmented.resume(state)

    def _search(self, frame: np.ndarray) -> np.ndarray:
        size = float(np.sqrt(np.count_nonzero(self._shape.part)))
        # Nothing is known about the first step; a large object moves only a part of its own width.
        reach = max(24.0, min(4.0 * size, LEAP), 0.7 * size) if self._steps == 0 else max(12.0, 0.5 * size)
        if self.hidden:
            reach = max(reach, 1.5 * size) * (1 + min(self._missed, 4))
        return body_shift(self._template, self._shape.part, self._shape.window[:2], frame, self.velocity, min(reach, 200.0))

    def _motion(self) -> np.ndarray:
        """Motion (2,) [px] of the whole object: the median flow, as its centroid would also move by what the mask gains or loses."""
        if self.flow is None:
            return self._last.pace
        motion = np.ascontiguousarray(self.flow.of(self._shape.part, self._shape.window).T)
        return np.array([median_of(one) for one in motion])

    def _carry(self, shift: np.ndarray, margin: int) -> tuple[np.ndarray, Window]:
        """The last silhouette moved by the flow (without one, by the shift), in a window round its new place, and that window."""
        x0, y0, x1, y1 = there = shifted(self._shape.window, *(int(value) for value in np.round(shift)))
        where = (x0 - margin, y0 - margin, x1 + margin, y1 + margin)
        if self.flow is None:
            return placed(self._shape.part, there, where), where
        moved = Carried("moved")
        moved.set(self._shape.part, self._shape.window)
        moved.flow(self.flow)
        return opened(moved.over(where)), where

    def _coming_back(self, frame: np.ndarray) -> tuple[np.ndarray, Window]:
        """Pixels (h, w) bool that may be of the object, which is hidden so far, and their window.

        They are near where it would be by now or where it was seen last, surely not background, and have the object's colours. Without
        any, it may stand where it stood.
        """
        for where in self._last.sought(frame):
            sure = self._surely(frame, where)
            if sure is not None and self._last.enough(sure, LEAST_PIXELS):
                return sure, where
        return self._last.again(frame) or (np.zeros((1, 1), bool), (0, 0, 1, 1))

    def _surely(self, frame: np.ndarray, where: Window) -> np.ndarray | None:
        """Pixels (h, w) bool in the window `where` that are surely not background and have the object's colours; None where no background
        is known, or if the window has no area."""
        seen = self._against_plate(frame, where)
        if seen is None:
            return None
        return opened(seen[1] & (seen[0] > SURELY) & (self._other.colors.odds(cut(frame, where)) > 0.0), self._last.thick)

    def _silhouette(self, frame: np.ndarray, carried: np.ndarray, where: Window) -> np.ndarray:
        """The object (h, w) bool, found near its `carried` silhouette (h, w) bool, both in the window `where`."""
        if not carried.any():
            return carried
        band = band_of(float(np.count_nonzero(carried)))
        # More than three bands away from the silhouette, no evidence outweighs that distance.
        around = within(shifted(window_of(carried, int(3 * band) + FILTERS), *where[:2]), frame)
        if around[0] >= around[2] or around[1] >= around[3]:
            return np.zeros_like(carried)
        crop, seen, before = cut(frame, around), self._against_plate(frame, around), placed(carried, where, around)
        colors = self._other.colors.odds(crop)
        odds = total_odds(against_shape(before, band), seen, colors, self._other.over(around) & (colors < 0.0) & ~before)
        own = self._cut(odds, crop, before, around)
        if seen is not None:
            differs = seen[1] & (seen[0] > 0.0)
            self._other.keep(differs, seen[1] & ~differs, colors < 0.0, own, own | self._whole.over(around), around)
        return placed(own, around, where)

    def _cut(self, odds: np.ndarray, crop: np.ndarray, before: np.ndarray, around: Window) -> np.ndarray:
        """The object (h, w) bool by the log `odds` (h, w) and a network's outline, near the silhouette `before` (h, w) bool in the window
        `around`, whose pixels are `crop` (h, w, 3) uint8."""

        def found() -> np.ndarray:
            return tidy(cut_out(odds, crop, float(np.count_nonzero(before))), before)

        network = self._segmented
        if network is None or network.fresh and network.confirms(found(), around) or (outline := network.over(around)) is None:
            return found()
        odds += against_network(outline, network.fresh)
        return found()

    def _with_what_comes_back(self, frame: np.ndarray, found: np.ndarray, where: Window) -> tuple[np.ndarray, Window]:
        """The object (h, w) bool that `_silhouette` `found` in the window `where`, found again from a larger shape if much less of the
        object is seen than once; and its window.

        A part that comes out from behind a post, or a sheet that was edge-on and turns, is farther away than a silhouette can be off.
        Pixels that are surely not background and have the object's colours belong to it if they adjoin it, or lie where all of it would be.
        """
        self._most = max(self._most, float(np.count_nonzero(found)))
        if np.count_nonzero(found) >= WHOLE * self._most:
            self._whole.set(found, where)
            return found, where
        wide = shifted(window_of(found, int(0.5 * np.sqrt(self._most))), *where[:2]) if found.any() else where
        wide = within(wide, frame)
        sure = self._surely(frame, wide)
        if sure is None:
            return found, where
        again = connected_to(sure, placed(found, where, wide) | sure & self._whole.over(wide))
        return (self._silhouette(frame, again, wide), wide) if np.count_nonzero(again) > np.count_nonzero(found) else (found, where)

    def _against_plate(self, frame: np.ndarray, around: Window) -> tuple[np.ndarray, np.ndarray] | None:
        """The result of `against_plate` in the window `around`; None where no background is known, or if the window has no area."""
        if self._behind is None or self._contrast is None or around[0] >= around[2] or around[1] >= around[3]:
            return None
        return against_plate(frame, self._behind, around, self._contrast)

    def _remember(
        self,
        frame: np.ndarray,
        gray: np.ndarray,
        shift: np.ndarray,
        motion: np.ndarray,
        carried: np.ndarray,
        found: np.ndarray,
        where: Window,
    ) -> None:
        area, before = float(np.count_nonzero(found)), float(np.count_nonzero(carried))
        was_hidden = self.hidden
        few = min(LEAST_PIXELS, 0.5 * before)
        self.hidden = area < max(LOST * before, few) or not self._last.enough(found, 1)
        self._missed, self._gray = self._missed + 1 if self.hidden else 0, gray
        self._steps += 1
        if self.hidden:
            self._last.missed()
            # The shape seen last moves on at the last velocity.
            self._shape.shift(self.velocity if self._steps > 1 else shift)
            return
        self._last.seen(frame, found, where, None if was_hidden else motion)
        middle = middle_of(self._shape.part) + self._shape.window[:2]
        self._shape.set(found, where)
        self.velocity = self._last.pace if was_hidden else middle_of(self._shape.part) + self._shape.window[:2] - middle
        self._template = cut(frame, self._shape.window).copy()
