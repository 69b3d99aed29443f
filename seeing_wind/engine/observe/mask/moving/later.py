"""What rests in the first frames and moves later on, in the shade of the hand that pushes it or behind it."""

from __future__ import annotations

import cv2
import numpy as np

from ....progress import Progress
from ...clip.stored import Frames
from ..background import SHADOW, largest
from ..motion import Window
from .soon import LEAST_MOTION, flow_and_back, odds_of, places, shrunk

OFTEN = 0.3
"""Part of the frames in which most of the object is seen away from its place, in which a pixel has to be, too: what passes before a still
thing carries it along for a few."""

LIGHT = 3.0
"""Standard deviation of the blur [px] over which one change of light is allowed: a hand that comes to push the object
puts it in the shade."""

RETURNS = (0.01, 2.0)
"""Part of the squared length of flow there and back, and squared pixels, by which both may miss each other (Sundaram 2010): what is hidden
misses more."""


def moved_later(frames: Frames, window: Window, noise: float, progress: Progress) -> np.ndarray:
    """Log odds (h, w) in `window` by what frame 0 shows there moving away in any frame, before a background that stands still.

    Flow from frame to frame is added up until it does not return, that is until the pixel is hidden. It is believed where what lies at its
    end is like frame 0, but for a change of light, and what lies at the pixel's own place is not. What never differs stands still.
    """
    size, scale, seen = shrunk(frames, window)
    first = seen(0)
    before = cv2.cvtColor(first, cv2.COLOR_RGB2GRAY)
    grid = places(before)
    way, shown = np.zeros_like(grid), np.ones(before.shape, bool)
    moved, changed = np.zeros((2, *before.shape), np.int32)
    for t in range(1, len(frames)):
        progress.check()
        now = seen(t)
        still = unlike(now, first)
        changed += still > 6.0 * noise
        after = cv2.cvtColor(now, cv2.COLOR_RGB2GRAY)
        step, back, missed = flow_and_back(before, after, grid)
        long = np.sum(step**2 + back**2, axis=-1)
        astray = (np.sum(missed**2, axis=-1) > RETURNS[0] * long + RETURNS[1]).astype(np.float32)
        shown &= cv2.remap(astray, grid + way, None, cv2.INTER_LINEAR, borderValue=1.0) < 0.5
        way += cv2.remap(step, grid + way, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        left = unlike(cv2.remap(now, grid + way, None, cv2.INTER_LINEAR), first)
        far = cv2.magnitude(*cv2.split(way)) > LEAST_MOTION * scale
        moved += shown & far & (left < 0.5 * still) & (still > 6.0 * noise)
        before = after
    often = moved >= max(2.0, OFTEN * float(moved.max(initial=0)))
    return odds_of(often, changed, size)


def unlike(crop: np.ndarray, first: np.ndarray) -> np.ndarray:
    """How `crop` (h, w, 3) differs from `first` but for a change of light (h, w) float32 [grey levels]."""
    now, then = crop.astype(np.float32), first.astype(np.float32)
    both, own = (cv2.GaussianBlur(cv2.transform(one, np.ones((1, 3), np.float32)), (0, 0), LIGHT) for one in (now * then, now * now))
    gain = np.clip((both + 1.0) / (own + 1.0), *SHADOW)
    return largest(cv2.GaussianBlur(np.abs(gain[..., None] * now - then), (0, 0), 1.0))
