"""The masks of a whole clip, frame by frame, from a follower of the object."""

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
"""Number of masks finished in parallel, and how many frames the follower may be ahead of the points, which take the frames in order."""


class Follower(Protocol):
    """Finds the object in one frame after the other."""

    mask: np.ndarray
    """(H, W) bool, of the newest frame."""
    flow: Flow | None
    """Motion from the frame before to the newest one; None if the object was hidden before, and possibly if it is hidden now."""

    def advance(self, frame: np.ndarray) -> np.ndarray:
        """The mask (H, W) bool of the next `frame` (H, W, 3) uint8 RGB; all False when the object is hidden or gone."""

    def finished(self, frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """The final mask (H, W) bool for the `mask` that `advance` returned for `frame`. Later frames do not depend on it, so it may run in
        another thread."""

    def state(self) -> dict[str, np.ndarray]:
        """All that later frames depend on, besides the newest frame and its mask."""

    def resume(self, frame: np.ndarray, mask: np.ndarray, state: dict[str, np.ndarray]) -> None:
        """Continue after `frame` and its `mask` as the follower that returned `state` would have."""


def follow_clip(
    frame: Callable[[int], np.ndarray],
    count: int,
    follower: Follower,
    progress: Progress,
    loop: Loop,
    points: Generations | None = None,
) -> Masks:
    """The masks (T+1, H, W) of `count` frames, all False where the object is hidden or gone.

    Args:
        frame: returns frame t, (H, W, 3) uint8 RGB, for t from 0 to T; follower: at frame 0.
        points: tracked points, advanced behind the follower so that a large clip is read only once; on another core, while the follower
            looks at later frames.
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
            """Block until at most `most` frames wait to be handed on."""
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
