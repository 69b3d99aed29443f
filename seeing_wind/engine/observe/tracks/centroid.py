"""One track for a body too small or too plain for corners: the centroid of its silhouette, weighted by how much it covers each pixel."""

from __future__ import annotations

import cv2
import numpy as np

from ...masks import Masks, areas, at_rim, partly_hidden
from ..clip.stored import Frames
from ..mask.background import Plate
from ..mask.cutting import narrowed, widened
from ..mask.evidence import SMALL
from ..mask.motion import cut, window_of

RIM = 3
"""Width [px] round the mask in which pixels may be partly covered by the object (optics, motion blur)."""

BEST = 0.1
"""Least standard deviation claimed for a centroid [px]."""

UNKNOWN = 0.3
"""Standard deviation if the clip is too short to measure it [px]."""

WITHOUT_PLATE = 0.02
"""Standard deviation of the centroid, in units of the object's size, if the coverage of all pixels is taken from the mask instead of being
measured against a known background."""

HIDDEN = 0.3
"""Standard deviation of a small body's centroid if all of it were hidden, in units of the body's size: half its radius."""

LIKE_BACKGROUND = 0.12
"""Fraction of the object in front of a background of its own colour, or of an unknown one, from which its whole shape is registered."""

FARTHEST_REGISTERED = 3.0
"""Distance [px] of a registered place from where its neighbours in time put it, beyond which the registration is not believed."""


def centroid_track(frames: Frames, masks: Masks, plate: Plate | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The centroid of the body's silhouette through the clip.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; masks: (T+1, H, W) bool; plate: the background of a camera that stands still, or None.

    Returns:
        xy (T+1, 2) [px] (interpolated where not visible), visible (T+1,) bool, sigma (T+1,) [px].
    """
    xy = np.full((len(frames), 2), np.nan)
    sigma = np.zeros(len(frames))
    inner = narrowed(masks[0], 1)
    color = np.median(frames[0][inner if inner.any() else masks[0]], axis=0)
    size = areas(masks)
    usual = float(np.median(size[size > 0]))
    # The shape of a small body can be registered where a part of it is seen; of a large one, the centroid of a part says nothing.
    covered = partly_hidden(size) & (usual >= SMALL)
    full: np.ndarray | None = None
    registered = np.zeros(len(frames), bool)
    for t, (frame, mask) in enumerate(zip(frames, masks)):
        if not mask.any() or (t > 0 and (covered[t] or at_rim(mask))):
            continue
        window = window_of(mask, RIM + 6)
        origin = np.array(window[:2], dtype=np.float64)
        cover, known = _cover(frame, mask, plate, color, window)
        missing = 1.0 - float(known[cut(mask, window)].mean())
        partly = mask.sum() < SMALL and (missing > LIKE_BACKGROUND or mask.sum() < (1 - LIKE_BACKGROUND) * usual)
        if partly and full is not None and plate is not None:
            place, certainty = _register(full, cover, known)
            if certainty < 0.35:
                continue
            xy[t], sigma[t], registered[t] = origin + place, 0.5 / certainty, True
            continue
        xy[t] = origin + _mean_place(cover)
        # A small body's hidden part shifts its centroid, by up to half the radius; a large body is cut out by its colours there.
        sigma[t] = missing * (HIDDEN if plate is not None and mask.sum() < SMALL else WITHOUT_PLATE) * np.sqrt(usual)
        if not partly:
            full = _centred(cover)
    xy[_astray(xy, registered)] = np.nan
    visible = np.isfinite(xy[:, 0])
    sigma = np.hypot(sigma, _scatter(xy[visible]))
    times = np.arange(len(xy))
    filled = np.stack([np.interp(times, times[visible], xy[visible, axis]) for axis in range(2)], axis=1)
    return filled, visible, sigma


def _cover(
    frame: np.ndarray, mask: np.ndarray, plate: Plate | None, color: np.ndarray, window: tuple[int, int, int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """How much of each pixel of `window` the object covers (h, w), 0 to 1, and where that is measured (h, w) bool.

    I = a F + (1 - a) B, so a = (I - B).(F - B) / |F - B|², with the object's colour F and the background B.
    """
    inside = cut(mask, window, cv2.BORDER_CONSTANT)
    if plate is None:
        return inside.astype(np.float64), np.zeros(inside.shape, bool)
    behind = cut(plate.color, window).astype(np.float64)
    contrast = color - behind
    strength = (contrast**2).sum(axis=2)
    known = cut(plate.reliable, window) & (strength > (12.0 * plate.noise) ** 2)
    cover = ((cut(frame, window) - behind) * contrast).sum(axis=2) / np.maximum(strength, 1.0)
    near = widened(inside, RIM)
    # A patterned object also has colours other than its median: inside, the mask is better evidence than one colour.
    solid = narrowed(inside, 2)
    cover = np.where(solid, 1.0, np.where(cover > 0.1, np.minimum(cover, 1.0), 0.0))
    return np.where(near & known, cover, np.where(near, inside, 0.0)), known


def _mean_place(cover: np.ndarray) -> np.ndarray:
    total = cover.sum()
    rows, columns = np.arange(cover.shape[0]), np.arange(cover.shape[1])
    return np.array([(cover.sum(axis=0) * columns).sum(), (cover.sum(axis=1) * rows).sum()]) / total


def _centred(cover: np.ndarray) -> np.ndarray:
    """`cover` resampled on a square grid of odd side with its centroid in the middle."""
    place = _mean_place(cover)
    half = int(np.ceil(max(cover.shape) / 2))
    grid = np.mgrid[-half : half + 1, -half : half + 1].astype(np.float32)
    return cv2.remap(
        cover.astype(np.float32),
        grid[1] + np.float32(place[0]),
        grid[0] + np.float32(place[1]),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
    )


def _register(shape: np.ndarray, cover: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, float]:
    """The place x, y [px] in the window at which the centred `shape` best fits the known part of `cover`, and the fraction of it that is
    known there."""
    half = shape.shape[0] // 2
    rows, columns = np.mgrid[: cover.shape[0], : cover.shape[1]].astype(np.float32)
    place = _mean_place(np.where(known, cover, 0.0)) if (known & (cover > 0.1)).any() else np.array(cover.shape[::-1]) / 2.0

    def moved(at: np.ndarray) -> np.ndarray:
        return cv2.remap(
            shape, columns - np.float32(at[0] - half), rows - np.float32(at[1] - half), cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )

    best, place = np.inf, place.copy()
    # First a wide grid of half pixels, as the centroid of the part in view need not be that of the whole; then a fine one.
    for reach, step in ((6.0, 0.5), (0.5, 0.1)):
        middle = place.copy()
        for dy in np.arange(-reach, reach + 1e-6, step):
            for dx in np.arange(-reach, reach + 1e-6, step):
                at = middle + [dx, dy]
                cost = float((((moved(at) - cover) ** 2)[known]).sum())
                if cost < best:
                    best, place = cost, at
    there = moved(place)
    return place, float(there[known].sum() / max(there.sum(), 1e-9))


def _astray(xy: np.ndarray, registered: np.ndarray) -> np.ndarray:
    """Which of the `registered` places (T+1,) bool lie off the parabola through the two full sights before and the two after, (T+1,) bool:
    there, another thing was registered."""
    astray = np.zeros(len(xy), bool)
    full = np.flatnonzero(np.isfinite(xy[:, 0]) & ~registered)
    for t in np.flatnonzero(registered):
        near = np.concatenate([full[full < t][-2:], full[full > t][:2]])
        if len(near) < 3:
            continue
        expected = [np.polyval(np.polyfit(near - t, xy[near, axis], 2), 0.0) for axis in range(2)]
        astray[t] = np.linalg.norm(xy[t] - expected) > FARTHEST_REGISTERED
    return astray


def _scatter(xy: np.ndarray) -> float:
    """Standard deviation [px] of a smooth track's noise, from its third differences, whose variance is 1 + 9 + 9 + 1 = 20 times its own."""
    if len(xy) < 8:
        return UNKNOWN
    third = np.diff(xy, 3, axis=0)
    return max(BEST, float(1.4826 * np.median(np.abs(third)) / np.sqrt(20.0)))
