"""What moves in the first frames: dense flow from frame 0 to some of the next."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from ...clip.stored import Frames
from ..background import largest
from ..motion import Window, cut

LATER = (1, 2, 3, 5, 8, 12, 17, 23)
"""Frames whose motion relative to frame 0 is examined."""

CORES = 2
"""Frames examined in parallel: every machine has two cores, and OpenCV lets Python's other threads run while it works."""

MOTION_PIXELS = 150_000
"""Area of a window [px] beyond which its motion is sought in a smaller copy."""

LEAST_MOTION = 1.0
"""Distance [px] from which a pixel counts as moving: the flow of a still background is wrong by less, through its texture and grain."""

MOTION_SURE = 2.0
"""Log odds that motion, or the lack of it, gives."""


def moving_odds(frames: Frames, window: Window, noise: float) -> np.ndarray:
    """Log odds (h, w) in `window` that a pixel of frame 0 moves in the next frames, in front of a background that stands still.

    Dense flow (Kroeger 2016) to some of the next frames is believed where the backward flow returns to its start and the motion explains
    the pixel better than standing still does. A pixel that differs from frame 0 in none of them stands still.
    """
    size, scale, seen = shrunk(frames, window)
    first = seen(0)
    gray = cv2.cvtColor(first, cv2.COLOR_RGB2GRAY)
    grid = places(gray)

    def looked_at(crop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far each pixel moves, 0 where that is not certain, (h, w) float32 [px]; and whether it changes, (h, w) bool."""
        there, _, missed = flow_and_back(gray, cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY), grid)
        flown = cv2.remap(crop, grid + there, None, cv2.INTER_LINEAR)
        still, left = (largest(cv2.GaussianBlur(cv2.absdiff(one, first).astype(np.float32), (0, 0), 1.0)) for one in (crop, flown))
        sure = (cv2.magnitude(*cv2.split(missed)) < 1.0) & (left < still - 1.5 * noise) & (left < 8.0 * noise)
        return np.where(sure, cv2.magnitude(*cv2.split(there)), np.float32(0.0)), still > 6.0 * noise

    moved, changed = np.zeros(gray.shape, np.float32), np.zeros(gray.shape, np.int32)
    with ThreadPoolExecutor(CORES) as cores:
        for far, differs in cores.map(looked_at, (seen(t) for t in LATER if t < len(frames))):
            moved, changed = np.maximum(moved, far), changed + differs
    return odds_of(moved > LEAST_MOTION * scale, changed, size)


def places(frame: np.ndarray) -> np.ndarray:
    """The pixel coordinates x, y (h, w, 2) float32 of `frame` (h, w, ...)."""
    return np.stack(np.meshgrid(*(np.arange(side, dtype=np.float32) for side in frame.shape[1::-1])), axis=-1)


def flow_and_back(before: np.ndarray, after: np.ndarray, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Dense flow (Kroeger 2016) from the grey frame `before` to `after`, both (h, w) uint8, the backward flow from where it leads, and the
    sum of both, the forward-backward error; each (h, w, 2) float32 [px]. `grid`: `places(before)`."""
    there, back = (
        cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(*pair, None) for pair in ((before, after), (after, before))
    )
    returned = cv2.remap(back, grid + there, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return there, returned, there + returned


def shrunk(frames: Frames, window: Window) -> tuple[tuple[int, int], float, Callable[[int], np.ndarray]]:
    """Width and height of `window` [px], the factor that shrinks it to at most `MOTION_PIXELS`, and a function that returns frame t in it,
    shrunk, (h, w, 3) uint8."""
    size = window[2] - window[0], window[3] - window[1]
    scale = min(1.0, float(np.sqrt(MOTION_PIXELS / (size[0] * size[1]))))
    small = max(8, round(size[0] * scale)), max(8, round(size[1] * scale))

    def seen(t: int) -> np.ndarray:
        return cv2.resize(cut(frames[t], window), small, interpolation=cv2.INTER_AREA) if scale < 1.0 else cut(frames[t], window)

    return size, scale, seen


def odds_of(moved: np.ndarray, changed: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Log odds of motion, resized to `size` (width, height) [px]: for it where enough of a pixel's neighbourhood has `moved` (h, w) bool,
    against it where hardly any has and the pixel has `changed` in no frame; `changed`: (h, w), in how many frames it has."""
    across = max(3, int(0.04 * min(moved.shape))) | 1
    share = cv2.blur(moved.astype(np.float32), (across, across))
    odds = np.where(share > 0.4, MOTION_SURE, np.where((changed == 0) & (share < 0.1), -MOTION_SURE, 0.0)).astype(np.float32)
    return odds if odds.shape == size[::-1] else cv2.resize(odds, size, interpolation=cv2.INTER_LINEAR)
