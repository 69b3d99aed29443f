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
from .motion import Window, cut, window_of_all, within

GRAIN = 0.8
"""Standard deviation of the blur [px] that averages out grain before a frame is compared."""

STEADY = 5.0
"""Median absolute deviation [grey levels] up to which a pixel's temporal median is taken for the background's colour."""

SHADOW_TINT = 0.07
"""Relative difference between the channels up to which a darkening counts as a shadow: sky light tints shadows a little."""

STEADY_PART = 0.5
"""Fraction of the frames that show the background at a pixel, which must agree on it."""

SHADOW_SOFT = 0.05
"""Relative change of brightness over three pixels up to which it can be a shadow's."""

SHADOW = (0.4, 2.5)
"""Range of the brightness ratio that a shadow can cause by coming or going."""

FIRST_SIGHTS = 3
"""Frames that must agree with frame 0 on the background where the median does not."""

SIGHTS = 3
"""Frames that must show the background at a pixel: the fewest whose median ignores one wrong value."""

LONGEST_MEDIAN = 31
"""Frames that enter a temporal median, spread over the clip: more would cost memory and change nothing."""


@dataclass(frozen=True)
class Plate:
    """The background as seen by a camera that stands still."""

    color: np.ndarray
    """(H, W, 3) uint8 RGB, temporal median."""
    reliable: np.ndarray
    """(H, W) bool: where `color` is the background, not an object that stays in place."""
    noise: float
    """Typical difference between a frame and the plate where nothing moves, in the channel where it is largest [grey levels]."""

    @cached_property
    def _smooth(self) -> np.ndarray:
        """`color` (H, W, 3) without its grain, blurred once for all frames that are compared with it."""
        return cv2.GaussianBlur(self.color, (0, 0), 1.0)

    def compared(self, frame: np.ndarray, window: Window) -> tuple[np.ndarray, np.ndarray]:
        """How `frame` (H, W, 3) differs from the background in `window`, after grain is averaged out; also where `reliable` is False.

        Returns:
            (h, w) float32, the largest difference over the channels [grey levels], and (h, w) int8, the change of light: 1 where the
            frame is brighter than the plate by the same factor in all channels (a shadow left), -1 where darker (a shadow came), else 0.
        """
        now, behind = cv2.GaussianBlur(cut(frame, window), (0, 0), 1.0), cut(self._smooth, window)
        away = largest(cv2.absdiff(now, behind)).astype(np.float32)
        # Channel by channel: planes stay in the processor's cache.
        light, shade = ([one + np.float32(4.0) for one in cv2.split(frame)] for frame in (now, behind))
        ratios = [above / below for above, below in zip(light, shade)]
        middle = (ratios[0] + ratios[1] + ratios[2]) * np.float32(1.0 / 3.0)
        # In the dark, a codec's rounding changes the tint as much as another colour would.
        grain = np.float32(0.6 * self.noise) / cv2.min(cv2.min(shade[0], shade[1]), shade[2])
        apart = [cv2.absdiff(one, middle) for one in ratios]
        alike = cv2.max(cv2.max(apart[0], apart[1]), apart[2]) < np.float32(0.5 * SHADOW_TINT) * middle + grain
        # A shadow has soft edges and lets the background show through; a grey object has sharp edges and a pattern of its own.
        alike &= cv2.absdiff(middle, cv2.GaussianBlur(middle, (0, 0), 3.0)) < np.float32(SHADOW_SOFT) + grain
        alike &= cut(self.reliable, window, cv2.BORDER_CONSTANT) & (middle > SHADOW[0]) & (middle < SHADOW[1])
        return away, alike.view(np.int8) - np.int8(2) * (alike & (middle < 1.0)).view(np.int8)


def largest(frame: np.ndarray) -> np.ndarray:
    """The largest of three channels, (H, W, 3) -> (H, W); NumPy is twenty times slower over so short an axis."""
    first, second, third = cv2.split(frame)
    return cv2.max(cv2.max(first, second), third)


def median_plate(frames: Frames, progress: Progress) -> Plate:
    """The temporal median of `frames` (T+1, H, W, 3) uint8, reliable where at least half of the frames stay close to it.

    If most pixels do not stay close, the cause is grain, and the spread is measured again with the grain averaged out, as it is when
    frames are compared with the plate.
    """
    color, spread = _median_and_spread(frames, progress, _as_it_is)
    if np.median(spread) > STEADY:
        color, spread = _median_and_spread(frames, progress, _grainless)
    steady = spread <= STEADY
    noise = 1.5 * float(np.median(spread[steady])) + 1.0 if steady.any() else STEADY
    return Plate(color, steady, noise)


def _median_and_spread(frames: Frames, progress: Progress, seen: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The temporal median (H, W, 3) and the frames' median difference from it (H, W), both uint8; `seen` filters both before that."""
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
    """`frame` (H, W, 3) blurred over about a pixel, which averages out its grain."""
    return cv2.GaussianBlur(frame, (0, 0), GRAIN)


def _row_blocks(frame: np.ndarray, count: int) -> Iterator[slice]:
    """Blocks of rows of `frame` (H, W, 3), 2 MB each over `count` frames: this bounds the memory and the time between safe points."""
    rows = max(1, int(2e6 // max(1, count * frame[0].size)))
    return (slice(top, min(top + rows, len(frame))) for top in range(0, len(frame), rows))


def _median(block: np.ndarray) -> np.ndarray:
    """The lower median over the first axis of a uint8 array."""
    middle = (len(block) - 1) // 2
    return _ordered(block, middle, middle)[middle]


def _ordered(block: np.ndarray, low: int, high: int) -> list[np.ndarray]:
    """The planes of a uint8 array along its first axis, with those from `low` to `high` in sorted order at each pixel.

    A sorting network, so that whole planes are compared at once.
    """
    planes, spare = [plane.copy() for plane in block], np.empty_like(block[0])
    for one, other in _exchanges(len(block), low, high):
        np.minimum(planes[one], planes[other], out=spare)
        np.maximum(planes[one], planes[other], out=planes[other])
        planes[one], spare = spare, planes[one]
    return planes


@cache
def _exchanges(count: int, first: int, last: int) -> list[tuple[int, int]]:
    """The compare-exchanges (low, high), in order, that bring the values of ranks `first` to `last` among `count` values into place.

    These are the exchanges of Batcher's odd-even mergesort (Batcher 1968; Knuth, volume 3, 5.2.2, algorithm M) that affect those ranks.
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


def plate_with_first(plate: Plate, frames: Frames, mask: np.ndarray, around: np.ndarray) -> Plate:
    """The plate corrected by frame 0, which shows the background wherever the object cannot be; if the median differs there, it shows
    something that passes.

    Inside the object, the median is trusted only where frame 0 differs from it, since only there the object has left: the foot of a pole,
    or a leaf before it falls, is not background. Beside the object but within `around`, it is trusted only where frame 0 agrees with it.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; mask: (H, W) bool, the object in frame 0; around: (H, W) bool, where the object may be.
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
    """A better plate once the object's `masks` (T+1, H, W) are known: reliable where the object leaves in some frames and these agree."""
    color = clean_plate(frames, masks, median, progress)
    x0, y0, x1, y1 = within(window_of_all(masks, 4), color)
    part = np.s_[y0:y1, x0:x1]
    # Counted twice: outside the silhouette, and outside its convex hull.
    leaves, agree = np.zeros((2, 2, y1 - y0, x1 - x0), np.int32)
    for t, mask in enumerate(masks):
        progress.check()
        off = np.stack([~grown(mask[part]), ~grown(enclosed(mask[part]))])
        leaves += off
        agree += off & (largest(cv2.absdiff(frames[t, y0:y1][:, x0:x1], color[part])) < 4.0 * before.noise)
    clear = leaves[1] >= SIGHTS
    leaves, agree = np.where(clear, leaves[1], leaves[0]), np.where(clear, agree[1], agree[0])
    # Where the frames do not agree, the mask missed the object in some.
    steady, reliable = (leaves >= SIGHTS) & (agree > STEADY_PART * leaves), before.reliable.copy()
    reliable[part] = np.where(leaves < len(masks), steady, reliable[part])
    return Plate(color, reliable, before.noise)


def clean_plate(frames: Frames, masks: Masks, median: np.ndarray | None, progress: Progress) -> np.ndarray:
    """The clip without the object, (H, W, 3) uint8 RGB.

    For a camera that stands still, `median` (H, W, 3) is the colour of `median_plate`. It is kept where the object never comes; elsewhere
    the result is the median over the frames in which the pixel lies outside the object's (slightly grown) hull, or outside the object
    itself if those are too few. For a moving camera, `median` is None and the result is frame 0. Pixels that the object never leaves are
    inpainted (Telea 2004).
    """
    if median is None:
        return cv2.inpaint(frames[0], grown(masks[0]).astype(np.uint8), 5, cv2.INPAINT_TELEA)
    chosen = some_of(len(frames), LONGEST_MEDIAN)
    color = median.copy()
    if not masks.windows[chosen].any():
        return color
    x0, top, x1, bottom = within(window_of_all(masks, 4), color)
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
    """Median over the first axis of `block` (F, R, W, 3) uint8, without the samples that are `covered` (F, R, W); 0 where all are."""
    # Covered samples are made white and sort to the end, so the median is the middle of the first `seen` samples.
    ordered, seen = np.stack(_ordered(np.where(covered[..., None], np.uint8(255), block), 0, len(block) // 2)), (~covered).sum(axis=0)
    low, high = np.maximum((seen - 1) // 2, 0), seen // 2
    pick = [np.take_along_axis(ordered, index[None, ..., None], axis=0)[0].astype(np.int16) for index in (low, high)]
    return np.where(seen[..., None] > 0, (pick[0] + pick[1]) // 2, 0).astype(np.uint8)
