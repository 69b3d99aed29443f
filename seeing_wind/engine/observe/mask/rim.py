"""Refining the rim of a silhouette in a single frame: attached shadows and parts cut by the user's box are removed, the outline is found
again from nearby colours, and it ends in the middle of its blur.

A shadow that moves along with the object that casts it differs from the background as the object does. But no light source is a point, so
a shadow fades out over more pixels than the lens blurs an edge over: the object's own edge is sharper.
"""

from __future__ import annotations

import cv2
import numpy as np

from ...progress import Progress
from .background import Plate, largest
from .cutting import grab_cut, narrowed, opened, tidy, widened
from .motion import Window, band_of, cut, median_of, paste, window_of, within

CORE = 0.3
"""Depth in a silhouette from which a pixel surely is the object, in units of the greatest depth."""

SMALLEST = 9
"""Area [px] below which a part's edges are too short to judge."""

DARKER = 0.8
"""Fraction of a shadow that must be darker than the background in every channel; the rest may be noise."""

WEAKER = 0.8
"""Largest gradient of a shadow's outer edge, in units of the gradient of the edge between shadow and object."""

SOFTER = 0.6
"""Largest relative steepness of a shadow's outer edge (gradient over contrast), in units of that of the object's own edge."""

STEEP = (0.15, 0.25)
"""Relative steepness of an object's own edge [1/px], the fraction of its contrast that it gains per pixel: the least, and the one assumed
where the whole rim is in doubt."""

CUT = 0.75
"""Length of the box's border across a part, in units of the root of the part's area, from which the part is taken to go on outside."""

EDGE = 3
"""Pixels over which an edge rises to its full contrast."""

BESIDE, INSIDE = 24, 0.6
"""Width [px] beyond the band, in which an outline is found again, that shows the colours of the surroundings; and the fraction of the
object's local depth (less in a stem than in a head) that the band may reach inwards."""

PIXELS = 25_000
"""Area [px] beyond which GrabCut works on a smaller copy when an outline is found again: a large object's rim is a small part of it."""

THIN = 5
"""Thickness [px of that copy] up to which a part is too thin to be found again in it."""

MIXED, NEAR = 1.5, 3
"""Distance [px] on either side of an outline over which colours are mixed, and distance [px] from a rim pixel up to which the unmixed
colours of each side are averaged."""

GRAIN = 7.0
"""Difference between the colours of the two sides from which their mixture can be resolved [grey levels]."""


def cut_back(frame: np.ndarray, mask: np.ndarray, plate: Plate | None, progress: Progress) -> np.ndarray:
    """The object `mask` (H, W) bool in `frame` (H, W, 3) uint8 with its rim refined: by `without_shadow` if the background is known, then
    by `cut_again` and `halved`."""
    own = mask if plate is None else without_shadow(frame, mask, plate)
    if not own.any():
        return own
    again = cut_again(frame, own, progress)
    # An object as thin as a thread may vanish in the smaller copy.
    return halved(frame, again) if again.any() else own


def cut_again(frame: np.ndarray, mask: np.ndarray, progress: Progress) -> np.ndarray:
    """The object (H, W) bool, found again within a band round the border of `mask` (H, W) bool, not empty, by the colours and edges of
    `frame` alone.

    A carried mask is only approximate: GrabCut is initialised with it, and only pixels farther from its border than it may be off are
    fixed.
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
        # A stem is hardly a pixel wide in a smaller copy: it is left as it was.
        across = int(THIN * np.sqrt(trimap.size / PIXELS)) | 1
        again = np.where(widened(opened(shape, across), across // 2), again, shape)
    found = np.zeros_like(mask)
    paste(found, again, window)
    return found


def halved(frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The object `mask` (H, W) bool, not empty, without the outer half of its blurred rim.

    A lens and a codec mix the colours of both sides in the rim. The object ends where half of the mixture is its own colour; the colours
    of the two sides are averaged nearby, outside the rim. Parts too thin to have an unmixed inside stay as they are.
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
    """The mean colour (P, 3) float32 of the pixels of `smooth` (h, w, 3) uint8 on one `side` (h, w) bool within NEAR of each of the pixels
    with flat indices `at` (P,), and whether there are any, (P,) bool."""
    size = (2 * NEAR + 1, 2 * NEAR + 1)
    some = cv2.boxFilter(side.astype(np.uint8), cv2.CV_32F, size, normalize=False).reshape(-1)[at]
    total = cv2.boxFilter(cv2.bitwise_and(smooth, smooth, mask=side.astype(np.uint8)), cv2.CV_32F, size, normalize=False)
    total = total.reshape(-1, 3)[at]
    return total / np.maximum(some, 1.0)[:, None], some > 0.5


def _depths(shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth of each pixel inside `shape` (h, w) bool and its distance outside, both (h, w) float32 [px]; the shape goes on beyond the
    window."""
    one = shape.astype(np.uint8)
    return _depth(one), _depth(1 - one)


def _depth(one: np.ndarray) -> np.ndarray:
    """Distance (h, w) float32 [px] to the nearest pixel where `one` (h, w) uint8 is 0; it goes on beyond the window."""
    return cv2.distanceTransform(cv2.copyMakeBorder(one, 1, 1, 1, 1, cv2.BORDER_REPLICATE), cv2.DIST_L2, 5)[1:-1, 1:-1]


def without_cut_parts(frame: np.ndarray, mask: np.ndarray, box: np.ndarray, plate: Plate) -> np.ndarray:
    """The object `mask` (H, W) bool without parts that the user's `box` (H, W) bool cuts through: these go on outside the box, so they are
    not the object.

    Such a part lies beyond the steepest edges, the box's border crosses its full width, and no known background is seen beyond the border.
    """
    if not mask.any() or (mask & ~box).any():
        return mask
    window = within(window_of(mask, 8), frame)
    smooth, shape = cv2.GaussianBlur(cut(frame, window), (0, 0), 1.0), cut(mask, window)
    labels, area = _parts(shape & ~core(smooth, shape))
    unseen = ~cut(plate.reliable, window) | (plate.compared(frame, window)[0] >= 3.0 * plate.noise)
    # Not directly at the box: there, a lens and a codec spread what touches its border.
    border = widened(unseen & ~cut(widened(box, 2), window), 4)
    cuts = np.bincount(labels[border], minlength=len(area)) / 2.0
    gone = cuts > CUT * np.sqrt(area)
    gone[0] = False
    return _without(mask, shape, gone[labels], window) if gone.any() else mask


def without_shadow(frame: np.ndarray, mask: np.ndarray, plate: Plate) -> np.ndarray:
    """The object `mask` (H, W) bool without the shadow attached to it.

    A watershed (Meyer 1992) finds the steepest edges between the object's core and its surroundings. A part of the mask outside these edges
    is a shadow if it is darker than the background, and its outer edge is weaker than its edge towards the core and softer than the rest of
    the rim.
    """
    if not mask.any():
        return mask
    window = window_of(mask, 2 * EDGE + 2)
    smooth, behind = (cv2.GaussianBlur(one, (0, 0), 1.0) for one in (cut(frame, window), cut(plate.color, window)))
    shape = cut(mask, window)
    own = core(smooth, shape)
    labels, area = _parts(shape & ~own)
    dark = largest(cv2.bitwise_not(cv2.subtract(behind, smooth))) < 255.0 - 0.5 * plate.noise
    doubtful = (np.bincount(labels[dark], minlength=len(area)) >= DARKER * area) & (area >= SMALLEST)
    doubtful[0] = False
    if not doubtful.any():
        return mask
    away, slope = largest(cv2.absdiff(smooth, behind)).astype(np.float32), steepness(smooth)
    contrast = cv2.dilate(away, np.ones((2 * EDGE + 1, 2 * EDGE + 1), np.uint8))
    steep = slope / np.maximum(contrast, np.float32(4.0 * plate.noise))
    inner, outer = rim_of(own), rim_of(shape)
    usual = max(STEEP[0], median_of(steep[inner & outer])) if (inner & outer).any() else STEEP[1]
    shade = np.zeros(len(area), bool)
    for one in np.flatnonzero(doubtful):
        x0, y0, wide, high = cv2.boundingRect((labels == one).astype(np.uint8))
        part = np.s_[max(y0 - 2, 0) : y0 + high + 2, max(x0 - 2, 0) : x0 + wide + 2]
        near = widened(labels[part] == one, 2)
        begins, ends = near & (inner & ~outer)[part], near & (outer & ~inner)[part]
        if begins.any() and ends.any():
            weaker = median_of(slope[part][ends]) < WEAKER * median_of(slope[part][begins])
            shade[one] = weaker and median_of(steep[part][ends]) < SOFTER * usual
    return _without(mask, shape, shade[labels], window) if shade.any() else mask


def _parts(rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Labels (h, w) of the connected parts of `rest` (h, w) bool, without slivers, 0 elsewhere; and the area [px] of each label."""
    count, labels = cv2.connectedComponents(opened(rest).astype(np.uint8), connectivity=4)
    return labels, np.bincount(labels.ravel(), minlength=count)


def _without(mask: np.ndarray, shape: np.ndarray, gone: np.ndarray, window: Window) -> np.ndarray:
    """`mask` (H, W) bool, equal to `shape` (h, w) bool in `window`, without the pixels `gone` (h, w) bool and slivers left beside them."""
    left = mask.copy()
    paste(left, opened(shape & ~gone), window)
    return left


def core(smooth: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """The part (h, w) bool of `shape` (h, w) bool inside the steepest edges of `smooth` (h, w, 3) uint8 round its deepest pixels."""
    depth = _depth(shape.astype(np.uint8))
    marks = np.zeros(shape.shape, np.int32)
    marks[~widened(shape, 2)] = 2
    marks[depth > CORE * depth.max()] = 1
    cv2.watershed(np.ascontiguousarray(smooth), marks)
    # The line between two basins belongs to neither.
    return widened(marks == 1, 1) & shape


def steepness(smooth: np.ndarray) -> np.ndarray:
    """Gradient (h, w) float32 [grey levels per pixel] of the channel of `smooth` (h, w, 3) uint8 in which it is largest."""
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, *way, scale=1.0 / 8.0) for way in ((1, 0), (0, 1)))
    return np.sqrt(largest(across * across + down * down))


def rim_of(shape: np.ndarray) -> np.ndarray:
    """(h, w) bool: the pixels on either side of the border of `shape` (h, w) bool."""
    return widened(shape, 1) & ~narrowed(shape, 1)
