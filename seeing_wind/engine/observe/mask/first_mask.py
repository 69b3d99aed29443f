"""The object's pixels in frame 0: from a PNG, points on it, the extent of a depth map, or from what moves."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ...conventions import counted
from ...errors import ObjectError, UsageError
from ...progress import Progress
from ...settings import ObserveSettings
from ..clip.depth import read_depth
from ..clip.images import read_image
from ..clip.stored import Frames
from .background import Plate
from .cutting import LEAST_PIXELS, closed, grab_cut, opened, tidy
from .from_box import NEITHER, numbers

SEED = 0.012
"""Radius of the disc round a point that surely belongs to the object, in units of the frame's shorter side."""

LARGEST_OF_POINTS = 0.6
"""Fraction of the frame beyond which the region found from points is taken for the background."""


def first_mask(settings: ObserveSettings, frames: Frames, plate: Plate | None, progress: Progress) -> np.ndarray:
    """The object (H, W) bool in the first of `frames` (T+1, H, W, 3) uint8 RGB.

    The first of these that is given decides: `settings.mask`, `settings.points`, the extent of a depth map that is infinite off the object;
    if none is, the one thing that differs from `plate`, the background of a camera that stands still (None if it moves).

    Raises:
        ObjectError: no object is found, or it covers too few pixels or the whole frame.
        UsageError: a mask that is unreadable or of another size, or a point outside the frame.
    """
    frame = frames[0]
    height, width = frame.shape[:2]
    if settings.mask is not None:
        mask = read_mask(settings.mask, height, width)
    elif settings.points is not None:
        mask = mask_from_points(frame, point_list(settings.points, height, width), plate, progress)
    elif settings.depth is not None and not np.isfinite(depth := read_depth(settings.depth, height, width)).all():
        mask = np.isfinite(depth) & (depth > 0)
    else:
        mask = _what_moves(frame, plate)
        progress.warn("Neither mask nor box was given: the one thing that moves against the background is taken for the object.")
    check_extent(mask)
    return mask


def check_extent(mask: np.ndarray) -> None:
    """Refuse a mask (H, W) bool of the first frame. Raises ObjectError if it covers too few pixels or the whole frame."""
    if mask.sum() < LEAST_PIXELS:
        raise ObjectError(f"The object covers {counted(int(mask.sum()), 'pixel')} of the first frame, too few to follow.", NEITHER)
    if mask.mean() > 0.95:
        raise ObjectError("The object covers the whole first frame.", "Mark only the thing that moves: non-zero pixels are the object.")


def check_outline(outline: np.ndarray, path: str) -> None:
    """Refuse the outline (H, W) bool of a later frame, from the file at `path`. Raises ObjectError if it covers too few pixels."""
    if outline.sum() < LEAST_PIXELS:
        raise ObjectError(f"The outline {path} has {counted(int(outline.sum()), 'pixel')}, too few for an object.", "Draw it larger.")


def read_mask(path: str, height: int, width: int, what: str = "mask") -> np.ndarray:
    """The mask (H, W) bool in the image file at `path`: non-zero pixels are inside, transparent ones are not. `what` names it in errors.

    Raises:
        UsageError: missing, unreadable, or of another size than the clip.
    """
    if not Path(path).is_file():
        raise UsageError(f"There is no {what} at {path}.", "Check the path.")
    try:
        values = read_image(path, cv2.IMREAD_UNCHANGED)
    except (OSError, ValueError) as error:
        raise UsageError(f"The {what} {path} cannot be read: {error}.", "Save it as PNG, as large as the clip.") from error
    if values.shape[:2] != (height, width):
        raise UsageError(
            f"The {what} {path} is {values.shape[1]}x{values.shape[0]}, the clip {width}x{height}.",
            "Draw it over the clip's first frame.",
        )
    if values.ndim == 2:
        return values > 0
    inside = (values[..., :3] > 0).any(axis=2)
    return inside & (values[..., 3] > 0) if values.shape[2] == 4 else inside


def point_list(points: tuple[float, ...], height: int, width: int) -> np.ndarray:
    """The flat `points` X0 Y0 X1 Y1 ... as (P, 2) [px].

    Raises:
        UsageError: no point, an odd number of values, or a point outside the frame.
    """
    if not points or len(points) % 2 or not np.isfinite(points).all():
        raise UsageError(f"The points {numbers(points)} are no pairs of pixels.", "Give --points X,Y [X,Y ...], each on the object.")
    pairs = np.array(points, dtype=np.float64).reshape(-1, 2)
    outside = (pairs < -0.5).any(axis=1) | (pairs[:, 0] > width - 0.5) | (pairs[:, 1] > height - 0.5)
    if outside.any():
        raise UsageError(f"The point {numbers(tuple(pairs[outside][0]))} lies outside the {width}x{height} frame.", NEITHER)
    return pairs


def mask_from_points(frame: np.ndarray, points: np.ndarray, plate: Plate | None, progress: Progress) -> np.ndarray:
    """The object (H, W) bool that `points` (P, 2) [px] lie on.

    If the camera stands still and every point lies on something that differs from the background, that is the object. Otherwise GrabCut
    separates the colours at the points from those of the rest, and what is connected to the points is kept: points on all of the object's
    colours help.

    Raises:
        ObjectError: the region found is hardly larger than the points' discs, or most of the frame.
    """
    height, width = frame.shape[:2]
    seeds = np.zeros((height, width), np.uint8)
    radius = max(2, round(SEED * min(height, width)))
    for x, y in np.round(points).astype(int):
        cv2.circle(seeds, (int(x), int(y)), radius, 1, -1)
    found = _changed_at(frame, seeds, points, plate, progress)
    if found is None:
        found = _coloured_as(frame, seeds, points, progress)
    # Hardly more than the discs round the points: their colours are everywhere, so GrabCut added nothing to them.
    if not max(LEAST_PIXELS, 1.5 * seeds.sum()) <= found.sum() <= LARGEST_OF_POINTS * found.size:
        raise ObjectError(
            f"The region at the points covers {counted(int(found.sum()), 'pixel')} and differs from its surroundings in neither colour nor "
            "motion.",
            "Set more points, on all of its colours, or draw a --box round it.",
        )
    return found


def _changed_at(frame: np.ndarray, seeds: np.ndarray, points: np.ndarray, plate: Plate | None, progress: Progress) -> np.ndarray | None:
    """The moving things under the points, cut along their edges; None where a point is on nothing that moves."""
    if plate is None:
        return None
    away, light = plate.compared(frame, (0, 0, frame.shape[1], frame.shape[0]))
    changed = (away > 6.0 * plate.noise) | ~plate.reliable
    _, labels = cv2.connectedComponents(closed(changed, 5).astype(np.uint8))
    column, row = np.round(points).astype(int).T
    own = np.unique(labels[row, column])
    if not own.all():
        return None
    # A part of this is background that the object moves over, or its moving shadow: the colours decide.
    trimap = np.where(np.isin(labels, own), cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
    if (light != 0)[seeds > 0].mean() < 0.5:
        trimap[light != 0] = cv2.GC_BGD
    trimap[seeds > 0] = cv2.GC_FGD
    return tidy(grab_cut(frame, trimap, 5, progress), seeds > 0)


def _coloured_as(frame: np.ndarray, seeds: np.ndarray, points: np.ndarray, progress: Progress) -> np.ndarray:
    trimap = np.full(seeds.shape, cv2.GC_PR_BGD, np.uint8)
    hull = np.zeros_like(seeds)
    cv2.fillConvexPoly(hull, cv2.convexHull(np.round(points).astype(np.int32)), 1)
    trimap[hull > 0] = cv2.GC_PR_FGD
    rim = max(1, min(seeds.shape) // 50)
    edge = np.ones(seeds.shape, bool)
    edge[rim:-rim, rim:-rim] = False
    trimap[edge] = cv2.GC_BGD
    trimap[seeds > 0] = cv2.GC_FGD
    found = grab_cut(frame, trimap, 6, progress)
    _, labels = cv2.connectedComponents(found.astype(np.uint8), connectivity=4)
    own = np.unique(labels[(seeds > 0) & found])
    return tidy(np.isin(labels, own[own > 0]), seeds > 0)


def _what_moves(frame: np.ndarray, plate: Plate | None) -> np.ndarray:
    if plate is None:
        raise ObjectError("No object was marked, and the camera moves, so the object cannot be found by its motion.", NEITHER)
    away, _ = plate.compared(frame, (0, 0, frame.shape[1], frame.shape[0]))
    changed = opened(closed((away > 6.0 * plate.noise + 6.0) & plate.reliable, 5))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(changed.astype(np.uint8), connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < LEAST_PIXELS:
        raise ObjectError("No object was marked, and nothing in the first frame differs from the background.", NEITHER)
    order = np.argsort(areas)[::-1]
    if len(areas) > 1 and areas[order[1]] > 0.35 * areas[order[0]]:
        raise ObjectError("No object was marked, and more than one thing moves.", NEITHER)
    return tidy(labels == 1 + order[0])
