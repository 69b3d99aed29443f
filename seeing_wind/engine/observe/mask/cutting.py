"""Segmenting a region of a frame by its colours, cleaning up its mask, and the hull of what it may hide."""

from __future__ import annotations

import cv2
import numpy as np

from ...progress import Progress

LEAST_PIXELS = 12
"""Smallest object that can be followed: a disc of four pixels."""

SPECK = 0.03
"""Fraction of the largest piece's area below which another piece is ignored."""

HOLE = 0.1
"""Fraction of an object's area up to which a hole in it is a mistake: the middle of a smooth object seems to stand still, and that of a
see-through one looks like what is behind it."""

FULL = 0.25
"""Fraction of its convex hull that an object must fill for the rest of the hull to count as possibly missed parts of it."""

GRABCUT_PIXELS = 120_000
"""Region size beyond which GrabCut runs on a smaller copy: its time grows faster than its accuracy."""


def grab_cut(
    crop: np.ndarray, trimap: np.ndarray, iterations: int, progress: Progress, most: int = GRABCUT_PIXELS
) -> np.ndarray:
    """Foreground (h, w) bool of `crop` (h, w, 3) uint8 by GrabCut (Rother 2004), initialised with `trimap` (h, w) of cv2.GC_* labels, on a
    copy of at most `most` pixels.

    It can be cancelled through `progress` between iterations, each of which may take a fifth of a second.
    """
    given = (trimap & 1) > 0
    scale = min(1.0, float(np.sqrt(most / trimap.size)))
    size = (max(8, round(crop.shape[1] * scale)), max(8, round(crop.shape[0] * scale)))
    small = crop if scale == 1.0 else cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
    labels = trimap.copy() if scale == 1.0 else cv2.resize(trimap, size, interpolation=cv2.INTER_NEAREST)
    # GrabCut fits five Gaussians to each side, which take some samples.
    if min((labels & 1).sum(), ((labels & 1) == 0).sum()) < 10:
        return given
    cv2.setRNGSeed(0)
    behind, front = np.zeros((1, 65)), np.zeros((1, 65))
    for iteration in range(iterations):
        cv2.grabCut(small, labels, None, behind, front, 1, cv2.GC_EVAL if iteration else cv2.GC_INIT_WITH_MASK)
        progress.check()
        if not (labels & 1).any():
            break
    found = (labels & 1).astype(np.float32)
    return found > 0 if scale == 1.0 else cv2.resize(found, crop.shape[1::-1], interpolation=cv2.INTER_LINEAR) > 0.5


def tidy(mask: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
    """`mask` (h, w) bool without specks and small holes.

    Kept are the components that touch `near` (h, w) bool; without `near`, the largest one and those at least a tenth as large.
    """
    # OpenCV's statistics of the components take ten times as long as the labelling, and most masks are a single component.
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    if count < 2:
        return mask
    if count == 2:
        return _without_holes(mask if near is None or (near & mask).any() else np.zeros_like(mask))
    areas = np.bincount(labels.ravel(), minlength=count)[1:]
    keep = areas >= 0.1 * areas.max()
    if near is not None:
        keep = np.bincount(labels[near & mask], minlength=count)[1:] > 0
        keep &= areas >= SPECK * max(areas[keep], default=0)
    return _without_holes(np.concatenate([[False], keep])[labels])


def _without_holes(kept: np.ndarray) -> np.ndarray:
    """`kept` (h, w) bool with its holes filled, those smaller than HOLE of its area."""
    holes, labels = cv2.connectedComponents((~kept).astype(np.uint8), connectivity=4)
    most = HOLE * np.count_nonzero(kept)
    if holes < 3 and kept.size - np.count_nonzero(kept) >= most:
        return kept
    small = np.bincount(labels.ravel(), minlength=holes) < most
    small[0] = False
    return kept | small[labels] if small.any() else kept


def grown(mask: np.ndarray) -> np.ndarray:
    """`mask` (H, W) bool dilated by four pixels, as far as a blurred rim and a codec's artefacts reach."""
    return widened(mask, 4)


def widened(mask: np.ndarray, by: int) -> np.ndarray:
    """`mask` (H, W) bool dilated by `by` pixels."""
    return cv2.dilate(mask.astype(np.uint8), _square(2 * by + 1)) > 0


def narrowed(mask: np.ndarray, by: int) -> np.ndarray:
    """`mask` (H, W) bool eroded by `by` pixels; at the frame's edge it is taken to go on."""
    return cv2.erode(mask.astype(np.uint8), _square(2 * by + 1)) > 0


def opened(mask: np.ndarray, across: int = 3) -> np.ndarray:
    """`mask` (H, W) bool without what is less than `across` pixels thick, an odd number: OpenCV's opening by an even one shifts a mask."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _square(across)) > 0


def closed(mask: np.ndarray, across: int) -> np.ndarray:
    """`mask` (H, W) bool with gaps of less than `across` pixels, an odd number, closed."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, _square(across)) > 0


def _square(side: int) -> np.ndarray:
    return np.ones((side, side), np.uint8)


def enclosed(mask: np.ndarray) -> np.ndarray:
    """All that the object may hide if parts of it were missed, (H, W) bool: the convex hull of `mask` (H, W) bool.

    If the mask fills little of its hull, it is a stem with leaves rather than an object most of which was missed, and `mask` is returned.
    """
    filled = mask.astype(np.uint8)
    if mask.any():
        outlines, _ = cv2.findContours(filled, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.fillConvexPoly(filled, cv2.convexHull(np.concatenate(outlines)), 1)
    hull: np.ndarray = filled > 0
    return hull if np.count_nonzero(mask) >= FULL * np.count_nonzero(hull) else mask > 0


def connected_to(parts: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """The `seeds` (h, w) bool and all of the `parts` (h, w) bool that is connected to them."""
    count, labels = cv2.connectedComponents((parts | seeds).astype(np.uint8), connectivity=4)
    touching = np.bincount(labels[seeds], minlength=count) > 0
    touching[0] = False
    return touching[labels]
