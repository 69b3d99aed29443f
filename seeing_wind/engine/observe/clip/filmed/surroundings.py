"""What the surroundings of the object do while the camera films: they show a lens that refocuses and a sensor that is read row by row."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ....progress import Progress
from ....records import Doubt
from ..shake import LEAST_CORNERS, LEAST_PART, surrounding_corners, there_and_back
from ..stored import Frames

MOST = 20
"""Frames that are looked at, spread over the clip."""

RETURNS = 0.5
"""Pixels within which a corner that is followed there and back returns."""

BREATHES = 0.004
"""Relative change of the frame's size from which it is told: two pixels at the rim of a frame of 1000. Corners are tracked ten times
as well."""

ROUND, JUMPS = 5, 4.0
"""Frames over whose median it is taken, and how many times as much as they usually differ from that it has to be."""

SLIDES = 0.05
"""Part of the frame's width by which a frame that grows may slide: a camera that moves does both."""

LEANS = 0.7
"""Pixels over the frame's height by which upright things lean, from which it is told."""

READ, AGREE = (0.1, 1.2), 0.8
"""Part of the time between two frames that a sensor takes to be read, and how closely the leaning has to follow the camera's speed."""


@dataclass(frozen=True)
class Motion:
    """Of the surroundings, against frame 0, as affine maps, in those frames in which they could be followed."""

    frames: np.ndarray
    """(P,) int."""
    affine: np.ndarray
    """(P, 2, 3) [px], about the frame's middle."""
    speed: np.ndarray
    """(P,) [px per frame] to the right."""


def camera_doubts(frames: Frames, around: np.ndarray, progress: Progress) -> list[Doubt]:
    """What is said of the camera by the surroundings of the object.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB, as filmed.
        around: (H, W) bool, where the object is in frame 0.
    """
    motion = surroundings(frames, around, progress)
    height, width = frames.shape[1:3]
    return [one for one in (_breathing(motion, width), _row_by_row(motion, height)) if one is not None]


def surroundings(frames: Frames, around: np.ndarray, progress: Progress) -> Motion:
    """How the corners round the object move, by pyramidal Lucas-Kanade and RANSAC."""
    first = cv2.cvtColor(frames[0], cv2.COLOR_RGB2GRAY)
    height, width = first.shape
    corners = surrounding_corners(first, around, max(8.0, width / 40))
    kept: list[tuple[int, np.ndarray, float]] = []
    middle = np.array([0.5 * width, 0.5 * height])
    if corners is None:
        return Motion(np.zeros(0, int), np.zeros((0, 2, 3)), np.zeros(0))
    for t in np.unique(np.linspace(1, len(frames) - 1, min(MOST, len(frames) - 1)).astype(int)):
        progress.check()
        gray = cv2.cvtColor(frames[int(t)], cv2.COLOR_RGB2GRAY)
        moved, sure = there_and_back(first, gray, corners, corners, RETURNS)
        if sure.sum() < LEAST_CORNERS:
            continue
        here, there = (xy.reshape(-1, 2)[sure] - middle for xy in (corners, moved))
        cv2.setRNGSeed(0)
        fit, agree = cv2.estimateAffine2D(here, there, ransacReprojThreshold=1.0)
        if fit is None or agree.sum() < max(LEAST_CORNERS, LEAST_PART * len(here)):
            continue
        before = cv2.cvtColor(frames[int(t) - 1], cv2.COLOR_RGB2GRAY)
        places = (there + middle).astype(np.float32)[:, None]
        earlier, also = there_and_back(gray, before, places, places, RETURNS)
        also &= agree.ravel() > 0
        if also.any():
            kept.append((int(t), fit, float(np.median((there + middle - earlier[:, 0])[also, 0]))))
    parts = list(zip(*kept)) if kept else [(), (), ()]
    return Motion(np.array(parts[0], int), np.array(parts[1]).reshape(-1, 2, 3), np.array(parts[2], float))


def _breathing(motion: Motion, width: int) -> Doubt | None:
    if len(motion.frames) < ROUND:
        return None
    size = np.sqrt(np.abs(np.linalg.det(motion.affine[:, :, :2]))) - 1.0
    slide = np.linalg.norm(motion.affine[:, :, 2], axis=1)
    # A lens moves smoothly; few corners, or ones that are not still, give sizes that jump.
    padded = np.pad(size, ROUND // 2, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, ROUND), axis=1)
    most = int(np.argmax(np.abs(smooth)))
    if abs(smooth[most]) < max(BREATHES, JUMPS * float(np.median(np.abs(size - smooth)))) or slide.max() > SLIDES * width:
        return None
    return Doubt(
        0.7,
        f"All that stands still grows or shrinks by up to {100 * abs(smooth[most]):.1f} %, most in frame {motion.frames[most]}: "
        "the lens refocuses or zooms, and that is taken for motion.",
        "Lock the focus while filming, or choose a part in which it is still.",
    )


def _row_by_row(motion: Motion, height: int) -> Doubt | None:
    if len(motion.frames) < 6:
        return None
    # A turn leans columns one way and rows the other, which cancels; a slide while the rows are read leans the columns alone.
    lean = height * (motion.affine[:, 0, 1] + motion.affine[:, 1, 0])
    speed = motion.speed - motion.speed.mean()
    if np.abs(lean - np.median(lean)).max() < LEANS or speed.std() < 1e-6:
        return None
    share = float((speed * (lean - lean.mean())).sum() / (speed**2).sum())
    agreement = float(np.corrcoef(speed, lean)[0, 1])
    if not READ[0] < share < READ[1] or agreement < AGREE:
        return None
    return Doubt(
        0.6,
        f"The camera shakes while its sensor is read row by row ({100 * share:.0f} % of the time between frames), so the image wobbles "
        f"by up to {np.abs(lean - np.median(lean)).max():.1f} px.",
        "Hold the camera still, or put it on a tripod.",
    )
