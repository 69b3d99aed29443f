"""The first frames of a camera that moves, warped to the view of frame 0.

The still surroundings of the object are carried from frame to frame by a homography: this is exact if the camera only turns or the
surroundings are flat or far away, otherwise approximate. Over a second it is good enough to see what moves by itself.
"""

from __future__ import annotations

import cv2
import numpy as np

from ....progress import Progress
from ...clip.shake import LEAST_CORNERS, LEAST_PART, surrounding_corners, there_and_back
from ...clip.stored import Frames, StoredFrames

AT_MOST = 24
"""Largest number of frames: the farther the camera has moved, the less accurate a homography is."""

AT_LEAST = 8
"""Least number of frames: in fewer, an object hardly moves."""

CLOSE = 1.5
"""Distance [px] up to which a corner agrees with the homography."""

RETURNS = 1.0
"""Distance [px] from its start within which a corner must return when it is tracked forwards and back."""


def registered(frames: Frames, around: np.ndarray, progress: Progress) -> StoredFrames | None:
    """The first frames (F, H, W, 3) uint8 RGB warped to the view of frame 0, and filled up with frame 0 where they do not cover it; None if
    too few can be warped.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; around: (H, W) bool, where the object is in frame 0, so that corners there are not used.
    """
    first = np.array(frames[0])
    gray = cv2.cvtColor(first, cv2.COLOR_RGB2GRAY)
    corners = corners_beside(gray, around)
    if corners is None:
        return None
    views, places = StoredFrames(*gray.shape), corners
    views.append(first)
    for t in range(1, min(AT_MOST, len(frames))):
        progress.check()
        frame = np.array(frames[t])
        found = homography_to(gray, cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), corners, places)
        if found is None:
            break
        places = cv2.perspectiveTransform(corners.astype(np.float64), found).astype(np.float32)
        how = {"flags": cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, "borderMode": cv2.BORDER_TRANSPARENT}
        views.append(cv2.warpPerspective(frame, found, gray.shape[::-1], dst=first.copy(), **how))
    return views if len(views) >= AT_LEAST else None


def corners_beside(gray: np.ndarray, around: np.ndarray) -> np.ndarray | None:
    """Corners (K, 1, 2) [px] in the `gray` frame (H, W) uint8 outside `around` (H, W) bool, see `surrounding_corners`."""
    return surrounding_corners(gray, around, max(8.0, gray.shape[1] / 80))


def homography_to(first: np.ndarray, gray: np.ndarray, corners: np.ndarray, places: np.ndarray) -> np.ndarray | None:
    """The homography (3, 3) from pixels of the frame `first` to those of `gray`, both (H, W) uint8; None if the surroundings do not move as
    one.

    `corners`: (K, 1, 2) [px] in `first`; `places`: (K, 1, 2) [px], about where they are in `gray`.
    """
    moved, sure = there_and_back(first, gray, corners, places, RETURNS)
    if sure.sum() < LEAST_CORNERS:
        return None
    cv2.setRNGSeed(0)
    found, agree = cv2.findHomography(corners[sure], moved[sure], cv2.RANSAC, CLOSE)
    return found if found is not None and agree.mean() >= LEAST_PART else None
