"""Carrying the object's mask through the clip, one frame at a time."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np

from ...masks import Masks, Packing
from ...progress import Loop, Progress
from ...record_arrays import from_arrays, to_arrays
from .background import Plate
from .cutting import LEAST_PIXELS, tidy
from .evidence import Colors, Looks, against_plate, against_shape, band_of, cut_out, trimmed
from .flows import Flows
from .motion import Flow, FlowSolver, Window, body_shift, cut, middle_of, paste, window_of, within

if TYPE_CHECKING:
    from ..tracks.reseed import Generations

SMALL = 400
"""Pixels below which an object has too few colours and too small an inside for flow and GrabCut."""

LOST = 0.3
"""A mask smaller than this part of what was expected means hidden or gone, and the shape seen last is kept for the search."""

PARTLY = 0.75
"""A small object's mask below this part of its usual size is partly hidden: shape, colours and velocity of the last full sight are kept."""


CARRIED, CARRIED_BLIND = 2.0, 1.2
"""Most log odds for the silhouette that was carried on, where the background is known and where only colours speak, which are less sure:
what is wrong in it goes away again."""

FILTERS = 8
"""Pixels that filters reach beyond what they are asked for."""

BESIDE_PLATE = 0.3
"""Weight of colours where the background is known."""


class Follower(Protocol):
    """What knows where the object is in one frame after the other. `flow` leads to the newest, None where it is hidden in either."""

    mask: np.ndarray
    flow: Flow | None

    def advance(self, picture: np.ndarray) -> np.ndarray:
        """The mask (H, W) bool of the next `picture` (H, W, 3) uint8 RGB; all False when the object is hidden or gone."""

    def finished(self, picture: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """The `mask` that `advance` gave for `picture`, as it is handed on. Nothing of what follows depends on it, so it may run beside."""

    def state(self) -> dict[str, np.ndarray]:
        """All that the frames to come depend on, besides the newest frame and its mask."""

    def resume(self, picture: np.ndarray, mask: np.ndarray, state: dict[str, np.ndarray]) -> None:
        """Go on behind `picture` with its `mask`, as what gave `state` would have."""


class MaskFollower:
    """Follows one object: whole-body search, flow, then all evidence round the carried silhouette.

    Where the camera stands still, `plate` tells pixels that did not change (never object, away from its inside) and gives a small
    object, of too few pixels for colours, its silhouette.

    Attributes:
        flow: motion from the frame before to the newest one; None after `hidden`.
        velocity: (2,) [px per frame], the whole body's.
        hidden: the object was not found in the newest frame.
    """

    def __init__(
        self,
        picture: np.ndarray,
        mask: np.ndarray,
        plate: Plate | None,
        progress: Progress,
        looks: Looks | None = None,
        trim: bool = False,
        known: Flows | None = None,
        kept: Flows | None = None,
    ) -> None:
        """`picture` (H, W, 3) uint8 RGB and `mask` (H, W) bool of frame 0; `progress` is asked several times a frame.

        `looks`: how the object differs from the plate; None learns it from frame 0. `trim`: masks end in the middle of a blurred rim.
        `known`: motion that a former pass found, `kept`: takes what this one finds.
        """
        self._trim, self._known, self._kept = trim, known, kept
        self._progress = progress
        self._plate = plate
        self._looks = looks if looks is not None or plate is None else Looks(plate, [(picture, mask)])
        self._solver = FlowSolver(rough=True)
        near = cv2.dilate(cut(mask, window_of(mask, 24)).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        around = cut(picture, window_of(mask, 24))
        self._colors = Colors(picture[mask], around[~near])
        self._gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        self._shape_window: Window = window_of(mask, 0)
        self._shape = cut(mask, self._shape_window)
        self._template = cut(picture, self._shape_window).copy()
        self._steps = 0
        self._missed = 0
        self.mask = mask
        self.velocity = np.zeros(2)
        self.hidden = False
        self.flow: Flow | None = None

    def advance(self, picture: np.ndarray) -> np.ndarray:
        """The mask (H, W) bool of the next `picture` (H, W, 3) uint8 RGB; all False when the object is hidden or gone."""
        gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        shift = self._search(picture)
        self._progress.check()
        window = self._shape_window
        side = max(window[2] - window[0], window[3] - window[1])
        margin = int(np.clip(0.25 * side, 12, 80))
        wide = (window[0] - margin, window[1] - margin, window[2] + margin, window[3] + margin)
        self.flow = None if self.hidden or self._known is None else self._known.covering(self._steps, window)
        if self.flow is None and not self.hidden:
            self.flow = self._solver.between(self._gray, gray, wide, shift)
        if self._kept is not None:
            self._kept.add(self.flow, wide, shift)
        self._progress.check()
        carried, where = self._carry(shift, margin)
        found = self._silhouette(picture, carried, where)
        self._remember(picture, gray, shift, carried, found, where)
        mask = np.zeros(gray.shape, bool)
        if not self.hidden:
            paste(mask, found, where)
        self.mask = mask
        return mask

    def finished(self, picture: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """See `Follower.finished`."""
        return trimmed(picture, mask, self._plate) if self._trim and self._plate is not None else mask

    def state(self) -> dict[str, np.ndarray]:
        """See `Follower.state`."""
        return {
            "shape": self._shape,
            "shape_window": np.array(self._shape_window),
            "template": self._template,
            "velocity": self.velocity,
            "counts": np.array([self._steps, self._missed, self.hidden]),
        } | (self._kept.state() if self._kept is not None else {})

    def resume(self, picture: np.ndarray, mask: np.ndarray, state: dict[str, np.ndarray]) -> None:
        """See `Follower.resume`."""
        x0, y0, x1, y1 = (int(value) for value in state["shape_window"])
        steps, missed, hidden = (int(value) for value in state["counts"])
        self._shape, self._shape_window, self._template = state["shape"], (x0, y0, x1, y1), state["template"]
        self._steps, self._missed, self.hidden, self.velocity = steps, missed, hidden > 0, state["velocity"]
        self._gray, self.mask, self.flow = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), mask, None
        if self._kept is not None:
            self._kept.resume(state)

    def _changed(self, picture: np.ndarray) -> np.ndarray | None:
        """Evidence (H, W) float32 in 0..1 that a pixel is not background: 0.5 at five times the noise."""
        if self._plate is None or self._looks is None:
            return None
        return np.clip(self._plate.difference(picture) / (10.0 * self._plate.noise), 0.0, 1.0)

    def _search(self, picture: np.ndarray) -> np.ndarray:
        size = float(np.sqrt(self._shape.sum()))
        # Nothing is known of the first step; a small thing may leap several of its own widths, a large one only part of its own.
        reach = max(24.0, 4.0 * size if self._shape.sum() < SMALL else 0.7 * size) if self._steps == 0 else max(12.0, 0.5 * size)
        if self.hidden:
            reach = max(reach, 1.5 * size) * (1 + min(self._missed, 4))
        origin = (self._shape_window[0], self._shape_window[1])
        # A plate that holds only part of the object's path as clean would pull towards that part.
        clean = self._plate is not None and cut(self._plate.reliable, self._shape_window).mean() > 0.9
        changed = self._changed(picture) if clean else None
        return body_shift(self._template, self._shape, origin, picture, changed, self.velocity, min(reach, 200.0))

    def _carry(self, shift: np.ndarray, margin: int) -> tuple[np.ndarray, Window]:
        """The last silhouette moved by the flow (or the shift), in a window round its new place."""
        dx, dy = (int(value) for value in np.round(shift))
        x0, y0, x1, y1 = self._shape_window
        where = (x0 + dx - margin, y0 + dy - margin, x1 + dx + margin, y1 + dy + margin)
        carried = np.zeros((where[3] - where[1], where[2] - where[0]), np.uint8)
        if self.flow is None or self._shape.sum() < SMALL:
            carried[margin : margin + y1 - y0, margin : margin + x1 - x0] = self._shape
            return carried > 0, where
        rows, columns = np.nonzero(self._shape)
        motion = self.flow.over(self._shape_window)[self._shape]
        column = np.rint(motion[:, 0]).astype(np.int64) + columns + (x0 - where[0])
        row = np.rint(motion[:, 1]).astype(np.int64) + rows + (y0 - where[1])
        inside = (column >= 0) & (row >= 0) & (column < carried.shape[1]) & (row < carried.shape[0])
        carried[row[inside], column[inside]] = 1
        # Pixels drift apart where the object grows: close the gaps.
        carried = cv2.morphologyEx(carried, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        return cv2.morphologyEx(carried, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0, where

    def _silhouette(self, picture: np.ndarray, carried: np.ndarray, where: Window) -> np.ndarray:
        if not carried.any():
            return carried
        band = band_of(float(carried.sum()))
        # Farther away than three bands, no evidence outweighs the silhouette's.
        near = window_of(carried, int(3 * band) + FILTERS)
        around = within((near[0] + where[0], near[1] + where[1], near[2] + where[0], near[3] + where[1]), picture)
        found = np.zeros_like(carried)
        if around[0] < around[2] and around[1] < around[3]:
            near = (around[0] - where[0], around[1] - where[1], around[2] - where[0], around[3] - where[1])
            paste(found, self._cut_out(picture, cut(carried, near, cv2.BORDER_CONSTANT), around, band), near)
        return found

    def _cut_out(self, picture: np.ndarray, carried: np.ndarray, where: Window, band: float) -> np.ndarray:
        crop = cut(picture, where)
        odds = against_shape(carried, band)
        colors = self._colors.odds(crop)
        if self._plate is None or self._looks is None:
            odds = np.minimum(odds, CARRIED_BLIND) + colors
        else:
            behind, known = against_plate(picture, self._plate, where, self._looks)
            odds = np.where(known, np.minimum(odds, CARRIED) + behind + BESIDE_PLATE * colors, np.minimum(odds, CARRIED_BLIND) + colors)
        return tidy(cut_out(odds, crop), carried)

    def _remember(
        self, picture: np.ndarray, gray: np.ndarray, shift: np.ndarray, carried: np.ndarray, found: np.ndarray, where: Window
    ) -> None:
        area = float(found.sum())
        self.hidden = area < max(LOST * carried.sum(), min(LEAST_PIXELS, 0.5 * carried.sum()))
        self._missed = self._missed + 1 if self.hidden else 0
        self._gray = gray
        self._steps += 1
        if self.hidden or (self._shape.sum() < SMALL and area < PARTLY * self._shape.sum()):
            # The last full sight moves on: by the velocity when nothing was seen, by the search when something was.
            x0, y0, x1, y1 = self._shape_window
            dx, dy = (int(value) for value in np.round(self.velocity if self._steps > 1 else shift))
            self._shape_window = (x0 + dx, y0 + dy, x1 + dx, y1 + dy)
            return
        self.velocity = (middle_of(found) + where[:2]) - (middle_of(self._shape) + self._shape_window[:2])
        local = window_of(found, 0)
        self._shape_window = (local[0] + where[0], local[1] + where[1], local[2] + where[0], local[3] + where[1])
        self._shape = cut(found, local)
        self._template = cut(picture, self._shape_window).copy()


def followed(
    picture: Callable[[int], np.ndarray],
    count: int,
    follower: Follower,
    progress: Progress,
    loop: Loop,
    points: Generations | None = None,
) -> Masks:
    """The masks (T+1, H, W) of `count` frames, all False where the object is hidden or gone.

    Args:
        picture: (H, W, 3) uint8 RGB by its number from 0 to T; follower: at frame 0.
        points: advanced behind the follower, so that a large clip is read once; on another core, while it looks at the next frame.
    """
    packing = Packing()
    packing.add(follower.mask)
    done, kept = loop.resume()
    if done:
        masks = from_arrays(Masks, kept, "masks.")
        packing = Packing(masks)
        follower.resume(picture(done), masks[done], kept)
        if points is not None:
            points.resume(picture, masks, kept)

    with ThreadPoolExecutor(1) as beside:
        behind: Future[None] | None = None

        def finish(now: np.ndarray, flow: Flow | None, found: np.ndarray) -> None:
            mask = follower.finished(now, found)
            packing.add(mask)
            if points is not None:
                points.advance(now, flow, mask)

        def state() -> dict[str, np.ndarray]:
            if behind is not None:
                behind.result()
            return to_arrays(packing.masks(), "masks.") | follower.state() | (points.state() if points is not None else {})

        for t in range(done + 1, count):
            progress.update(t / count, f"following the object, frame {t} of {count - 1}")
            now = picture(t)
            found = follower.advance(now)
            if behind is not None:
                behind.result()
            behind = beside.submit(finish, now, follower.flow, found)
            loop.reached(t, state)
        if behind is not None:
            behind.result()
    return packing.masks()
