"""The outline of frame 0 and the background, found by turns: the one says where the other is."""

from __future__ import annotations

import cv2
import numpy as np

from ...masks import Masks, areas
from ...progress import Journal, Progress
from ...settings import ObserveSettings
from ..clip.stored import Frames
from .background import Plate, plate_behind, seen_first
from .evidence import Contrast
from .follow import MaskFollower
from .from_box import refined
from .motion import Flows, window_of, within
from .moving.in_box import NEARBY, Moving
from .rim import boxed_in, cut_back
from .through import followed
from .moving.others import beyond_box

ROUGH_PIXELS = 40_000
"""Pixels of the object's bounding box beyond which it is followed in smaller frames first, to see what is behind it."""

STAYED = 0.8
"""Part of the frames in which a pixel is the object's for it to be thought so in frame 0, too."""

LEARNT = 9
"""Frames over the clip from which it is learnt how the object differs from the background."""


def with_background(
    frames: Frames,
    mask: np.ndarray,
    plate: Plate,
    moving: Moving,
    settings: ObserveSettings,
    around: np.ndarray,
    progress: Progress,
    journal: Journal,
) -> tuple[np.ndarray, Plate, Contrast | None, Flows | None, np.ndarray]:
    """The outline of frame 0, the background, how the object differs from it, each found again by the others, how it moves, and what other
    thing moves along with it, see `veil.beyond_box`.

    The object, followed roughly, shows what is behind it.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; mask: (H, W) bool, the object in frame 0; plate: the background; moving: see `moving_from`.
        around: (H, W) bool, where a mask, box or points say that the object is.
    """
    boxed = settings.box is not None and settings.mask is None and settings.mask_model is None
    # What a box cut off of a small object was found outside it.
    allowed = around | (cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0 if (mask & ~around).any() else around)
    median = plate.color
    motion = moving(within(window_of(allowed, NEARBY), mask)) if boxed else None
    plate = seen_first(plate, frames, mask, around if settings.box is not None else mask)
    other = beyond_box(frames[0], mask, around, plate, moving) if boxed else np.zeros_like(mask)
    if motion is not None:
        mask = boxed_in(frames[0], refined(frames[0], mask & ~other, plate, allowed, motion, other), around, plate)
    contrast, flows, stayed = None, None, np.zeros_like(mask)
    if not settings.mask_model:
        masks, flows = _roughly(frames, mask, other, plate, progress, journal)
        if areas(masks)[1:].any():
            plate = plate_behind(frames, masks, plate, median, progress)
            seen = np.flatnonzero(areas(masks))
            some = seen[np.unique(np.linspace(0, len(seen) - 1, min(LEARNT, len(seen))).astype(int))]
            contrast = Contrast(plate, ((frames[int(t)], masks[int(t)]) for t in some))
            stayed = stays(frames[0], masks, Plate(median, np.ones_like(mask), plate.noise)) & allowed
    if motion is not None:
        other = beyond_box(frames[0], mask, around, plate, moving)
        found = refined(frames[0], mask | stayed, plate, allowed, motion, other, contrast)
        mask = cut_back(frames[0], boxed_in(frames[0], found, around, plate), plate)
    return mask, plate, contrast, flows, other


def stays(first: np.ndarray, masks: Masks, median: Plate) -> np.ndarray:
    """(H, W) bool: the object in most frames, and `first` shows the same there: a foot that hardly moves."""
    count = np.zeros(first.shape[:2], np.int32)
    for mask in masks:
        count += mask
    return (count > STAYED * len(masks)) & (median.difference(first) < 4.0 * median.noise)


def _roughly(
    frames: Frames, mask: np.ndarray, other: np.ndarray, plate: Plate, progress: Progress, journal: Journal
) -> tuple[Masks, Flows | None]:
    """Masks (T+1, H, W) good enough to show what is behind the object. A large one is followed in smaller frames, and its motion kept.

    That of a small object costs little, and is sought again where its outline is better known.
    """
    x0, y0, x1, y1 = window_of(mask, 0)
    # Halving is several times quicker than other factors.
    scale = 0.5 ** max(0, round(0.5 * np.log2((x1 - x0) * (y1 - y0) / ROUGH_PIXELS)))
    full = mask.shape[::-1]
    size = (round(full[0] * scale), round(full[1] * scale))

    def small(frame: np.ndarray) -> np.ndarray:
        return frame if scale == 1.0 else cv2.resize(frame, size, interpolation=cv2.INTER_AREA)

    def large(found: np.ndarray) -> np.ndarray:
        return cv2.resize(found.astype(np.uint8) * 255, full, interpolation=cv2.INTER_LINEAR) >= 128

    behind = Plate(small(plate.color), small(plate.reliable.astype(np.uint8) * 255) == 255, plate.noise)
    first, along = (small(one.astype(np.uint8) * 255) >= 128 for one in (mask, other))
    flows = None
    if scale < 1.0:
        flows = Flows(lambda t: cv2.cvtColor(small(frames[t]), cv2.COLOR_RGB2GRAY), (full[0] / size[0], full[1] / size[1]))
    follower = MaskFollower(small(frames[0]), first, behind, progress, kept=flows, other=along)
    found = followed(lambda t: small(frames[t]), len(frames), follower, progress.part(0.1, 0.3), journal.loop("follow roughly"))
    return (found if scale == 1.0 else Masks.of(large(found[t]) if t else mask for t in range(len(found)))), flows
