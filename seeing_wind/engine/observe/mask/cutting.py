"""Cutting a region out of a frame by its colours, tidying it, and what it may hide."""

from __future__ import annotations

import cv2
import numpy as np

from ...progress import Progress

LEAST_PIXELS = 12
"""Smallest object that can be followed: a disc of four pixels."""

SPECK = 0.03
"""Part of the largest piece below which another piece is nothing."""

HOLE = 0.1
"""Part of an object up to which a hole in it is a mistake: a smooth thing's middle looks as if it stood still, and a see-through one's like
what is behind it."""

FULL = 0.25
"""Least part of its convex hull that a body fills of which parts may have been missed."""

GRABCUT_PIXELS = 120_000
"""Region size beyond which GrabCut runs on a smaller copy: its time grows faster than its accuracy."""


def grab_cut(
    crop: np.ndarray, trimap: np.ndarray, iterations: int, progress: Progress, most: int = GRABCUT_PIXELS
) -> np.ndarray:
    """Foreground (h, w) bool of `crop` (h, w, 3) uint8 by GrabCut from `trimap` (h, w) of cv2.GC_* labels, on a copy of at most `most`
    pixels.

    `progress` is asked between iterations, each of which may take a fifth of a second.
    """
    given = (trimap & 1) > 0
    scale = min(1.0, float(np.sqrt(most / trimap.size)))
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
        progress.check()
        if not (labels & 1).any():
            break
    found = (labels & 1).astype(np.float32)
    return found > 0 if scale == 1.0 else cv2.resize(found, crop.shape[1::-1], interpolation=cv2.INTER_LINEAR) > 0.5


def tidy(mask: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
    """`mask` (h, w) bool without specks and small holes: the parts that touch `near`, or the largest part and those a tenth as large."""
    # OpenCV's own figures of the parts take ten times as long as the parts, and most masks are one.
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
    """`kept` (h, w) bool with its holes filled up to HOLE."""
    holes, labels = cv2.connectedComponents((~kept).astype(np.uint8), connectivity=4)
    most = HOLE * np.count_nonzero(kept)
    if holes < 3 and kept.size - np.count_nonzero(kept) >= most:
        return kept
    small = np.bincount(labels.ravel(), minlength=holes) < most
    small[0] = False
    return kept | small[labels] if small.any() else kept


def grown(mask: np.ndarray) -> np.ndarray:
    """`mask` (H, W) bool with what lies up to four pixels beside it, where a blurred rim and a codec's traces still show the object."""
    return widened(mask, 4)


def widened(mask: np.ndarray, by: int) -> np.ndarray:
    """`mask` (H, W) bool with what lies up to `by` pixels beside it."""
    return cv2.dilate(mask.astype(np.uint8), _square(2 * by + 1)) > 0


def narrowed(mask: np.ndarray, by: int) -> np.ndarray:
    """`mask` (H, W) bool without what lies up to `by` pixels from its border; it goes on beyond the frame."""
    return cv2.erode(mask.astype(np.uint8), _square(2 * by + 1)) > 0


def opened(mask: np.ndarray, across: int = 3) -> np.ndarray:
    """`mask` (H, W) bool without what is less than `across` pixels thick, an odd number: OpenCV moves what it opens by an even one."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _square(across)) > 0


def closed(mask: np.ndarray, across: int) -> np.ndarray:
    """`mask` (H, W) bool with its gaps of less than `across` pixels, an odd number."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, _square(across)) > 0


def _square(side: int) -> np.ndarray:
    return np.ones((side, side), np.uint8)


def enclosed(mask: np.ndarray) -> np.ndarray:
    """All that the object may hide if parts of it were missed, (H, W) bool: the convex hull of `mask` (H, W) bool.

    What fills little of its hull is a stem with leaves rather than a body of which most was missed, and hides nothing more.
    """
    filled = mask.astype(np.uint8)
    if mask.any():
        outlines, _ = cv2.findContours(filled, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.fillConvexPoly(filled, cv2.convexHull(np.concatenate(outlines)), 1)
    hull: np.ndarray = filled > 0
    return hull if np.count_nonzero(mask) >= FULL * np.count_nonzero(hull) else mask > 0


def hanging_on(parts: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """The `seeds` (h, w) bool with what hangs together with them of the `parts` (h, w) bool."""
    count, labels = cv2.connectedComponents((parts | seeds).astype(np.uint8), connectivity=4)
    touching = np.bincount(labels[seeds], minlength=count) > 0
    touching[0] = False
    return touching[labels]
