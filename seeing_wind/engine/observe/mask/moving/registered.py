"""The first frames of a camera that moves, as it would have seen them from where frame 0 was taken.

What stands still around the object is carried from frame to frame by a homography: exactly where the camera only turns or the surroundings
are flat or far away, about so elsewhere. Over a second that is enough to tell what moves by itself.
"""

from __future__ import annotations

import cv2
import numpy as np

from ....progress import Progress
from ...clip.shake import LEAST_CORNERS, LEAST_PART, surrounding_corners, there_and_back
from ...clip.stored import Frames, StoredFrames

AT_MOST = 24
"""Frames: the farther the camera has gone, the less a homography says."""

AT_LEAST = 8
"""Frames: in fewer, an object hardly moves."""

CLOSE = 1.5
"""Pixels within which a corner agrees with the homography."""

RETURNS = 1.0
"""Pixels within which a corner that is followed there and back returns."""


def registered(frames: Frames, around: np.ndarray, progress: Progress) -> StoredFrames | None:
    """The first frames (F, H, W, 3) uint8 RGB from the view of frame 0, which shows through where they show nothing; None where too few
    can be carried there.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; around: (H, W) bool, where the object is in frame 0 and corners are not to be trusted.
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
    """Corners (K, 1, 2) [px] of the `gray` frame (H, W) uint8 beside `around` (H, W) bool, as `surrounding_corners`."""
    return surrounding_corners(gray, around, max(8.0, gray.shape[1] / 80))


def homography_to(first: np.ndarray, gray: np.ndarray, corners: np.ndarray, places: np.ndarray) -> np.ndarray | None:
    """(3, 3), from pixels of the gray frame `first` to those of `gray` (H, W) uint8; None where the surroundings do not move as one.

    `corners` (K, 1, 2) [px] are in the first one; `places` (K, 1, 2): about where they are in the other.
    """
    moved, sure = there_and_back(first, gray, corners, places, RETURNS)
    if sure.sum() < LEAST_CORNERS:
        return None
    cv2.setRNGSeed(0)
    found, agree = cv2.findHomography(corners[sure], moved[sure], cv2.RANSAC, CLOSE)
    return found if found is not None and agree.mean() >= LEAST_PART else None
