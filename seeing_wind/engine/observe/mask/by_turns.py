"""The outline of frame 0 and the background, found by turns: knowing either helps to find the other."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from ...masks import Masks, areas
from ...progress import Journal, Progress
from ...settings import ObserveSettings
from ..clip.stored import Frames, some_of
from .background import Plate, plate_behind, plate_with_first
from .evidence import Contrast
from .follow import MaskFollower, Surroundings
from .from_box import better_drawn, by_colors, refined
from .motion import window_of, within
from .moving.in_box import NEARBY, Moving, change_odds
from .moving.others import beyond_box
from .rim import cut_back, without_cut_parts
from .through import follow_clip

ROUGH_PIXELS = 40_000
"""Area of the object's bounding box [px] beyond which the rough follow, which finds the background, runs on smaller frames."""

LEARNT = 9
"""Frames, spread over the clip, from which the contrast between object and background is learnt."""


def sought_in_box(settings: ObserveSettings) -> bool:
    """Whether the outline is sought in a box (the user's, or one round the outline of a later frame), not given or cut out by a network."""
    return settings.box is not None and settings.mask is None and settings.mask_model is None


def with_background(
    frames: Frames,
    mask: np.ndarray,
    plate: Plate,
    moving: Moving,
    settings: ObserveSettings,
    around: np.ndarray,
    progress: Progress,
    journal: Journal,
) -> tuple[np.ndarray, Surroundings]:
    """The mask (H, W) bool of frame 0 and its surroundings, each refined with the other: where the roughly followed object moves away, it
    uncovers the background.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; mask: (H, W) bool, the object in frame 0; plate: the background; moving: see `moving_from`.
        around: (H, W) bool, where the object is according to the user's mask, box or points.
    """
    boxed, contrast, other = sought_in_box(settings), None, np.zeros_like(mask)
    behind = plate_with_first(plate, frames, mask, around if settings.box is not None else mask)
    if boxed:
        mask, other = _again(frames[0], mask, behind, contrast, around, moving)
    if settings.mask_model:
        return mask, Surroundings(behind, contrast, other)
    with ThreadPoolExecutor(1) as beside:
        colored = beside.submit(by_colors, frames[0], around, progress) if boxed else None
        masks = _roughly(frames, mask, other, behind, progress, journal)
    if areas(masks)[1:].any():
        behind = plate_behind(frames, masks, behind, plate.color, progress)
        seen = np.flatnonzero(areas(masks))
        contrast = Contrast(behind, ((frames[int(t)], masks[int(t)]) for t in seen[some_of(len(seen), LEARNT)]))
    if colored is not None:
        mask, other = _again(frames[0], mask, behind, contrast, around, moving)
        still = change_odds(frames[0], plate, moving, within(window_of(around, NEARBY), mask)) < 0.0
        mask = better_drawn(frames[0], cut_back(frames[0], mask, behind, progress) & around, colored.result(), around, still)
    return mask, Surroundings(behind, contrast, other)


def _again(
    frame: np.ndarray, mask: np.ndarray, plate: Plate, contrast: Contrast | None, around: np.ndarray, moving: Moving
) -> tuple[np.ndarray, np.ndarray]:
    """The object (H, W) bool in `frame`, which is frame 0, found again from `mask` (H, W) bool now that the background is known, inside the
    box `around` (H, W) bool; and (H, W) bool, another thing that moves along with the object."""
    other = beyond_box(frame, mask, around, plate, moving)
    return without_cut_parts(frame, refined(frame, mask & ~other, plate, around, moving, other, contrast), around, plate), other


def _roughly(
    frames: Frames, mask: np.ndarray, other: np.ndarray, plate: Plate, progress: Progress, journal: Journal
) -> Masks:
    """Masks (T+1, H, W) good enough to find what is behind the object; a large object is followed in smaller frames."""
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
    follower = MaskFollower(small(frames[0]), first, Surroundings(behind, other=along), progress, trim=False)
    found = follow_clip(lambda t: small(frames[t]), len(frames), follower, progress.part(0.1, 0.3), journal.loop("follow roughly"))
    return found if scale == 1.0 else Masks.of(large(found[t]) if t else mask for t in range(len(found)))
