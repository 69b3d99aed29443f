"""The object in frame 0 from a box round it: what moves together in the box, not what is coloured alike."""

from __future__ import annotations

import cv2
import numpy as np

from ...errors import ObjectError, UsageError
from ...progress import Progress
from .background import Plate
from .cutting import LEAST_PIXELS, closed, enclosed, grab_cut, opened, tidy, widened
from .evidence import SURE, Colors, Contrast, against_plate, against_shape, cut_out, weighed
from .motion import Window, band_of, cut, paste, shifted, window_of, within
from .moving.in_box import MOVES, NEARBY, Moving, left
from .rim import cut_back, rim_of, steepness

STEEPER, SPANS_LESS, STAYS_MORE = 0.05, 0.1, 0.1
"""What an outline by colours needs to be taken instead of one that moves: by how much more of what is in the box its edges are steeper
than, by how much less of the box it may span, and how much more of it may stand still."""

NEITHER = "Mark the object in the first frame by --box, --points, or --mask with a PNG."


def mask_in_box(
    frame: np.ndarray, box: tuple[float, float, float, float], plate: Plate | None, progress: Progress, moving: Moving | None = None
) -> np.ndarray:
    """The object (H, W) bool inside `box` (x0, y0, x1, y1) [px]; what surrounds the box is background.

    GrabCut (Rother 2004), begun with what changes over the clip as the object and what does not as background.

    Args:
        frame: (H, W, 3) uint8 RGB, frame 0.
        plate: the background; None where the camera moves, and then only colours count.
        moving: see `moving_from`; None where there is but one frame.

    Raises:
        UsageError: a box outside the frame or without area.
        ObjectError: nothing in the box stands out.
    """
    inside = _pixels_of(box, *frame.shape[:2])
    if plate is None or moving is None:
        mask = by_colors(frame, inside, progress)
    else:
        # With a background, frame 0 is looked at again.
        mask = _by_motion(frame, inside, plate, moving, progress)
    if mask.sum() < LEAST_PIXELS:
        raise ObjectError(
            f"Nothing in the box {numbers(box)} stands out from its surroundings.", "Draw the box closer, or give --mask with a PNG."
        )
    return mask


def by_colors(frame: np.ndarray, inside: np.ndarray, progress: Progress) -> np.ndarray:
    """What GrabCut finds in the box `inside` (H, W) bool by the colours of `frame` (H, W, 3) uint8 alone, (H, W) bool; maybe nothing."""
    window = _surroundings(inside)
    boxed, mask = cut(inside, window), np.zeros(inside.shape, bool)
    found = grab_cut(cut(frame, window), np.where(boxed, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8), 5, progress)
    paste(mask, tidy(found & boxed), window)
    return cut_back(frame, mask, None, progress) & inside


def _by_motion(frame: np.ndarray, inside: np.ndarray, plate: Plate, moving: Moving, progress: Progress) -> np.ndarray:
    """What GrabCut finds in the box `inside` (H, W) bool of `frame`, frame 0, (H, W) bool, begun with what moves by itself or differs from
    the background as the object."""
    window, near = _surroundings(inside), within(window_of(inside, NEARBY), frame)
    boxed, behind = cut(inside, window), left(frame, plate, window)
    motion = np.zeros(boxed.shape, np.float32)
    paste(motion, moving(near), shifted(near, -window[0], -window[1]))
    trimap, likely = np.where(boxed, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8), (motion + behind > 0.0) & boxed
    if likely.sum() > max(MOVES * boxed.sum(), LEAST_PIXELS):
        trimap[boxed & ~likely] = cv2.GC_PR_BGD
        # Of what changes, only a shadow is surely no object: where a path is short, the median shows the object itself. Blurred rims look
        # like shadows, but are narrow.
        shadow = opened((plate.compared(frame, window)[1] != 0) & (behind < -1.0))
        trimap[boxed & (behind < -1.0) & ((motion < 0.0) | shadow & (motion <= 0.0))] = cv2.GC_BGD
        # Where both agree, colours are not asked; gaps narrower than a codec's blocks are closed.
        trimap[boxed & closed(behind > 0.0, 9) & ~opened(behind < 0.0, 5) & (motion > 0.0)] = cv2.GC_FGD
    found = grab_cut(cut(frame, window), trimap, 5, progress)
    if found.sum() < max(MOVES * boxed.sum(), LEAST_PIXELS):
        # A box that GrabCut empties holds something too small or too alike: trust what changes.
        found = likely
    mask = np.zeros(inside.shape, bool)
    paste(mask, tidy(found & boxed), window)
    return mask


def better_drawn(frame: np.ndarray, mask: np.ndarray, other: np.ndarray, inside: np.ndarray, still: np.ndarray) -> np.ndarray:
    """The `other` outline (H, W) bool in the box `inside` (H, W) bool if it goes along clearly steeper edges of `frame` (H, W, 3) uint8
    than `mask` (H, W) bool does, spans about as much of the box, and holds hardly more of what stands `still`; else `mask`.

    Motion says what the object is, but where little of it is seen to move, or what it hides moves with it, colours draw it better.
    `still` (h, w) bool is of the window of the box and NEARBY pixels round it, as far as the frame goes.
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


def _spans(mask: np.ndarray, inside: np.ndarray) -> float:
    """The part of the box `inside` (H, W) bool that the bounds of `mask` (H, W) bool, not empty, cover."""
    (x0, y0, x1, y1), (a0, b0, a1, b1) = window_of(mask, 0), window_of(inside, 0)
    return (x1 - x0) * (y1 - y0) / ((a1 - a0) * (b1 - b0))


def _surroundings(inside: np.ndarray) -> Window:
    """The window in which the box `inside` (H, W) bool is looked at, with half of its sides beside it."""
    x0, y0, x1, y1 = window_of(inside, 0)
    return within(window_of(inside, max(20, (x1 - x0) // 2, (y1 - y0) // 2)), inside)


def box_round(mask: np.ndarray) -> tuple[float, float, float, float]:
    """The box (x0, y0, x1, y1) [px] that a person draws round `mask` (H, W) bool, inside the frame."""
    x0, y0, x1, y1 = window_of(mask, 0)
    margin = max(4.0, 0.05 * max(x1 - x0 - 1, y1 - y0 - 1))
    height, width = mask.shape
    return max(x0 - margin, 0.0), max(y0 - margin, 0.0), min(x1 - 1 + margin, width - 1.0), min(y1 - 1 + margin, height - 1.0)


def _pixels_of(box: tuple[float, float, float, float], height: int, width: int) -> np.ndarray:
    """(H, W) bool, the box. Raises UsageError as `mask_in_box`."""
    if not np.isfinite(box).all() or box[2] <= box[0] or box[3] <= box[1]:
        raise UsageError(f"The box {numbers(box)} has no area.", "Give X0 Y0 X1 Y1 with X0 < X1 and Y0 < Y1, in pixels from the top left.")
    x0, y0 = max(int(np.floor(box[0])), 0), max(int(np.floor(box[1])), 0)
    x1, y1 = min(int(np.ceil(box[2])), width - 1), min(int(np.ceil(box[3])), height - 1)
    if x1 <= x0 or y1 <= y0:
        raise UsageError(f"The box {numbers(box)} lies outside the {width}x{height} frame.", NEITHER)
    if x1 - x0 >= width - 2 and y1 - y0 >= height - 2:
        raise UsageError(
            "The box covers the whole frame, so nothing is left to tell the background from.", "Draw it close round the object."
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
    """The object in `frame` (H, W, 3), frame 0, found again with the background known, within `allowed` (H, W) bool.

    `mask` (H, W) bool: where it was found before; `other` (H, W) bool: see `others.beyond_box`; `contrast`: None learns it from frame 0.
    """
    band = band_of(float(mask.sum()))
    window = within(window_of(allowed, NEARBY), frame)
    crop, shape = cut(frame, window), cut(mask, window, cv2.BORDER_CONSTANT)
    colors = Colors(crop[shape], crop[~widened(shape, 2)]).odds(crop)
    odds, known = against_plate(frame, plate, window, contrast or Contrast(plate, [(frame, mask)]))
    # What never changes may be a part of the object that is held: its colour can outweigh that, here alone.
    expected = against_shape(shape, band)
    expected = np.where(enclosed(shape), np.maximum(expected, 0.0), expected)
    # Both count half: the silhouette is a first guess, and dense flow runs on for some pixels into what lies beside a thing that moves.
    odds = weighed(0.5 * expected, (odds, known), colors, cut(other, window) & ~(known & (odds < 0.0)), 0.5 * moving(window))
    inside = cut(allowed, window, cv2.BORDER_CONSTANT)
    odds[~inside] = -2.0 * SURE
    found = tidy(cut_out(odds, crop, float(shape.sum())) & inside, shape)
    better = np.zeros_like(mask)
    paste(better, found, window)
    return better if better.sum() >= max(LEAST_PIXELS, 0.3 * mask.sum()) else mask


def numbers(values: tuple[float, ...]) -> str:
    """Numbers as they were given on the command line."""
    return " ".join(f"{value:g}" for value in values)
