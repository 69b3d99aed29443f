"""The rim of a silhouette: found again by what is near it in the same frame, cut in the middle of its blur, and without what its box
cuts through."""

from __future__ import annotations

import cv2
import numpy as np

from ...progress import Progress
from .background import Plate, largest
from .cutting import grab_cut, narrowed, opened, tidy, widened
from .motion import band_of, cut, paste, window_of, within

CORE = 0.3
"""Depth of a silhouette from which it is surely the object, in units of its largest."""

CUT = 0.75
"""Length of a box's border across a part, in units of the root of the part's area, from which the part goes on beyond it."""

BESIDE, INSIDE = 24, 0.6
"""Pixels beyond the band in which an outline is found again that show the surroundings' colours, and the part of the depth that the object
has nearby, a stem less than a head, which the band reaches at most."""

PIXELS = 25_000
"""Region size beyond which GrabCut sees a smaller copy where an outline is found again: the rim of a large thing is little of it."""

THIN = 5
"""Pixels of that copy up to which a part is too thin to be found again in it."""

MIXED, NEAR = 1.5, 3
"""Pixels on either side of an outline over which colours are mixed, and pixels round one of the rim in which those beyond are averaged."""

GRAIN = 7.0
"""Grey levels by which the two sides have to differ for a mixture to be told."""


def cut_back(frame: np.ndarray, mask: np.ndarray, progress: Progress) -> np.ndarray:
    """The outline `mask` (H, W) bool in `frame` (H, W, 3) uint8 as it is handed on: `cut_again` and `halved`."""
    again = cut_again(frame, mask, progress) if mask.any() else mask
    # Of something as thin as a thread, a smaller copy may show nothing.
    return halved(frame, again) if again.any() else mask


def cut_again(frame: np.ndarray, mask: np.ndarray, progress: Progress) -> np.ndarray:
    """The outline `mask` (H, W) bool, not empty, found again within a band round its border by the colours and edges of `frame` alone.

    What was carried here is only about right. So GrabCut begins with it, and what lies deeper or farther away than it may be off is sure.
    """
    band = band_of(float(np.count_nonzero(mask)))
    window = within(window_of(mask, int(band) + BESIDE), frame)
    shape = cut(mask, window)
    depth, distance = _depths(shape)
    trimap = np.where(shape, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    reach = np.ones((2 * int(band) + 1, 2 * int(band) + 1), np.uint8)
    trimap[depth > np.minimum(band, INSIDE * cv2.dilate(depth, reach))] = cv2.GC_FGD
    trimap[distance > band] = cv2.GC_BGD
    again = grab_cut(cut(frame, window), trimap, 1, progress, PIXELS)
    if trimap.size > PIXELS:
        # A stem is hardly a pixel wide on a smaller copy: it is left as it was.
        across = int(THIN * np.sqrt(trimap.size / PIXELS)) | 1
        again = np.where(widened(opened(shape, across), across // 2), again, shape)
    found = np.zeros_like(mask)
    paste(found, again, window)
    return found


def halved(frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The outline `mask` (H, W) bool, not empty, without the outer half of its blurred rim.

    A lens and a codec mix the colours of both sides there. The object ends where half of the mixture is its own; both sides' colours are
    those nearby beyond the rim. What is too thin to have an inside stays as it is.
    """
    window = within(window_of(mask, NEAR), frame)
    shape, smooth = cut(mask, window).copy(), cv2.GaussianBlur(cut(frame, window), (0, 0), 0.7)
    depth, distance = _depths(shape)
    inner = depth > min(MIXED, 0.5 * float(depth.max()))
    rim = np.flatnonzero(shape & ~inner)
    (own, inside), (beside, outside) = (_averaged(smooth, side, rim) for side in (inner, distance > MIXED))
    apart = own - beside
    less = np.sum((smooth.reshape(-1, 3)[rim] - beside - 0.5 * apart) * apart, axis=1) <= 0.5 * GRAIN**2
    shape.reshape(-1)[rim] = ~(less & inside & outside)
    left = mask.copy()
    paste(left, tidy(shape), window)
    return left


def _averaged(smooth: np.ndarray, side: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The colours (P, 3) float32 of `smooth` (h, w, 3) uint8 on one `side` (h, w) bool, averaged nearby, and whether there are any, (P,)
    bool: for the pixels whose numbers, row by row, are `at` (P,)."""
    size = (2 * NEAR + 1, 2 * NEAR + 1)
    some = cv2.boxFilter(side.astype(np.uint8), cv2.CV_32F, size, normalize=False).reshape(-1)[at]
    total = cv2.boxFilter(cv2.bitwise_and(smooth, smooth, mask=side.astype(np.uint8)), cv2.CV_32F, size, normalize=False)
    total = total.reshape(-1, 3)[at]
    return total / np.maximum(some, 1.0)[:, None], some > 0.5


def _depths(shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How deep in `shape` (h, w) bool, which goes on beyond the window, a pixel lies, and how far from it, (h, w) float32 [px] both."""
    one = shape.astype(np.uint8)
    return _depth(one), _depth(1 - one)


def _depth(one: np.ndarray) -> np.ndarray:
    """(h, w) float32 [px] from where `one` (h, w) uint8, which goes on beyond the window, is 0."""
    return cv2.distanceTransform(cv2.copyMakeBorder(one, 1, 1, 1, 1, cv2.BORDER_REPLICATE), cv2.DIST_L2, 5)[1:-1, 1:-1]


def boxed_in(frame: np.ndarray, mask: np.ndarray, box: np.ndarray, plate: Plate) -> np.ndarray:
    """The outline `mask` (H, W) bool without parts that the `box` (H, W) bool, drawn round the object, cuts through: they go on outside it.

    Such a part lies beyond the steepest edges, the box's border cuts it about as wide as it is, and no background is known beyond that.
    """
    if not mask.any() or (mask & ~box).any():
        return mask
    window = within(window_of(mask, 8), frame)
    smooth, shape = cv2.GaussianBlur(cut(frame, window), (0, 0), 1.0), cut(mask, window)
    count, labels = cv2.connectedComponents(opened(shape & ~core(smooth, shape)).astype(np.uint8), connectivity=4)
    unseen = ~cut(plate.reliable, window) | (plate.compared(frame, window)[0] >= 3.0 * plate.noise)
    # Nearer to the box, a lens and a codec spread what touches its border.
    border = widened(unseen & ~cut(widened(box, 2), window), 4)
    area, cuts = np.bincount(labels.ravel(), minlength=count), np.bincount(labels[border], minlength=count) / 2.0
    gone = cuts > CUT * np.sqrt(area)
    gone[0] = False
    if not gone.any():
        return mask
    left = mask.copy()
    paste(left, opened(shape & ~gone[labels]), window)
    return left


def core(smooth: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """The part (h, w) bool of `shape` (h, w) bool within the steepest edges of `smooth` (h, w, 3) uint8 round its deepest places."""
    depth = _depth(shape.astype(np.uint8))
    marks = np.zeros(shape.shape, np.int32)
    marks[~widened(shape, 2)] = 2
    marks[depth > CORE * depth.max()] = 1
    cv2.watershed(np.ascontiguousarray(smooth), marks)
    # The line between two basins belongs to neither.
    return widened(marks == 1, 1) & shape


def steepness(smooth: np.ndarray) -> np.ndarray:
    """(h, w) float32 [grey levels per pixel], of the channel of `smooth` (h, w, 3) uint8 in which it is steepest."""
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, *way, scale=1.0 / 8.0) for way in ((1, 0), (0, 1)))
    return np.sqrt(largest(across * across + down * down))


def rim_of(shape: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels beside the border of `shape` (h, w) bool, on either side."""
    return widened(shape, 1) & ~narrowed(shape, 1)
