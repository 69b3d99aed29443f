"""What is behind the object where the camera stands still: the temporal median, and where that median can be trusted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property

import cv2
import numpy as np

from ...masks import Masks, box_of, rows_columns
from ...progress import Progress
from ..clip.stored import Frames, some_of
from .cutting import enclosed, grown, opened
from .motion import Window, cut, passed, within

GRAIN = 0.8
"""Standard deviation of the blur [px] that averages grain out before a frame is compared."""

STEADY = 5.0
"""Median absolute deviation (grey levels) up to which a pixel's temporal median is taken for the background's colour."""

SHADOW_TINT = 0.07
"""Relative difference between the channels' darkening up to which it is a shadow: sky light tints shadows a little."""

STEADY_PART = 0.5
"""Part of the sights of the background that must agree."""

SHADOW_SOFT = 0.05
"""Relative change of light over three pixels up to which it is a shadow's."""

SHADOW = (0.4, 2.5)
"""Factors of light between which a shadow may come or go."""

FIRST_SIGHTS = 3
"""Frames that must agree with frame 0 on what is behind the object where the median does not."""

SIGHTS = 3
"""Sights of a pixel of the background: the least of which a median can drop one that is wrong."""

LONGEST_MEDIAN = 31
"""Frames that enter a temporal median, spread over the clip: more cost memory and change nothing."""


@dataclass(frozen=True)
class Plate:
    """The background seen by a camera that stands still."""

    color: np.ndarray
    """(H, W, 3) uint8 RGB, temporal median."""
    reliable: np.ndarray
    """(H, W) bool: the median is the background here, not an object that stays."""
    noise: float
    """Typical difference between a frame and the plate where nothing moves, largest channel [grey levels]."""

    @cached_property
    def _smooth(self) -> np.ndarray:
        """`color` without its grain, blurred once for all frames that are compared with it."""
        return cv2.GaussianBlur(self.color, (0, 0), 1.0)

    def compared(self, frame: np.ndarray, window: Window) -> tuple[np.ndarray, np.ndarray]:
        """How `frame` (H, W, 3) differs from the background in `window`, also where that is not reliable, grain averaged out first.

        Returns:
            (h, w) float32: the largest difference of a channel [grey levels]; (h, w) int8: 1 where the plate is brighter by one factor in
            all channels, a shadow that went, -1 where it is darker, one that came, else 0.
        """
        now, behind = cv2.GaussianBlur(cut(frame, window), (0, 0), 1.0), cut(self._smooth, window)
        away = largest(cv2.absdiff(now, behind)).astype(np.float32)
        # Channel by channel: planes stay in the processor's cache.
        light, shade = ([one + np.float32(4.0) for one in cv2.split(frame)] for frame in (now, behind))
        ratios = [above / below for above, below in zip(light, shade)]
        middle = (ratios[0] + ratios[1] + ratios[2]) * np.float32(1.0 / 3.0)
        # In the dark, a codec's rounding tints as much as a colour does.
        grain = np.float32(0.6 * self.noise) / cv2.min(cv2.min(shade[0], shade[1]), shade[2])
        apart = [cv2.absdiff(one, middle) for one in ratios]
        alike = cv2.max(cv2.max(apart[0], apart[1]), apart[2]) < np.float32(0.5 * SHADOW_TINT) * middle + grain
        # A shadow is soft and lets through what is behind it; a gray thing's own pattern and edges are neither.
        alike &= cv2.absdiff(middle, cv2.GaussianBlur(middle, (0, 0), 3.0)) < np.float32(SHADOW_SOFT) + grain
        alike &= cut(self.reliable, window, cv2.BORDER_CONSTANT) & (middle > SHADOW[0]) & (middle < SHADOW[1])
        return away, alike.view(np.int8) - np.int8(2) * (alike & (middle < 1.0)).view(np.int8)


def largest(frame: np.ndarray) -> np.ndarray:
    """The largest of three channels (H, W, 3) -> (H, W); NumPy is twenty times slower over so short an axis."""
    first, second, third = cv2.split(frame)
    return cv2.max(cv2.max(first, second), third)


def median_plate(frames: Frames, progress: Progress) -> Plate:
    """The temporal median of `frames` (T+1, H, W, 3) uint8, trusted where half of the time stays close to it.

    Where most pixels do not, that is grain, and how close they stay is measured again as frames are compared: with grain averaged out.
    """
    color, spread = _median_and_spread(frames, progress, _as_it_is)
    if np.median(spread) > STEADY:
        color, spread = _median_and_spread(frames, progress, _grainless)
    steady = spread <= STEADY
    noise = 1.5 * float(np.median(spread[steady])) + 1.0 if steady.any() else STEADY
    return Plate(color, steady, noise)


def _median_and_spread(frames: Frames, progress: Progress, seen: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The temporal median (H, W, 3) and the median difference to it of frames as they are `seen` (H, W), both uint8."""
    chosen = some_of(len(frames), LONGEST_MEDIAN)
    color = np.empty(frames.shape[1:], np.uint8)
    spread = np.empty(frames.shape[1:3], np.uint8)
    for part in _row_blocks(color, len(chosen)):
        progress.check()
        block = np.stack([frames[t, part] for t in chosen])
        color[part] = _median(block)
        now, middle = np.stack([seen(one) for one in block]), seen(color[part])
        spread[part] = largest(_median(np.maximum(now, middle) - np.minimum(now, middle)))
    return color, spread


def _as_it_is(frame: np.ndarray) -> np.ndarray:
    return frame


def _grainless(frame: np.ndarray) -> np.ndarray:
    """A frame (H, W, 3) blurred over a pixel, as it is before it is compared with the plate: grain is averaged out."""
    return cv2.GaussianBlur(frame, (0, 0), GRAIN)


def _row_blocks(frame: np.ndarray, count: int) -> Iterator[slice]:
    """Rows of `frame` (H, W, 3) in blocks of 2 MB over `count` frames: they bound the memory and keep the safe points close together."""
    rows = max(1, int(2e6 // max(1, count * frame[0].size)))
    return (slice(top, min(top + rows, len(frame))) for top in range(0, len(frame), rows))


def _median(block: np.ndarray) -> np.ndarray:
    """The lower median over the first axis of a uint8 array."""
    middle = (len(block) - 1) // 2
    return _ordered(block, middle, middle)[middle]


def _ordered(block: np.ndarray, low: int, high: int) -> list[np.ndarray]:
    """A uint8 array's planes along its first axis, those from `low` to `high` sorted, by a network: whole planes are compared."""
    planes, spare = [plane.copy() for plane in block], np.empty_like(block[0])
    for one, other in _exchanges(len(block), low, high):
        np.minimum(planes[one], planes[other], out=spare)
        np.maximum(planes[one], planes[other], out=planes[other])
        planes[one], spare = spare, planes[one]
    return planes


@cache
def _exchanges(count: int, first: int, last: int) -> list[tuple[int, int]]:
    """Pairs (low, high) of places to be put in order, one after the other, so that of `count` values `first` to `last` are in their places.

    Those of Batcher's odd-even mergesort (Batcher 1968; Knuth, volume 3, 5.2.2, algorithm M) on which those places depend.
    """
    pairs, run = list[tuple[int, int]](), 1
    while run < count:
        apart = run
        while apart >= 1:
            for start in range(apart % run, count - apart, 2 * apart):
                together = (low for low in range(start, min(start + apart, count - apart)))
                pairs += [(low, low + apart) for low in together if low // (2 * run) == (low + apart) // (2 * run)]
            apart //= 2
        run *= 2
    needed, kept = {*range(first, last + 1)}, list[tuple[int, int]]()
    for pair in reversed(pairs):
        if needed & {*pair}:
            needed |= {*pair}
            kept.append(pair)
    return kept[::-1]


def seen_first(plate: Plate, frames: Frames, mask: np.ndarray, around: np.ndarray) -> Plate:
    """The plate put right by frame 0, which shows the background wherever the object cannot be: what the median shows instead passes.

    Where the object is, the median is trusted only if frame 0 differs from it, so that the object has left: a pole's foot, or a leaf
    before it falls, is no background. Beside it, where it may be, the median is trusted only if frame 0 shows the same.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; mask: (H, W) bool, the object in frame 0; around: (H, W) bool, where it may be.
    """
    chosen = some_of(len(frames), LONGEST_MEDIAN)
    away = largest(_grainless(cv2.absdiff(np.array(frames[0]), plate.color))) > 4.0 * plate.noise
    stayed = grown(opened(~away & mask))
    doubtful = (away | ~plate.reliable) & ~grown(mask) & ~around
    plate = Plate(plate.color, plate.reliable & ~(around & ~mask & away), plate.noise)
    color, reliable = plate.color, plate.reliable & ~stayed
    if doubtful.any():
        part = rows_columns(box_of(doubtful))
        first = np.array(frames[0][part])
        agree = np.zeros(first.shape[:2], np.int32)
        for t in chosen:
            agree += largest(cv2.absdiff(np.ascontiguousarray(frames[int(t)][part]), first)) < 5.0 * plate.noise
        seen = doubtful[part] & (agree >= FIRST_SIGHTS)
        color, reliable = color.copy(), reliable.copy()
        color[part] = np.where(seen[..., None], cv2.GaussianBlur(first, (0, 0), 0.7), color[part])
        reliable[part] = np.where(doubtful[part], seen, reliable[part])
    return Plate(color, reliable, plate.noise)


def plate_behind(frames: Frames, masks: Masks, before: Plate, median: np.ndarray, progress: Progress) -> Plate:
    """A better plate once the object's `masks` (T+1, H, W) are known: trusted where the object ever leaves and what is seen then agrees."""
    color = clean_plate(frames, masks, median, progress)
    x0, y0, x1, y1 = within(passed(masks, 4), color)
    part = np.s_[y0:y1, x0:x1]
    # Once for what lies outside the silhouette, once for what lies outside the whole of it.
    leaves, agree = np.zeros((2, 2, y1 - y0, x1 - x0), np.int32)
    for t, mask in enumerate(masks):
        progress.check()
        off = np.stack([~grown(mask[part]), ~grown(enclosed(mask[part]))])
        leaves += off
        agree += off & (largest(cv2.absdiff(frames[t, y0:y1][:, x0:x1], color[part])) < 4.0 * before.noise)
    clear = leaves[1] >= SIGHTS
    leaves, agree = np.where(clear, leaves[1], leaves[0]), np.where(clear, agree[1], agree[0])
    # Where the sights do not agree, the object was missed.
    steady, reliable = (leaves >= SIGHTS) & (agree > STEADY_PART * leaves), before.reliable.copy()
    reliable[part] = np.where(leaves < len(masks), steady, reliable[part])
    return Plate(color, reliable, before.noise)


def clean_plate(frames: Frames, masks: Masks, median: np.ndarray | None, progress: Progress) -> np.ndarray:
    """The clip without the object, (H, W, 3) uint8 RGB.

    Where the camera stands still, `median` (H, W, 3) is that of `median_plate`, and where the object comes, the median over the frames
    in which a pixel is off its (slightly grown) hull, or off the object itself where those are too few. A moving camera, without `median`:
    frame 0. Pixels that the object never leaves are inpainted (Telea 2004).
    """
    if median is None:
        return cv2.inpaint(frames[0], grown(masks[0]).astype(np.uint8), 5, cv2.INPAINT_TELEA)
    chosen = some_of(len(frames), LONGEST_MEDIAN)
    color = median.copy()
    if not masks.windows[chosen].any():
        return color
    x0, top, x1, bottom = within(passed(masks, 4), color)
    window = np.s_[top:bottom, x0:x1]
    covered = np.stack([grown(masks[t][window]) for t in chosen])
    whole = np.stack([grown(enclosed(masks[t][window])) for t in chosen])
    covered = np.where((~whole).sum(axis=0) >= SIGHTS, whole, covered)
    ever, inside = covered.any(axis=0), color[window]
    for rows in _row_blocks(inside, len(chosen)):
        progress.check()
        sights = np.stack([frames[int(t), top + rows.start : top + rows.stop][:, x0:x1] for t in chosen])
        inside[rows] = np.where(ever[rows][..., None], _masked_median(sights, covered[:, rows]), inside[rows])
    never = np.zeros(color.shape[:2], np.uint8)
    never[window] = covered.all(axis=0)
    progress.check()
    return cv2.inpaint(color, never, 5, cv2.INPAINT_TELEA) if never.any() else color


def _masked_median(block: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Median over the first axis of `block` (F, R, W, 3) where not `covered` (F, R, W); 0 where covered throughout."""
    # Covered samples, made white, sort to the end, so the median is the middle of the first `seen` ones.
    ordered, seen = np.stack(_ordered(np.where(covered[..., None], np.uint8(255), block), 0, len(block) // 2)), (~covered).sum(axis=0)
    low, high = np.maximum((seen - 1) // 2, 0), seen // 2
    pick = [np.take_along_axis(ordered, index[None, ..., None], axis=0)[0].astype(np.int16) for index in (low, high)]
    return np.where(seen[..., None] > 0, (pick[0] + pick[1]) // 2, 0).astype(np.uint8)
