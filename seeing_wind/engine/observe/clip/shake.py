"""A hand-held camera that turns a little: its turns are measured on the surroundings, removed from the frames, and kept as camera poses.

A hand's tremble is mostly rotation, whose effect on the frame, the homography K R K^-1, does not depend on how far away things are.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from ...masks import Masks
from ...progress import Journal, Progress
from ...records import Camera, Recognised
from .stored import Frames, each

LEAST_CORNERS = 8
LEAST_PART = 0.4
"""Fraction of the corners that must share a motion for it to be the camera's."""

LEAST_SPAN = 0.4
"""Fraction of the frame's width or height that the middle nine tenths of the corners must span: if less, all may be on one moving thing."""

CLOSE = 1.0
"""Distance [px] up to which a corner agrees with the common motion."""

SPIKE = 6.0
"""Distance of a turn from the mean of its neighbours, in units of the clip's median one, from which it is a mistake."""

LARGEST_TURN = 0.1
"""Shift, in units of the frame's width, beyond which the camera does not tremble but moves, with a parallax that turns cannot explain."""


def surrounding_corners(gray: np.ndarray, around: np.ndarray, apart: float) -> np.ndarray | None:
    """Corners (K, 1, 2) [px] of the object's surroundings, for measuring the camera's motion; None if there are too few.

    Args:
        gray: (H, W) uint8, frame 0.
        around: (H, W) bool, where the object is.
        apart: least distance between two corners [px].
    """
    corners = cv2.goodFeaturesToTrack(gray, 200, 0.01, apart, mask=np.where(around, 0, 255).astype(np.uint8))
    if corners is None or len(corners) < LEAST_CORNERS:
        return None
    span = np.ptp(np.percentile(corners.reshape(-1, 2), (5, 95), axis=0), axis=0) / gray.shape[::-1]
    return corners if span.max() >= LEAST_SPAN else None


def there_and_back(
    first: np.ndarray, gray: np.ndarray, corners: np.ndarray, places: np.ndarray, close: float
) -> tuple[np.ndarray, np.ndarray]:
    """The places (K, 1, 2) [px] in the frame `gray` of `corners` (K, 1, 2) [px] in `first`, both frames (H, W) uint8, sought from `places`
    (K, 1, 2); and which of them return to within `close` [px] when they are tracked back, (K,) bool."""

    def flow(before: np.ndarray, after: np.ndarray, here: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found, seen, _ = cv2.calcOpticalFlowPyrLK(
            before, after, here, there.copy(), winSize=(21, 21), maxLevel=3, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        )
        return found, seen.ravel() > 0

    moved, seen = flow(first, gray, corners, places)
    back, again = flow(gray, first, moved, moved + (corners - places))
    return moved, seen & again & (np.linalg.norm((back - corners).reshape(-1, 2), axis=1) < close)


def camera_turns(frames: Frames, camera: Camera, around: np.ndarray, progress: Progress, journal: Journal) -> np.ndarray | None:
    """Rotations (T+1, 3, 3) from each frame's camera axes to those of frame 0; None if rotations do not explain the motion.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB.
        camera: gives the focal length and the centre.
        around: (H, W) bool, where the object is in frame 0, so that corners there are not used.
    """
    first = cv2.cvtColor(frames[0], cv2.COLOR_RGB2GRAY)
    width = first.shape[1]
    corners = surrounding_corners(first, around, max(8.0, width / 40))
    if corners is None:
        return None
    loop = journal.loop("camera turns")
    done, kept = loop.resume()
    turns = list(kept["turns"]) if done else [np.eye(3)]
    for t in range(done + 1, len(frames)):
        progress.check()
        gray = cv2.cvtColor(frames[t], cv2.COLOR_RGB2GRAY)
        moved, sure = there_and_back(first, gray, corners, corners, 0.5)
        if sure.sum() < LEAST_CORNERS:
            return None
        here, there = moved.reshape(-1, 2)[sure].astype(np.float64), corners.reshape(-1, 2)[sure].astype(np.float64)
        cv2.setRNGSeed(0)
        fit, agree = cv2.estimateAffinePartial2D(here, there, ransacReprojThreshold=CLOSE)
        if fit is None or agree.sum() < max(LEAST_CORNERS, LEAST_PART * sure.sum()):
            return None
        turn = _turn(here[agree.ravel() > 0], there[agree.ravel() > 0], camera)
        if np.linalg.norm(turn[:2, 2] / turn[2, 2]) * camera.fx > LARGEST_TURN * width:
            return None
        turns.append(turn)
        loop.reached(t, lambda: {"turns": np.stack(turns)})
    return without_spikes(np.stack(turns), camera)


def without_spikes(turns: np.ndarray, camera: Camera) -> np.ndarray:
    """`turns` (T+1, 3, 3), with those that jump away and back in one frame replaced by the mean of their neighbours.

    A hand has mass and cannot jump; but where few corners are left, some may agree by chance on a wrong turn.
    """
    vectors = np.stack([cv2.Rodrigues(turn)[0].ravel() for turn in turns])
    pixels = np.array([camera.fy, camera.fx, 0.5 * camera.width])
    for _ in range(len(turns) // 4):
        middle = 0.5 * (vectors[:-2] + vectors[2:])
        off = np.linalg.norm((vectors[1:-1] - middle) * pixels, axis=1)
        worst = int(np.argmax(off))
        if off[worst] <= max(2.0 * CLOSE, SPIKE * float(np.median(off))):
            break
        vectors[worst + 1] = middle[worst]
        turns = turns.copy()
        turns[worst + 1] = cv2.Rodrigues(middle[worst])[0]
    return turns


def _turn(here: np.ndarray, there: np.ndarray, camera: Camera) -> np.ndarray:
    """The rotation (3, 3) from the rays of pixels `here` (M, 2) to those of `there` (M, 2): Wahba's problem, by SVD with Cauchy weights."""
    rays = [
        np.stack([(xy[:, 0] - camera.cx) / camera.fx, (xy[:, 1] - camera.cy) / camera.fy, np.ones(len(xy))], axis=1) for xy in (here, there)
    ]
    first, second = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays)
    weight = np.ones(len(here))
    turn = np.eye(3)
    for _ in range(4):
        u, _, vt = np.linalg.svd((second * weight[:, None]).T @ first)
        turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        off = np.linalg.norm(through(homography(turn, camera), here) - there, axis=1)
        weight = 1.0 / (1.0 + (off / (0.3 * CLOSE)) ** 2)
    return turn


def homography(turn: np.ndarray, camera: Camera) -> np.ndarray:
    """K R K^-1 (3, 3), from a frame's pixels to those of frame 0, for the rotation `turn` R (3, 3)."""
    k = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    return k @ turn @ np.linalg.inv(k)


def through(matrix: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Points xy (..., K, 2) transformed by homographies (..., 3, 3)."""
    out = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1) @ matrix.swapaxes(-1, -2)
    return out[..., :2] / out[..., 2:]


def stabilise(frames: Frames, turns: np.ndarray, camera: Camera, progress: Progress) -> Frames:
    """All frames as the camera of frame 0 would have seen them, (T+1, H, W, 3) uint8."""

    def steady(t: int, frame: np.ndarray) -> np.ndarray:
        matrix, size = homography(turns[t], camera), frame.shape[1::-1]
        return cv2.warpPerspective(frame, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)

    return each(frames, steady, progress)


def through_mask(mask: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """A mask (H, W) bool transformed by a homography (3, 3)."""
    return cv2.warpPerspective(mask.astype(np.uint8), matrix, mask.shape[::-1], flags=cv2.INTER_NEAREST) > 0


def as_filmed(
    xy: np.ndarray, masks: Masks, recognised: Recognised | None, turns: np.ndarray, camera: Camera
) -> tuple[np.ndarray, Masks, Recognised | None]:
    """Tracks (T+1, K, 2), masks (T+1, H, W) and recognised points, from the pixels of the stabilised frames to those of the filmed ones."""
    back = np.stack([np.linalg.inv(homography(turn, camera)) for turn in turns])
    filmed = Masks.of(through_mask(mask, matrix) for mask, matrix in zip(masks, back))
    again = None if recognised is None else recognised.moved(lambda points, frame: through(back[frame], points[:, None])[:, 0])
    return through(back, xy), filmed, again


def turning(camera: Camera, turns: np.ndarray) -> Camera:
    """`camera` with one pose per frame, rotated in place by `turns` (T+1, 3, 3)."""
    poses = np.tile(camera.pose(0), (len(turns), 1, 1))
    poses[:, :3, :3] = poses[:, :3, :3] @ turns
    return replace(camera, camera_to_world=poses)
