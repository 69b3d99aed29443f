"""The masks of a whole clip, one frame after the other, by something that follows the object."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ...masks import Masks, Packing
from ...progress import Loop, Progress
from ...record_arrays import from_arrays, to_arrays
from .motion import Flow

if TYPE_CHECKING:
    from ..tracks.reseed import Generations

FINISHING, AHEAD = 2, 4
"""Masks that are finished at once, and frames that the follower may be ahead of the points, which take them in order."""


class Follower(Protocol):
    """What knows where the object is in one frame after the other. `flow` leads to the newest, None where it is hidden in either."""

    mask: np.ndarray
    flow: Flow | None

    def advance(self, frame: np.ndarray) -> np.ndarray:
        """The mask (H, W) bool of the next `frame` (H, W, 3) uint8 RGB; all False when the object is hidden or gone."""

    def finished(self, frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """The `mask` that `advance` gave for `frame`, as it is handed on. Nothing of what follows depends on it, so it may run beside."""

    def state(self) -> dict[str, np.ndarray]:
        """All that the frames to come depend on, besides the newest frame and its mask."""

    def resume(self, frame: np.ndarray, mask: np.ndarray, state: dict[str, np.ndarray]) -> None:
        """Go on behind `frame` with its `mask`, as what gave `state` would have."""


def followed(
    frame: Callable[[int], np.ndarray],
    count: int,
    follower: Follower,
    progress: Progress,
    loop: Loop,
    points: Generations | None = None,
) -> Masks:
    """The masks (T+1, H, W) of `count` frames, all False where the object is hidden or gone.

    Args:
        frame: (H, W, 3) uint8 RGB by its number from 0 to T; follower: at frame 0.
        points: advanced behind the follower, so that a large clip is read once; on another core, while it looks at the frames to come.
    """
    packing = Packing()
    packing.add(follower.mask)
    done, kept = loop.resume()
    if done:
        masks = from_arrays(Masks, kept, "masks.")
        packing = Packing(masks)
        follower.resume(frame(done), masks[done], kept)
        if points is not None:
            points.resume(frame, masks, kept)

    with ThreadPoolExecutor(FINISHING) as finishing, ThreadPoolExecutor(1) as behind:
        waiting: deque[Future[None]] = deque()

        def hand_on(now: np.ndarray, flow: Flow | None, finished: Future[np.ndarray]) -> None:
            mask = finished.result()
            packing.add(mask)
            if points is not None:
                points.advance(now, flow, mask)

        def wait_for(most: int) -> None:
            """Until at `most` so many frames wait to be handed on."""
            while len(waiting) > most:
                waiting.popleft().result()

        def state() -> dict[str, np.ndarray]:
            wait_for(0)
            return to_arrays(packing.masks(), "masks.") | follower.state() | (points.state() if points is not None else {})

        for t in range(done + 1, count):
            progress.update(t / count, f"following the object, frame {t} of {count - 1}")
            now = frame(t)
            finished = finishing.submit(follower.finished, now, follower.advance(now))
            waiting.append(behind.submit(hand_on, now, follower.flow, finished))
            wait_for(AHEAD)
            loop.reached(t, state)
        wait_for(0)
    return packing.masks()
