"""How the surroundings of the object move in the frames: this reveals a lens that refocuses, and a sensor that is read row by row."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ....progress import Progress
from ....records import Doubt
from ..shake import LEAST_CORNERS, LEAST_PART, surrounding_corners, there_and_back
from ..stored import Frames

MOST = 20
"""Largest number of frames examined, spread over the clip."""

RETURNS = 0.5
"""Distance [px] from its start within which a corner must return when it is tracked forwards and back."""

BREATHES = 0.004
"""Relative change of the image's size from which it is reported: two pixels at the rim of a frame of 1000. Corners are tracked ten times
as accurately."""

ROUND, JUMPS = 5, 4.0
"""Number of frames over whose median the size is smoothed, and the least ratio of its change to the usual difference from that median."""

SLIDES = 0.05
"""Largest shift of the image, in units of the frame's width, while its size changes: a camera that moves causes both."""

LEANS = 0.7
"""Lean of upright things over the frame's height from which it is reported [px]."""

READ, AGREE = (0.1, 1.2), 0.8
"""Range of a sensor's readout time, in units of the time between frames, and the least correlation of the lean with the camera's speed."""


@dataclass(frozen=True)
class Motion:
    """The motion of the surroundings from frame 0, as affine maps, in the P frames in which they could be followed."""

    frames: np.ndarray
    """(P,) int, the frames' numbers."""
    affine: np.ndarray
    """(P, 2, 3) [px], about the frame's middle."""
    speed: np.ndarray
    """(P,) speed to the right [px per frame]."""


def camera_doubts(frames: Frames, around: np.ndarray, progress: Progress) -> list[Doubt]:
    """Doubts about the camera, from the motion of the object's surroundings.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB, as filmed.
        around: (H, W) bool, where the object is in frame 0.
    """
    motion = surroundings(frames, around, progress)
    height, width = frames.shape[1:3]
    return [one for one in (_breathing(motion, width), _row_by_row(motion, height)) if one is not None]


def surroundings(frames: Frames, around: np.ndarray, progress: Progress) -> Motion:
    """The motion of the corners round the object, by pyramidal Lucas-Kanade and RANSAC. Arguments as of `camera_doubts`."""
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
    # A lens moves smoothly; sizes jump if there are few corners, or if the corners are not still.
    padded = np.pad(size, ROUND // 2, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, ROUND), axis=1)
    most = int(np.argmax(np.abs(smooth)))
    if abs(smooth[most]) < max(BREATHES, JUMPS * float(np.median(np.abs(size - smooth)))) or slide.max() > SLIDES * width:
        return None
    return Doubt(
        0.7,
        f"All that stands still grows or shrinks by up to {100 * abs(smooth[most]):.1f} %, most in frame {motion.frames[most]}: "
        "the lens refocuses or zooms, and that is taken for motion.",
        "Lock the focus while filming, or choose a part of the clip in which it does not change.",
    )


def _row_by_row(motion: Motion, height: int) -> Doubt | None:
    if len(motion.frames) < 6:
        return None
    # A rotation leans columns one way and rows the other, which cancels here; a shift while the rows are read leans only the columns.
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
