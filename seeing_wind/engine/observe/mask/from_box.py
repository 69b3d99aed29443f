"""The object in frame 0 from a box round it: what moves together in the box, not what has the same colour."""

from __future__ import annotations

import cv2
import numpy as np

from ...errors import ObjectError, UsageError
from ...progress import Progress
from .background import Plate
from .cutting import LEAST_PIXELS, closed, enclosed, grab_cut, opened, tidy, widened
from .evidence import SURE, Colors, Contrast, against_network, against_plate, against_shape, cut_out, total_odds
from .motion import Window, band_of, cut, paste, shifted, window_of, within
from .moving.in_box import MOVES, NEARBY, Moving, plate_odds
from .rim import cut_back, rim_of, steepness

STEEPER, SPANS_LESS, STAYS_MORE = 0.05, 0.1, 0.1
"""When an outline by colours replaces one by motion. The steepness under each outline is ranked among the window's pixels: the rank, from 0
to 1, must be higher by more than STEEPER, the fraction of the box spanned lower by at most SPANS_LESS, and the fraction of the object that
stands still higher by at most STAYS_MORE."""

NEITHER = "Mark the object in the first frame by --box, --points, or --mask with a PNG."


def mask_in_box(
    frame: np.ndarray, box: tuple[float, float, float, float], plate: Plate | None, progress: Progress, moving: Moving | None = None
) -> np.ndarray:
    """The object (H, W) bool inside `box` (x0, y0, x1, y1) [px]; what surrounds the box is background.

    GrabCut (Rother 2004), initialised with what changes over the clip as the object and what does not as background.

    Args:
        frame: (H, W, 3) uint8 RGB, frame 0.
        plate: the background; None if the camera moves, and then only colours count.
        moving: see `moving_from`; None if the clip has a single frame.

    Raises:
        UsageError: a box outside the frame, without area, or round the whole frame.
        ObjectError: nothing in the box stands out.
    """
    inside = pixels_in(box, *frame.shape[:2])
    if plate is None or moving is None:
        mask = by_colors(frame, inside, progress)
    else:
        # This need not be exact: with a background, frame 0 is segmented once more, see `refined`.
        mask = _by_motion(frame, inside, plate, moving, progress)
    if mask.sum() < LEAST_PIXELS:
        raise ObjectError(
            f"Nothing in the box {numbers(box)} stands out from its surroundings.", "Draw the box closer, or give --mask with a PNG."
        )
    return mask


def by_colors(frame: np.ndarray, inside: np.ndarray, progress: Progress) -> np.ndarray:
    """The region (H, W) bool that GrabCut finds in the box `inside` (H, W) bool by the colours of `frame` (H, W, 3) uint8 alone; may be
    empty."""
    window = _surroundings(inside)
    boxed, mask = cut(inside, window), np.zeros(inside.shape, bool)
    found = grab_cut(cut(frame, window), np.where(boxed, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8), 5, progress)
    paste(mask, tidy(found & boxed), window)
    return cut_back(frame, mask, None, progress) & inside


def _by_motion(frame: np.ndarray, inside: np.ndarray, plate: Plate, moving: Moving, progress: Progress) -> np.ndarray:
    """The region (H, W) bool that GrabCut finds in the box `inside` (H, W) bool of `frame`, which is frame 0, initialised with what moves
    or differs from the background as the object."""
    window, near = _surroundings(inside), within(window_of(inside, NEARBY), frame)
    boxed, behind = cut(inside, window), plate_odds(frame, plate, window)
    motion = np.zeros(boxed.shape, np.float32)
    paste(motion, moving(near), shifted(near, -window[0], -window[1]))
    trimap, likely = np.where(boxed, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8), (motion + behind > 0.0) & boxed
    if likely.sum() > max(MOVES * boxed.sum(), LEAST_PIXELS):
        trimap[boxed & ~likely] = cv2.GC_PR_BGD
        # Of the pixels that change but are not seen to move, only a shadow's are surely not the object: if the object's path is short, the
        # median shows the object itself. Blurred rims look like shadows, but are narrow.
        shadow = opened((plate.compared(frame, window)[1] != 0) & (behind < -1.0))
        trimap[boxed & (behind < -1.0) & ((motion < 0.0) | shadow & (motion <= 0.0))] = cv2.GC_BGD
        # Where motion and background agree, colours need not decide; gaps narrower than a codec's blocks are closed.
        trimap[boxed & closed(behind > 0.0, 9) & ~opened(behind < 0.0, 5) & (motion > 0.0)] = cv2.GC_FGD
    found = grab_cut(cut(frame, window), trimap, 5, progress)
    if found.sum() < max(MOVES * boxed.sum(), LEAST_PIXELS):
        # If GrabCut leaves next to nothing, the object is too small or too similar in colour: trust what changes.
        found = likely
    mask = np.zeros(inside.shape, bool)
    paste(mask, tidy(found & boxed), window)
    return mask


def better_drawn(frame: np.ndarray, mask: np.ndarray, other: np.ndarray, inside: np.ndarray, still: np.ndarray) -> np.ndarray:
    """The better of two masks of the object (H, W) bool in the box `inside` (H, W) bool: `mask`, found by motion, or `other`, by colours.

    `other` is returned if it follows clearly steeper edges of `frame` (H, W, 3) uint8 than `mask`, spans about as much of the box, and
    contains hardly more of what stands `still`. Motion identifies the object; but where little of it is seen to move, or what it hides
    seems to move with it, colours outline it better. `still`: (h, w) bool, in the window of the box and NEARBY pixels round it, clipped to
    the frame.
    """
    window = within(window_of(inside, NEARBY), frame)
    shapes = [cut(one, window) for one in (mask, other)]
    if not (shapes[0].any() and shapes[1].any()):
        return mask
    spans, stays = [_spans(one, cut(inside, window)) for one in shapes], [float(still[one].mean()) for one in shapes]
    if spans[1] < spans[0] - SPANS_LESS or stays[1] > stays[0] + STAYS_MORE:
        return mask
    slope = steepness(cv2.GaussianBlur(cut(frame, window), (0, 0), 1.0))
    less_steep = [np.searchsorted(np.sort(slope, axis=None), slope[rim_of(one)]).mean() for one in shapes]
    return other if less_steep[1] > less_steep[0] + STEEPER * slope.size else mask


def with_network(
    frame: np.ndarray, mask: np.ndarray, outline: np.ndarray, plate: Plate | None, contrast: Contrast | None, progress: Progress
) -> np.ndarray:
    """The object (H, W) bool in `frame` (H, W, 3) uint8, which is frame 0, found again from what was found without a network, `mask` (H, W)
    bool, and the network's `outline` (H, W) bool.

    `plate`: the background, None where it is unknown; `contrast`: if None, it is learnt from this frame.
    """
    window = within(window_of(mask | outline, NEARBY), frame)
    crop, own, other = cut(frame, window), cut(mask, window), cut(outline, window)
    seen = None if plate is None else against_plate(frame, plate, window, contrast or Contrast(plate, [(frame, mask)]))
    colors = np.zeros(own.shape, np.float32)
    if (own & other).any():
        colors = Colors(crop[own & other], crop[~widened(own | other, 2)]).odds(crop)
    expected = 0.5 * against_shape(own, band_of(float(own.sum())))
    odds = total_odds(expected, seen, colors, np.zeros_like(own)) + against_network(other, fresh=True)
    progress.check()
    found = tidy(cut_out(odds, crop, float(other.sum())), own | other)
    better = np.zeros_like(mask)
    paste(better, found, window)
    return better if better.sum() >= LEAST_PIXELS else mask


def _spans(mask: np.ndarray, inside: np.ndarray) -> float:
    """The fraction of the box `inside` (H, W) bool that the bounding box of `mask` (H, W) bool, not empty, covers."""
    (x0, y0, x1, y1), (a0, b0, a1, b1) = window_of(mask, 0), window_of(inside, 0)
    return (x1 - x0) * (y1 - y0) / ((a1 - a0) * (b1 - b0))


def _surroundings(inside: np.ndarray) -> Window:
    """The window in which the box `inside` (H, W) bool is segmented: half of its longer side wider on each side, clipped to the frame."""
    x0, y0, x1, y1 = window_of(inside, 0)
    return within(window_of(inside, max(20, (x1 - x0) // 2, (y1 - y0) // 2)), inside)


def box_round(mask: np.ndarray) -> tuple[float, float, float, float]:
    """A box (x0, y0, x1, y1) [px] round `mask` (H, W) bool as a person would draw it, inside the frame."""
    x0, y0, x1, y1 = window_of(mask, 0)
    margin = max(4.0, 0.05 * max(x1 - x0 - 1, y1 - y0 - 1))
    height, width = mask.shape
    return max(x0 - margin, 0.0), max(y0 - margin, 0.0), min(x1 - 1 + margin, width - 1.0), min(y1 - 1 + margin, height - 1.0)


def pixels_in(box: tuple[float, float, float, float], height: int, width: int) -> np.ndarray:
    """The pixels (H, W) bool inside a box (x0, y0, x1, y1) [px]; raises UsageError as `mask_in_box` does."""
    if not np.isfinite(box).all() or box[2] <= box[0] or box[3] <= box[1]:
        raise UsageError(f"The box {numbers(box)} has no area.", "Give X0 Y0 X1 Y1 with X0 < X1 and Y0 < Y1, in pixels from the top left.")
    x0, y0 = max(int(np.floor(box[0])), 0), max(int(np.floor(box[1])), 0)
    x1, y1 = min(int(np.ceil(box[2])), width - 1), min(int(np.ceil(box[3])), height - 1)
    if x1 <= x0 or y1 <= y0:
        raise UsageError(f"The box {numbers(box)} lies outside the {width}x{height} frame.", NEITHER)
    if x1 - x0 >= width - 2 and y1 - y0 >= height - 2:
        raise UsageError(
            "The box covers the whole frame, so nothing outside it shows the background.", "Draw it close round the object."
        )
    inside = np.zeros((height, width), bool)
    inside[y0 : y1 + 1, x0 : x1 + 1] = True
    return inside


def refined(
    frame: np.ndarray,
    mask: np.ndarray,
    plate: Plate,
    allowed: np.ndarray,
    moving: Moving,
    other: np.ndarray,
    contrast: Contrast | None,
) -> np.ndarray:
    """The object (H, W) bool in `frame` (H, W, 3), which is frame 0, found again within `allowed` (H, W) bool now that the background is
    known.

    `mask` (H, W) bool: where it was found before; `other` (H, W) bool: see `others.beyond_box`; `contrast`: if None, learnt from frame 0.
    """
    band = band_of(float(mask.sum()))
    window = within(window_of(allowed, NEARBY), frame)
    crop, shape = cut(frame, window), cut(mask, window, cv2.BORDER_CONSTANT)
    colors = Colors(crop[shape], crop[~widened(shape, 2)]).odds(crop)
    odds, known = against_plate(frame, plate, window, contrast or Contrast(plate, [(frame, mask)]))
    # What never changes may be a held part of the object: within the hull, the silhouette does not count against it, so colours can decide.
    expected = against_shape(shape, band)
    expected = np.where(enclosed(shape), np.maximum(expected, 0.0), expected)
    # Both count half: the silhouette is a first guess, and dense flow extends some pixels beyond a moving object's border.
    odds = total_odds(0.5 * expected, (odds, known), colors, cut(other, window) & ~(known & (odds < 0.0)), 0.5 * moving(window))
    inside = cut(allowed, window, cv2.BORDER_CONSTANT)
    odds[~inside] = -2.0 * SURE
    found = tidy(cut_out(odds, crop, float(shape.sum())) & inside, shape)
    better = np.zeros_like(mask)
    paste(better, found, window)
    return better if better.sum() >= max(LEAST_PIXELS, 0.3 * mask.sum()) else mask


def numbers(values: tuple[float, ...]) -> str:
    """`values` as they were written on the command line."""
    return " ".join(f"{value:g}" for value in values)
