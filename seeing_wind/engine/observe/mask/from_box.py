"""The object in frame 0 from a box round it: what moves together in the box, not what is coloured alike."""

from __future__ import annotations

import cv2
import numpy as np

from ...errors import ObjectError, UsageError
from ...progress import Progress
from .background import Plate
from .cutting import LEAST_PIXELS, enclosed, grab_cut, tidy
from .evidence import SURE, Colors, Contrast, against_plate, against_shape, cut_out, weighed
from .motion import band_of, cut, paste, window_of, within
from .moving.in_box import MOVES, NEARBY, Moving, left
from .rim import cut_back

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
    margin = max(20, (window_of(inside, 0)[2] - window_of(inside, 0)[0]) // 2, (window_of(inside, 0)[3] - window_of(inside, 0)[1]) // 2)
    window = within(window_of(inside, margin), frame)
    crop, boxed = cut(frame, window), cut(inside, window)
    seen = None
    if plate is not None and moving is not None:
        motion = np.zeros(boxed.shape, np.float32)
        near = within(window_of(inside, NEARBY), frame)
        paste(motion, moving(near), (near[0] - window[0], near[1] - window[1], near[2] - window[0], near[3] - window[1]))
        seen = motion, left(frame, plate, window), plate.relit(frame, window)
    found = _begun(crop, boxed, seen, progress)
    if found.sum() < max(MOVES * boxed.sum(), LEAST_PIXELS) and seen is not None:
        # A box that GrabCut empties holds something too small or too alike: trust what changes.
        found = (seen[0] + seen[1] > 0.0) & boxed
    mask = np.zeros(inside.shape, bool)
    paste(mask, tidy(found & boxed), window)
    if mask.sum() < LEAST_PIXELS:
        raise ObjectError(
            f"Nothing in the box {numbers(box)} stands out from its surroundings.", "Draw the box closer, or give --mask with a PNG."
        )
    # With a background, frame 0 is looked at again.
    return mask if plate is not None else cut_back(frame, mask, None, progress) & inside


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


def _begun(
    crop: np.ndarray, boxed: np.ndarray, seen: tuple[np.ndarray, np.ndarray, np.ndarray] | None, progress: Progress
) -> np.ndarray:
    """The object (h, w) bool in `crop` by GrabCut, begun with what moves by itself or differs from the background as the object.

    `seen`, (h, w) each: log odds by motion, and by what differs from the background; bool, where a shadow came or went.
    """
    trimap = np.where(boxed, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
    if seen is not None:
        motion, behind, relit = seen
        likely = (motion + behind > 0.0) & boxed
        if likely.sum() > max(MOVES * boxed.sum(), LEAST_PIXELS):
            trimap[boxed & ~likely] = cv2.GC_PR_BGD
            # Of what changes, only a shadow is surely no object: where a path is short, the median shows the object itself. Blurred rims
            # look like shadows, but are narrow.
            shadow = cv2.morphologyEx((relit & (behind < -1.0)).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
            trimap[boxed & (behind < -1.0) & ((motion < 0.0) | shadow & (motion <= 0.0))] = cv2.GC_BGD
            # Where both agree, colours are not asked; gaps narrower than a codec's blocks are closed.
            closed = cv2.morphologyEx((behind > 0.0).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)) > 0
            shade = cv2.morphologyEx((behind < 0.0).astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)) > 0
            trimap[boxed & closed & ~shade & (motion > 0.0)] = cv2.GC_FGD
    return grab_cut(crop, trimap, 5, progress)


def refined(
    frame: np.ndarray,
    mask: np.ndarray,
    plate: Plate,
    allowed: np.ndarray,
    motion: np.ndarray,
    other: np.ndarray,
    contrast: Contrast | None = None,
) -> np.ndarray:
    """The object in `frame` (H, W, 3), frame 0, found again with the background known, within `allowed` (H, W) bool.

    `mask` (H, W) bool: where it was found before; `motion` (h, w): `moving_odds` in the window of `allowed` and NEARBY pixels
    round it, as far as the frame goes; `other` (H, W) bool: see `others.beyond_box`.
    """
    band = band_of(float(mask.sum()))
    window = within(window_of(allowed, NEARBY), frame)
    crop, shape = cut(frame, window), cut(mask, window, cv2.BORDER_CONSTANT)
    near = cv2.dilate(shape.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    colors = Colors(crop[shape], crop[~near]).odds(crop)
    odds, known = against_plate(frame, plate, window, contrast or Contrast(plate, [(frame, mask)]))
    # What never changes may be a part of the object that is held: its colour can outweigh that, here alone.
    expected = against_shape(shape, band)
    expected = np.where(enclosed(shape), np.maximum(expected, 0.0), expected)
    apart = cut(other, window, cv2.BORDER_CONSTANT) & ~(known & (odds < 0.0))
    # Both count half: the silhouette is a first guess, and dense flow runs on for some pixels into what lies beside a thing that moves.
    odds = weighed(0.5 * expected, (odds, known), colors, apart, 0.5 * motion)
    inside = cut(allowed, window, cv2.BORDER_CONSTANT)
    odds[~inside] = -2.0 * SURE
    found = tidy(cut_out(odds, crop, float(shape.sum())) & inside, shape)
    better = np.zeros_like(mask)
    paste(better, found, window)
    return better if better.sum() >= max(LEAST_PIXELS, 0.3 * mask.sum()) else mask


def numbers(values: tuple[float, ...]) -> str:
    """Numbers as they were given on the command line."""
    return " ".join(f"{value:g}" for value in values)
