"""What rests in the first frames and moves later, possibly shaded or hidden by the hand that pushes it."""

from __future__ import annotations

import cv2
import numpy as np

from ....progress import Progress
from ...clip.stored import Frames
from ..background import SHADOW, largest
from ..motion import Window
from .soon import LEAST_MOTION, flow_and_back, odds_of, places, shrunk

OFTEN = 0.3
"""Number of frames in which a pixel must be seen away from its place, as a fraction of the largest such number: something that passes in
front of a still pixel seems to drag it along, but for a few frames only."""

LIGHT = 3.0
"""Standard deviation of the blur [px] over which the light may change by one factor: a hand that comes to push the object shades it."""

RETURNS = (0.01, 2.0)
"""Tolerance of the squared forward-backward error of the flow (Sundaram 2010): as a fraction of the squared lengths, and in squared pixels;
the error is larger where a pixel gets hidden."""


def moved_later(frames: Frames, window: Window, noise: float, progress: Progress) -> np.ndarray:
    """Log odds (h, w) in `window` that a pixel of frame 0 moves away in any later frame, in front of a background that stands still.

    Flow from frame to frame is accumulated until the forward-backward check fails, that is until the pixel is hidden. The motion is
    believed where the pixel at its end looks like that of frame 0 up to a change of light, and the one at the original place does not. A
    pixel that never differs from frame 0 stands still.
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
    """Difference (h, w) float32 [grey levels] between `crop` and `first`, both (h, w, 3), after the best local change of light."""
    now, then = crop.astype(np.float32), first.astype(np.float32)
    both, own = (cv2.GaussianBlur(cv2.transform(one, np.ones((1, 3), np.float32)), (0, 0), LIGHT) for one in (now * then, now * now))
    gain = np.clip((both + 1.0) / (own + 1.0), *SHADOW)
    return largest(cv2.GaussianBlur(np.abs(gain[..., None] * now - then), (0, 0), 1.0))
