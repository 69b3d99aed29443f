"""Whether the camera stands still: corners of the surroundings stay in place, or standing still explains the surroundings better than any
camera motion does."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from ...records import Camera, Doubt
from .shake import surrounding_corners
from .stored import Frames

STILL = 1.5
"""Distance [px] that corners of the surroundings may move while the camera counts as standing still; the plate tolerates as much."""

CARRIED = 6.0
"""Least motion [px] that a camera's path must predict for still things for still surroundings to contradict it: no path is exact."""

STILL_PART = 0.3
"""Fraction of the corners that must stay: the rest may be on other things that move, while a moving camera would carry all of them."""

WIDEST = 640
"""Length of the longer side of the copies in which surroundings are compared [px]."""

TELLS = 15.0
"""Least change of a pixel by a motion for the pixel to be evidence for or against that motion [grey levels]."""

TELLING_PART = 0.01
"""Least fraction of the frame that such pixels must cover."""

STAYS_PART = 2.0 / 3.0
"""Fraction of such pixels that standing still must explain better; against a motion that nothing has, it explains about half better."""

BLOCKS = 8
"""Number of blocks along each side of the frame, which count alike: a moving camera affects all, one large moving thing only some."""

TELLING_BLOCK = 0.02
"""Least fraction of such pixels in a block for it to count."""


def stands_still(frames: Frames, camera: Camera, around: np.ndarray) -> bool:
    """Whether the camera stands still over the clip.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB.
        camera: if it has one matrix per frame, the camera moves.
        around: (H, W) bool, where the object is in frame 0, so that corners there are not used.
    """
    if np.ndim(camera.camera_to_world) == 3:
        return False
    if around.all():
        return True
    first = cv2.cvtColor(frames[0], cv2.COLOR_RGB2GRAY)
    corners = surrounding_corners(first, around, 8.0)
    if corners is None:
        # No corners (a plain studio wall, in front of which another thing may move): a moving camera would still change most pixels.
        return bool(np.median(cv2.absdiff(frames[0], frames[-1])[~around]) < 3)
    moves: dict[int, np.ndarray] = {}
    for t in np.unique(np.linspace(1, len(frames) - 1, 4).astype(int)):
        gray = cv2.cvtColor(frames[t], cv2.COLOR_RGB2GRAY)
        moved, found, _ = cv2.calcOpticalFlowPyrLK(first, gray, corners, None, winSize=(15, 15), maxLevel=3)
        here, there = (xy[found.ravel() > 0].reshape(-1, 2) for xy in (corners, moved))
        if (np.linalg.norm(there - here, axis=1) < STILL).sum() < STILL_PART * len(corners):
            motion = _most_shared(here, there)
            if motion is None:
                return False
            moves[int(t)] = motion
    return not moves or _stays(frames, moves, around)


def path_doubt(frames: Frames, camera: Camera, around: np.ndarray, distance: float) -> Doubt | None:
    """The doubt to report if the poses of `camera` would move still things across the view, but the surroundings do not move there.

    Args:
        frames, around: as for `stands_still`.
        distance: the object's [m]; things much farther away hardly show that a camera travels.
    """
    if np.ndim(camera.camera_to_world) != 3:
        return None
    middle = np.array([camera.cx, camera.cy])
    there = camera.unproject(middle, np.array(distance))
    way = np.array([camera.project(there, t)[0] for t in range(len(frames))]) - middle
    most = float(np.linalg.norm(way, axis=1).max())
    still = replace(camera, camera_to_world=camera.pose(0))
    # A plain wall looks alike wherever the camera is.
    plain = surrounding_corners(cv2.cvtColor(frames[0], cv2.COLOR_RGB2GRAY), around, 8.0) is None
    if not most > CARRIED or plain or not stands_still(frames, still, around):
        return None
    return Doubt(
        1.3,
        f"By the camera's path, still things would move by {most:.0f} px, but the surroundings do not move in the frames, so the object is "
        "taken to move along with the camera.",
        "Give the --camera of this clip, or none if it stood still. If all that is seen round it is far away, this may be right.",
    )


def _most_shared(here: np.ndarray, there: np.ndarray) -> np.ndarray | None:
    """The similarity (2, 3) that moves most of the points `here` (K, 2) [px] to `there` (K, 2), as a camera would; None if none does."""
    if len(here) < 3:
        return None
    cv2.setRNGSeed(0)
    motion, _ = cv2.estimateAffinePartial2D(here, there, ransacReprojThreshold=STILL)
    return motion


def _stays(frames: Frames, moves: dict[int, np.ndarray], around: np.ndarray) -> bool:
    """Whether the surroundings look more as if the camera had stood still than as if it had made the `moves`, maps (2, 3) by frame.

    All sharp corners may be on things that move by themselves, while the background is out of focus, without corners, and still.
    """
    height, width = around.shape
    scale = min(1.0, WIDEST / max(height, width))
    size = (round(width * scale), round(height * scale))

    def seen(t: int) -> np.ndarray:
        return cv2.GaussianBlur(cv2.resize(np.array(frames[t]), size, interpolation=cv2.INTER_AREA), (0, 0), 1.0)

    def away(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return cv2.absdiff(one, other).max(axis=2)

    off = cv2.resize((~around).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    first, stays, telling = seen(0), list[np.ndarray](), 0
    for t, motion in moves.items():
        matrix = motion.copy()
        # Pixel centres are at integers.
        matrix[:, 2] = scale * motion[:, 2] + 0.5 * (scale - 1.0) * (1.0 - motion[:, :2].sum(axis=1))
        carried, now = cv2.warpAffine(first, matrix, size, borderMode=cv2.BORDER_REPLICATE), seen(t)
        tells = off & (away(carried, first) > TELLS)
        telling += int(tells.sum())
        better = tells & (away(now, first) < away(now, carried))
        told, stood = (cv2.resize(one.astype(np.float32), (BLOCKS, BLOCKS), interpolation=cv2.INTER_AREA) for one in (tells, better))
        stays.append(stood[told > TELLING_BLOCK] / told[told > TELLING_BLOCK])
    shares = np.concatenate(stays)
    return telling > TELLING_PART * first[..., 0].size and len(shares) > 0 and float(np.median(shares)) > STAYS_PART
