"""Tracks from a file or a network that start on the object and later leave its outline, because they follow something else by then.

Such a track may move so smoothly that a force explains it. Outlines are wrong, too, so a track is given up only where the outline can be
relied on: where most of the corners found in frame 0 are still followed within it or, without such corners, where it contains most of the
tracks. A track that moves with its neighbours within the outline is on the object, whatever the outline says.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...conventions import frame_named
from ...masks import Masks
from ...records import Doubt
from .neighbours import LEAST, predict

DEVIATIONS = 3.0
"""Distance from the outline [standard deviations of the track] up to which a track may still be on the object."""

BLURRED, RIM = 3.0, 0.03
"""Distances by which the rim of a good outline may be off: in pixels, and in units of the root of the object's area; the larger counts."""

LONG, SHARE = 5, 3
"""A track is given up once it is outside for LONG frames in a row, of those that can be judged; in a short clip, for one in SHARE of its
frames in a row."""

RELIABLE = 0.5
"""Least fraction of corners, or else of tracks, within an outline that can be relied on."""

FEWEST = 8
"""Least number of corners that show whether an outline can be relied on: the same as in `preview.verdicts`."""

MANY = 0.25
"""Fraction of the tracks that leave the outline from which there is a doubt."""


@dataclass(frozen=True)
class Outside:
    """Which of K tracks leave the outline."""

    left: np.ndarray
    """(K,) frame from which a track is given up; T+1 for one that is not."""
    disputed: np.ndarray
    """(K,) frame from which a track is outside an outline that cannot be relied on; T+1 for one that is not."""

    def visible(self, visible: np.ndarray) -> np.ndarray:
        """`visible` (T+1, K) bool without the tracks that are given up, from the frame on in which they are."""
        return visible & (np.arange(len(visible))[:, None] < self.left)

    def note(self, name: str, frames: int) -> str:
        """A sentence on the tracks of `name` that are given up in a clip of so many `frames`; "" if there are none."""
        gone = self.left < frames
        if not gone.any():
            return ""
        return (
            f"{int(gone.sum())} of {len(gone)} tracks of {name} leave the outline, the first in {frame_named(int(self.left.min()))}, and "
            "are left out from there on."
        )

    def doubt(self, name: str, frames: int) -> Doubt | None:
        """The doubt about the tracks of `name`, in a clip of so many `frames`, if many of them leave the outline."""
        gone, unclear = self.left < frames, self.disputed < frames
        if gone.mean() >= MANY:
            what = "they follow something else by then, or the outline misses a part of the object."
            return Doubt(0.5 + float(gone.mean()), f"{self.note(name, frames)[:-1]}: {what}", "Compare both in the film, and correct one.")
        if unclear.mean() < MANY:
            return None
        return Doubt(
            0.5 + float(unclear.mean()),
            f"{int(unclear.sum())} of {len(unclear)} tracks of {name} are outside the outline from {frame_named(int(self.disputed.min()))} "
            "on, where the outline may be wrong as well, so all are used.",
            "Compare both in the film, and correct one.",
        )


def outside(xy: np.ndarray, visible: np.ndarray, sigma: np.ndarray, masks: Masks, corners: np.ndarray) -> Outside:
    """Compare tracks with the object's outline.

    Args:
        xy: (T+1, K, 2) [px]; visible: (T+1, K) bool; sigma: (T+1, K) [px].
        masks: (T+1, H, W) bool, in the same pixels.
        corners: (T+1, C) bool: in which frames the corners found on the object in frame 0 are followed within the outline.
    """
    count, tracks = visible.shape
    off = np.zeros((count, tracks), bool)
    judged, reliable = np.zeros((count, tracks), bool), np.zeros(count, bool)
    affine = np.tile(np.eye(2), (tracks, 1, 1))
    for t in range(count):
        mask = masks[t]
        if not mask.any():
            continue
        judged[t] = visible[t]
        allowed = DEVIATIONS * sigma[t] + max(BLURRED, RIM * float(np.sqrt(np.count_nonzero(mask))))
        off[t] = visible[t] & (_distance(mask, xy[t]) > allowed)
        within = visible[t] & ~off[t]
        if off[t].any() and within.any():
            predicted, affine, support = predict(xy[0], xy[t], within, affine, float("inf"))
            off[t] &= (support < LEAST) | (np.linalg.norm(xy[t] - predicted, axis=1) > allowed)
        share = corners[t].mean() if corners.shape[1] >= FEWEST else within.sum() / max(int(visible[t].sum()), 1)
        reliable[t] = share >= RELIABLE
    left = _first_long(off, judged & reliable[:, None])
    return Outside(left, np.where(left < count, count, _first_long(off, judged & ~reliable[:, None])))


def _distance(mask: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Distances (K,) [px] of points xy (K, 2) from a mask (H, W) bool; of points beyond the frame, that of its nearest pixel."""
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    column, row = (np.clip(np.rint(xy[:, axis]), 0, mask.shape[1 - axis] - 1).astype(int) for axis in (0, 1))
    return away[row, column]


def long(count: int) -> int:
    """Number of frames in a row for which a track is outside before it is given up, in a clip of `count` frames."""
    return min(LONG, max(2, -(-count // SHARE)))


def _first_long(off: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """(K,) the frame in which each track is `off` (T+1, K) bool for `long` of its `judged` (T+1, K) bool frames in a row; T+1 if never."""
    first, run = np.full(off.shape[1], len(off)), long(len(off))
    for k in range(off.shape[1]):
        frames = np.flatnonzero(judged[:, k])
        runs = np.lib.stride_tricks.sliding_window_view(off[frames, k], run).all(axis=1) if len(frames) >= run else np.zeros(0, bool)
        if runs.any():
            first[k] = frames[int(runs.argmax())]
    return first
