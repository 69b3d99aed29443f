"""Tracks that begin later: when the object shows a side without tracks, new points are found there and followed from then on.

Every generation of points is anchored to the frame in which it began. Its places on the body of frame 0 are found once the body is known
(`observe/object/motion/late.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from ...masks import Masks
from ..mask.motion import Flow
from .tracker import MOST, Tracker, find_corners

BARE = 0.2
"""Fraction of the object without tracks from which new ones are sought."""

APART = 1.6
"""Radius of the disc that a track covers, in units of the mean distance between the first tracks."""

LEAST_NEW = 6
"""Least number of new points: fewer cannot check each other."""

SHORTEST = 4
"""Least number of frames in which a later track must be seen: fewer add nothing to the tracks before and after."""

MOST_LATE = 400
"""Largest number of later tracks: each costs the recovery time."""


@dataclass
class _Generation:
    first: int
    """The frame in which it began."""
    corners: np.ndarray
    """(K, 2) [px], its points in that frame."""
    tracker: Tracker
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    """Positions (K, 2) [px], visibility (K,) and sigma (K,) [px] in each frame since then."""


class Generations:
    """The tracked points: those of frame 0, and those that began later."""

    def __init__(self, frame: np.ndarray, mask: np.ndarray, corners: np.ndarray, *, reseed: bool) -> None:
        """`frame` (H, W, 3) uint8 RGB, `mask` (H, W) bool and `corners` (K, 2) [px] are frame 0's; `reseed`: later tracks may begin."""
        self._generations: list[_Generation] = []
        self._reseed = reseed
        self._count = 0
        self._late = 0
        self._apart = APART * float(np.sqrt(np.count_nonzero(mask) / max(len(corners), 1)))
        self._begin(frame, mask, corners)
        self._count = 1

    def advance(self, frame: np.ndarray, flow: Flow | None, mask: np.ndarray) -> None:
        """Follow all points into the next frame, see `Tracker.advance`; seek new ones where the object has none."""
        for one in self._generations:
            one.tracker.advance(frame, flow, mask)
            one.rows.append((one.tracker.xy, one.tracker.visible, one.tracker.sigma))
        if self._reseed and mask.any() and self._late < MOST_LATE:
            bare = self._bare(mask)
            share = float(np.count_nonzero(bare)) / float(np.count_nonzero(mask))
            if share > BARE:
                corners = find_corners(frame, bare, min(max(LEAST_NEW, round(share * MOST)), MOST_LATE - self._late))
                if len(corners) >= LEAST_NEW:
                    self._begin(frame, mask, corners)
                    self._late += len(corners)
        self._count += 1

    def _begin(self, frame: np.ndarray, mask: np.ndarray, corners: np.ndarray) -> None:
        tracker = Tracker(frame, mask, corners)
        self._generations.append(_Generation(self._count, corners, tracker, [(tracker.xy, tracker.visible, tracker.sigma)]))

    def state(self) -> dict[str, np.ndarray]:
        """All that later frames depend on, besides the frames and masks so far; and the tracks so far."""
        found = {"generations": np.array([one.first for one in self._generations])}
        for number, one in enumerate(self._generations):
            rows = dict(zip(("rows.xy", "rows.visible", "rows.sigma"), (np.stack(values) for values in zip(*one.rows))))
            parts = one.tracker.state() | rows | {"corners": one.corners}
            found |= {f"generation {number}.{key}": value for key, value in parts.items()}
        return found

    def resume(self, frame: Callable[[int], np.ndarray], masks: Masks, state: dict[str, np.ndarray]) -> None:
        """Continue after the last of `masks` as the object that returned `state` would have; `frame(t)`: frame t (H, W, 3) uint8 RGB."""
        self._generations.clear()
        for number, first in enumerate(state["generations"].tolist()):
            before = f"generation {number}."
            own = {key.removeprefix(before): value for key, value in state.items() if key.startswith(before)}
            self._count = first
            self._begin(frame(first), masks[first], own["corners"])
            begun = self._generations[-1]
            begun.tracker.resume(own)
            begun.rows = list(zip(own["rows.xy"], own["rows.visible"], own["rows.sigma"]))
        self._late = sum(len(one.corners) for one in self._generations[1:])
        self._count = len(masks)

    def _bare(self, mask: np.ndarray) -> np.ndarray:
        """The part (H, W) bool of the object `mask` (H, W) bool that has no track near it."""
        covered = np.zeros(mask.shape, np.uint8)
        for one in self._generations:
            for at in np.rint(one.tracker.xy[one.tracker.visible]).astype(int).tolist():
                cv2.circle(covered, at, max(2, round(self._apart)), 1, -1)
        return mask & (covered == 0)

    def tracks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """xy (T+1, K, 2) [px], visible (T+1, K) bool and sigma (T+1, K) [px]; the points of frame 0 come first."""
        columns = []
        for one in self._generations:
            xy, visible, sigma = (np.stack(values) for values in zip(*one.rows))
            use = np.ones(visible.shape[1], bool) if one.first == 0 else visible.sum(axis=0) >= SHORTEST
            # Before its first frame a point has no place; repeating the first place keeps arithmetic on whole arrays finite.
            before = np.zeros((one.first, int(use.sum())), bool)
            columns.append(
                (
                    np.concatenate([np.repeat(xy[:1, use], one.first, axis=0), xy[:, use]]),
                    np.concatenate([before, visible[:, use]]),
                    np.concatenate([np.repeat(sigma[:1, use], one.first, axis=0), sigma[:, use]]),
                )
            )
        return tuple(np.concatenate(parts, axis=1) for parts in zip(*columns))  # type: ignore[return-value]
