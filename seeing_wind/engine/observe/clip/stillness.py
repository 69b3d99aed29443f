"""Whether the camera stands still: corners of the surroundings stay, or that explains more of the surroundings than any motion does."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from ...records import Camera, Doubt
from .shake import surrounding_corners
from .stored import Frames

STILL = 1.5
"""Pixels by which corners of the surroundings may move for the camera to count as standing still; the plate bears as much."""

CARRIED = 6.0
"""Pixels by which a camera's path has to move what stands still to be told from its surroundings that stay: a solve is off by some."""

STILL_PART = 0.3
"""Part of the corners that must stay: the rest may belong to other things that move, while a camera that moves carries all along."""

WIDEST = 640
"""Pixels along the longer side of the copies in which surroundings are compared."""

TELLS = 15.0
"""Grey levels by which a motion has to change a pixel for that pixel to speak for or against it."""

TELLING_PART = 0.01
"""Least part of the frame in such pixels."""

STAYS_PART = 2.0 / 3.0
"""Part of such pixels that standing still has to explain better: of a motion that nothing has, about half are explained worse."""

BLOCKS = 8
"""Parts of the frame along each side that count alike: a camera that moves carries all of them, one large thing that moves only some."""

TELLING_BLOCK = 0.02
"""Least part of a block in pixels that tell for it to count."""


def stands_still(frames: Frames, camera: Camera, around: np.ndarray) -> bool:
    """True when the camera does not move over the clip.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB.
        camera: its matrices decide when they say that it moves.
        around: (H, W) bool, where the object is in frame 0 and corners are not to be trusted.
    """
    if np.ndim(camera.camera_to_world) == 3:
        return False
    if around.all():
        return True
    first = cv2.cvtColor(frames[0], cv2.COLOR_RGB2GRAY)
    corners = surrounding_corners(first, around, 8.0)
    if corners is None:
        # Nothing to hold on to (a plain studio wall, before which another thing may move): a moving camera would still shift what there is.
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


def contradicted(frames: Frames, camera: Camera, around: np.ndarray, distance: float) -> Doubt | None:
    """Said where the poses of `camera` carry what stands still across the view, while the surroundings stay where they are in the frames.

    Args:
        frames, around: as of `stands_still`.
        distance: of the object [m]; what lies much farther away hardly shows that a camera travels.
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
        f"The camera's path carries what stands still by {most:.0f} px, but the surroundings do not move in the frames, so the object is "
        "taken to move along with the camera.",
        "Give the --camera of this clip, or none if it stood still. If all that is seen round it is far away, this may be right.",
    )


def _most_shared(here: np.ndarray, there: np.ndarray) -> np.ndarray | None:
    """The similarity (2, 3) that carries most of the points `here` (K, 2) [px] to `there` (K, 2), as a camera's motion would."""
    if len(here) < 3:
        return None
    cv2.setRNGSeed(0)
    motion, _ = cv2.estimateAffinePartial2D(here, there, ransacReprojThreshold=STILL)
    return motion


def _stays(frames: Frames, moves: dict[int, np.ndarray], around: np.ndarray) -> bool:
    """Whether more of the surroundings looks as if the camera had stood still than as if it had made the `moves` (2, 3), by their frames.

    Sharp corners may all be of things that move, each by itself, while what is out of focus behind them stays and has none.
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
