"""Points of frame 0 that are recognised in later frames by what they look like, however often they were hidden in between.

A track ends where a fold hides its point, and when the point comes out again, the tracker does not know that it is the same. SIFT
descriptors (Lowe, Distinctive Image Features from Scale-Invariant Keypoints, IJCV 2004) find it again, without drift: those of frame 0 are
matched with those of every frame. A match that is hardly better than the second best is dropped (Lowe's ratio test), and so is a match
that its neighbours contradict.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from ...masks import Masks
from ...progress import Progress
from ...records import Recognised
from ..clip.stored import Frames
from .neighbours import disagreement, predict

LOST = 0.75
"""Fraction of frame 0's tracks: points are recognised only if fewer are in sight in some frame, as otherwise it would only cost time."""
FEATURES = 4000
"""Largest number of features in a frame."""
CONTRAST, EDGE = 0.015, 15.0
"""SIFT's thresholds, both more lenient than usual: a print is faint where it moves fast, and matches are checked."""
RATIO = 0.75
"""Largest distance between a match's descriptors, relative to that of the second best match."""
ODD = 3.0
"""Distance [px] from the neighbours' prediction from which a match is wrong."""
SUPPORT = 6
"""Least number of neighbours that predict a match."""
ROUNDS = 3
"""Number of rounds; in each, the neighbours are the matches left by the round before."""
THREADS = 2
"""Frames processed in parallel: OpenCV releases Python's lock."""


def are_lost(visible: np.ndarray) -> bool:
    """Whether too few of frame 0's tracks are in sight in some frame; `visible`: (T+1, K) bool."""
    early = visible[:, visible[0]]
    return bool(early.size) and float(early.mean(axis=1).min()) < LOST


def recognise(frames: Frames, masks: Masks, progress: Progress) -> Recognised:
    """The points of frame 0 that are recognised in later frames.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; masks: (T+1, H, W) bool, the object.
    """
    xy, look = _features(frames[0], masks[0])

    def matched(t: int) -> tuple[np.ndarray, np.ndarray]:
        progress.check()
        return _matched(xy, look, *_features(frames[t], masks[t]))

    with ThreadPoolExecutor(THREADS) as pool:
        found = []
        for t, pair in enumerate(pool.map(matched, range(1, len(frames)))):
            progress.update((t + 1) / len(frames), f"recognising points, frame {t + 1}")
            found.append(pair)
    counts = [len(first) for first, _ in found]
    first, now = (np.concatenate([np.zeros((0, 2)), *(pair[side] for pair in found)]) for side in (0, 1))
    return Recognised(np.repeat(np.arange(1, len(frames)), counts).astype(np.int32), first, now)


def _features(frame: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (M, 2) [px] and descriptors (M, 128) of the features on the object in a frame."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    none = np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    if not rows.size:
        return none
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    sift = cv2.SIFT.create(nfeatures=FEATURES, contrastThreshold=CONTRAST, edgeThreshold=EDGE)
    points, look = sift.detectAndCompute(cv2.cvtColor(frame[box], cv2.COLOR_RGB2GRAY), mask[box].astype(np.uint8))
    if look is None:
        return none
    return np.array([one.pt for one in points]) + [columns[0], rows[0]], look


def _matched(xy: np.ndarray, look: np.ndarray, xy_now: np.ndarray, look_now: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (M, 2) [px] in frame 0, and in another frame, of the points that are found in both."""
    if min(len(look), len(look_now)) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    pairs = cv2.BFMatcher().knnMatch(look, look_now, k=2)
    clear = [best for best, next_best in pairs if best.distance < RATIO * next_best.distance]
    first, now = xy[[one.queryIdx for one in clear]].reshape(-1, 2), xy_now[[one.trainIdx for one in clear]].reshape(-1, 2)
    for side in (0, 1):  # a place may have several descriptors, one for each orientation, but counts once
        _, once = np.unique(np.round((first, now)[side], 1), axis=0, return_index=True)
        first, now = first[once], now[once]
    return _agreeing(first, now)


def _agreeing(first: np.ndarray, now: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The matches, places (M, 2) in frame 0 and (M, 2) in another, that agree with a local affine motion of their neighbours."""
    good, shape = np.ones(len(first), bool), np.tile(np.eye(2), (len(first), 1, 1))
    reach = float(np.linalg.norm(np.ptp(first, axis=0))) if len(first) else 0.0
    for _ in range(ROUNDS):
        predicted, _, support = predict(first, now, good, shape, reach)
        good = (support >= SUPPORT) & (disagreement(now, predicted, support) < ODD)
    return first[good], now[good]
