"""Which pixels of picture 0 are the object: from a PNG, a box round it, a depth map's extent, or what moves."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ...errors import ObjectError, UsageError
from ...progress import Progress
from ...settings import ObserveSettings
from ..clip.depth import read_depth
from ..clip.pictures import read_picture
from .background import Plate

LEAST_PIXELS = 12
"""Smallest object that can be followed: a disc of four pixels."""

GRABCUT_PIXELS = 120_000
"""Region size beyond which GrabCut runs on a smaller copy: its time grows faster than its accuracy."""

FEW = 900
"""Pixels below which colours say little of an object, and what differs from a clean background more."""

CUT_OFF = (0.08, 1.0)
"""Parts of what a box holds of a small object that may lie outside it: less is its rim, more is something else beside it."""

SEED = 0.012
"""Radius of the disc round a point that is surely the object, in units of the picture's shorter side."""

LARGEST_OF_POINTS = 0.6
"""Part of the picture beyond which what was found from points is the background."""

NEITHER = "Mark the object in the first picture: --box X0 Y0 X1 Y1, --points X,Y ..., or --mask with a PNG."


def first_mask(settings: ObserveSettings, picture: np.ndarray, plate: Plate | None, progress: Progress) -> np.ndarray:
    """The object (H, W) bool in `picture` (H, W, 3) uint8 RGB.

    `settings.mask` comes first, then `settings.box`, then `settings.points`, then the extent of a depth map that is infinite off the
    object, then the one thing that differs from `plate`, the background of a camera that stands still (None when it moves).

    Raises:
        ObjectError: nothing there, or too little.
        UsageError: a mask of another size or unreadable, a box or a point outside the picture, a box without area.
    """
    height, width = picture.shape[:2]
    if settings.mask is not None:
        mask = read_mask(settings.mask, height, width)
    elif settings.box is not None:
        mask = mask_in_box(picture, settings.box, plate, progress)
    elif settings.points is not None:
        mask = mask_from_points(picture, point_list(settings.points, height, width), plate, progress)
    elif settings.depth is not None and not np.isfinite(depth := read_depth(settings.depth, height, width)).all():
        mask = np.isfinite(depth) & (depth > 0)
    else:
        mask = _what_moves(picture, plate)
        progress.warn("Neither mask nor box was given: the one thing that moves against the background is taken for the object.")
    if mask.sum() < LEAST_PIXELS:
        raise ObjectError(f"The object covers {int(mask.sum())} pixels of the first picture, too few to follow.", NEITHER)
    if mask.mean() > 0.95:
        raise ObjectError("The object covers the whole first picture.", "Mark only the thing that moves: non-zero pixels are the object.")
    return mask


def read_mask(path: str, height: int, width: int, what: str = "mask") -> np.ndarray:
    """A mask picture (H, W) bool, non-zero = inside; transparent pixels count as zero.

    Raises:
        UsageError: unreadable or of another size than the clip.
    """
    if not Path(path).is_file():
        raise UsageError(f"There is no {what} at {path}.", "Check the path.")
    values = read_picture(path, cv2.IMREAD_UNCHANGED)
    if values is None:
        raise UsageError(f"The {what} {path} is not a picture.", "Save it as PNG.")
    if values.shape[:2] != (height, width):
        raise UsageError(
            f"The {what} {path} is {values.shape[1]}x{values.shape[0]}, the clip {width}x{height}.",
            "Draw it over the clip's first picture.",
        )
    if values.ndim == 2:
        return values > 0
    inside = (values[..., :3] > 0).any(axis=2)
    return inside & (values[..., 3] > 0) if values.shape[2] == 4 else inside


def mask_in_box(picture: np.ndarray, box: tuple[float, float, float, float], plate: Plate | None, progress: Progress) -> np.ndarray:
    """The object (H, W) bool inside `box` (x0, y0, x1, y1) [px] by GrabCut (Rother 2004), the surroundings of the box being background.

    Raises:
        UsageError: a box outside the picture or without area.
        ObjectError: nothing in the box stands out.
    """
    height, width = picture.shape[:2]
    if not np.isfinite(box).all() or box[2] <= box[0] or box[3] <= box[1]:
        raise UsageError(f"The box {_numbers(box)} has no area.", "Give X0 Y0 X1 Y1 with X0 < X1 and Y0 < Y1, in pixels from the top left.")
    x0, y0 = max(int(np.floor(box[0])), 0), max(int(np.floor(box[1])), 0)
    x1, y1 = min(int(np.ceil(box[2])), width - 1), min(int(np.ceil(box[3])), height - 1)
    if x1 <= x0 or y1 <= y0:
        raise UsageError(f"The box {_numbers(box)} lies outside the {width}x{height} picture.", NEITHER)
    if x1 - x0 >= width - 2 and y1 - y0 >= height - 2:
        raise UsageError(
            "The box covers the whole picture, so nothing is left to tell the background from.", "Draw it close round the object."
        )
    margin = max(20, (x1 - x0) // 2, (y1 - y0) // 2)
    rows, columns = slice(max(y0 - margin, 0), y1 + margin + 1), slice(max(x0 - margin, 0), x1 + margin + 1)
    crop = picture[rows, columns]
    trimap = np.full(crop.shape[:2], cv2.GC_BGD, np.uint8)
    inside = np.zeros((height, width), bool)
    inside[y0 : y1 + 1, x0 : x1 + 1] = True
    trimap[inside[rows, columns]] = cv2.GC_PR_FGD
    changed = plate.difference(picture)[rows, columns] > 6.0 * plate.noise if plate is not None else None
    found = _cut_box(crop, trimap, changed, progress)
    mask = np.zeros((height, width), bool)
    mask[rows, columns] = tidy(found & inside[rows, columns])
    if plate is not None and LEAST_PIXELS <= mask.sum() < FEW:
        mask = _beyond_box(mask, inside, picture, plate, progress)
    if mask.sum() < LEAST_PIXELS:
        raise ObjectError(
            f"Nothing in the box {_numbers(box)} stands out from its surroundings.", "Draw the box closer, or give --mask with a PNG."
        )
    return mask


def _beyond_box(mask: np.ndarray, inside: np.ndarray, picture: np.ndarray, plate: Plate, progress: Progress) -> np.ndarray:
    """The small object `mask` (H, W) with what a box drawn through it cut off: changed pixels outside that adjoin it, shadows aside."""
    height, width = mask.shape
    changed = plate.difference(picture) > 6.0 * plate.noise
    outside = changed & ~inside & ~plate.relit(picture, (0, 0, width, height))
    _, labels = cv2.connectedComponents((mask | outside).astype(np.uint8), connectivity=4)
    own = np.unique(labels[mask])
    grown = outside & np.isin(labels, own)
    if not CUT_OFF[0] * mask.sum() < grown.sum() < CUT_OFF[1] * mask.sum():
        return mask
    progress.warn("The box cuts through the object; what adjoins it outside the box is taken as well.")
    return tidy(mask | grown, mask)


def point_list(points: tuple[float, ...], height: int, width: int) -> np.ndarray:
    """The flat `points` X0 Y0 X1 Y1 ... as (P, 2) [px].

    Raises:
        UsageError: no point, half a point, or one outside the picture.
    """
    if not points or len(points) % 2 or not np.isfinite(points).all():
        raise UsageError(f"The points {_numbers(points)} are no pairs of pixels.", "Give --points X,Y [X,Y ...], each on the object.")
    pairs = np.array(points, dtype=np.float64).reshape(-1, 2)
    outside = (pairs < -0.5).any(axis=1) | (pairs[:, 0] > width - 0.5) | (pairs[:, 1] > height - 0.5)
    if outside.any():
        raise UsageError(f"The point {_numbers(tuple(pairs[outside][0]))} lies outside the {width}x{height} picture.", NEITHER)
    return pairs


def mask_from_points(picture: np.ndarray, points: np.ndarray, plate: Plate | None, progress: Progress) -> np.ndarray:
    """The object (H, W) bool that `points` (P, 2) [px] lie on.

    What differs from the background of a camera that stands still, where every point lies on it; otherwise what has the colours at the
    points rather than those of the rest, by GrabCut, as far as it hangs together with them. Points on all its colours help.

    Raises:
        ObjectError: what is found is next to nothing, or nearly the whole picture.
    """
    height, width = picture.shape[:2]
    seeds = np.zeros((height, width), np.uint8)
    radius = max(2, round(SEED * min(height, width)))
    for x, y in np.round(points).astype(int):
        cv2.circle(seeds, (int(x), int(y)), radius, 1, -1)
    found = _changed_at(picture, seeds, points, plate, progress)
    if found is None:
        found = _coloured_as(picture, seeds, points, progress)
    # Hardly more than the discs round the points: their colours are everywhere, and nothing was added to them.
    if not max(LEAST_PIXELS, 1.5 * seeds.sum()) <= found.sum() <= LARGEST_OF_POINTS * found.size:
        raise ObjectError(
            f"What the points lie on covers {int(found.sum())} pixels and is told from its surroundings by neither colour nor motion.",
            "Set more points, on all of its colours, or draw a --box round it.",
        )
    return found


def _changed_at(picture: np.ndarray, seeds: np.ndarray, points: np.ndarray, plate: Plate | None, progress: Progress) -> np.ndarray | None:
    """The moving things under the points, cut along their edges; None where a point is on nothing that moves."""
    if plate is None:
        return None
    changed = (plate.difference(picture) > 6.0 * plate.noise) | ~plate.reliable
    _, labels = cv2.connectedComponents(cv2.morphologyEx(changed.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)))
    column, row = np.round(points).astype(int).T
    own = np.unique(labels[row, column])
    if not own.all():
        return None
    # Part of it is the background that the object moves over, or a shadow that moves along: the colours tell.
    trimap = np.where(np.isin(labels, own), cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
    relit = plate.relit(picture, (0, 0, picture.shape[1], picture.shape[0]))
    if relit[seeds > 0].mean() < 0.5:
        trimap[relit] = cv2.GC_BGD
    trimap[seeds > 0] = cv2.GC_FGD
    return tidy(grab_cut(picture, trimap, 5, progress), seeds > 0)


def _coloured_as(picture: np.ndarray, seeds: np.ndarray, points: np.ndarray, progress: Progress) -> np.ndarray:
    trimap = np.full(seeds.shape, cv2.GC_PR_BGD, np.uint8)
    hull = np.zeros_like(seeds)
    cv2.fillConvexPoly(hull, cv2.convexHull(np.round(points).astype(np.int32)), 1)
    trimap[hull > 0] = cv2.GC_PR_FGD
    rim = max(1, min(seeds.shape) // 50)
    edge = np.ones(seeds.shape, bool)
    edge[rim:-rim, rim:-rim] = False
    trimap[edge] = cv2.GC_BGD
    trimap[seeds > 0] = cv2.GC_FGD
    found = grab_cut(picture, trimap, 6, progress)
    _, labels = cv2.connectedComponents(found.astype(np.uint8), connectivity=4)
    own = np.unique(labels[(seeds > 0) & found])
    return tidy(np.isin(labels, own[own > 0]), seeds > 0)


def _cut_box(crop: np.ndarray, trimap: np.ndarray, changed: np.ndarray | None, progress: Progress) -> np.ndarray:
    inside = trimap == cv2.GC_PR_FGD
    small = inside.sum() < FEW
    if small and changed is not None and LEAST_PIXELS <= (changed & inside).sum() < 0.9 * inside.sum():
        # A few dozen pixels are no colour model; what differs from the clean background is better evidence.
        return changed & inside
    found = grab_cut(crop, trimap, 5, progress)
    # A box that GrabCut empties holds something too small or too alike: trust what changed.
    if found.sum() < LEAST_PIXELS and changed is not None:
        return changed & inside
    return found


def grab_cut(crop: np.ndarray, trimap: np.ndarray, iterations: int, progress: Progress | None = None) -> np.ndarray:
    """Foreground (h, w) bool of `crop` (h, w, 3) uint8 by GrabCut from `trimap` (h, w) of cv2.GC_* labels, on a smaller copy if large.

    `progress` is asked between iterations, each of which may take a fifth of a second.
    """
    given = (trimap & 1) > 0
    scale = min(1.0, float(np.sqrt(GRABCUT_PIXELS / trimap.size)))
    size = (max(8, round(crop.shape[1] * scale)), max(8, round(crop.shape[0] * scale)))
    small = crop if scale == 1.0 else cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
    labels = trimap.copy() if scale == 1.0 else cv2.resize(trimap, size, interpolation=cv2.INTER_NEAREST)
    # Five colours per side need at least as many samples.
    if min((labels & 1).sum(), ((labels & 1) == 0).sum()) < 10:
        return given
    cv2.setRNGSeed(0)
    behind, front = np.zeros((1, 65)), np.zeros((1, 65))
    for iteration in range(iterations):
        cv2.grabCut(small, labels, None, behind, front, 1, cv2.GC_EVAL if iteration else cv2.GC_INIT_WITH_MASK)
        if progress is not None:
            progress.check()
        if not (labels & 1).any():
            break
    found = (labels & 1).astype(np.float32)
    return found > 0 if scale == 1.0 else cv2.resize(found, crop.shape[1::-1], interpolation=cv2.INTER_LINEAR) > 0.5


def tidy(mask: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
    """`mask` (h, w) bool without specks and small holes: the parts that touch `near`, or the largest part and those a tenth as large."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count < 2:
        return mask
    areas = stats[1:, cv2.CC_STAT_AREA]
    keep = areas >= 0.1 * areas.max()
    if near is not None:
        touching = np.bincount(labels[near & mask], minlength=count)[1:]
        keep = touching > 0.25 * areas if (touching > 0.25 * areas).any() else touching > 0
    kept = np.concatenate([[False], keep])[labels]
    holes, labels, stats, _ = cv2.connectedComponentsWithStats((~kept).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < 0.02 * kept.sum()
    small[0] = False
    return kept | small[labels] if holes > 1 else kept


def _what_moves(picture: np.ndarray, plate: Plate | None) -> np.ndarray:
    if plate is None:
        raise ObjectError("No object was marked, and the camera moves, so nothing says what it is.", NEITHER)
    changed = (plate.difference(picture) > 6.0 * plate.noise + 6.0).astype(np.uint8)
    changed = cv2.morphologyEx(
        cv2.morphologyEx(changed, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
    )
    count, labels, stats, _ = cv2.connectedComponentsWithStats(changed, connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < LEAST_PIXELS:
        raise ObjectError("No object was marked, and nothing in the first picture differs from the background.", NEITHER)
    order = np.argsort(areas)[::-1]
    if len(areas) > 1 and areas[order[1]] > 0.35 * areas[order[0]]:
        raise ObjectError("No object was marked, and more than one thing moves.", NEITHER)
    return tidy(labels == 1 + order[0])


def _numbers(box: tuple[float, ...]) -> str:
    return " ".join(f"{value:g}" for value in box)
