"""Where the object seems to be held, from its motion: pixels that it never leaves, at the frame's edge or at the still end of its swing."""

from __future__ import annotations

import cv2
import numpy as np

from ...records import Observation

STAYS = 0.95
"""Fraction of the frames in which a pixel must belong to the object for the object to stay there."""

STILL, STILL_PIXELS = 0.05, 0.5
"""Largest swing of a held end, in units of the liveliest parts' swing, or in pixels if that is more: the lowest fifth of a stem that bends
at its tip is as still as that, and a track's error is not swing."""

LEAST_SWING = 2.0
"""Swing of the object below which a held place cannot be recognised [px]."""

DEEP = 0.04
"""Depth of a proposed place at the frame's edge, in units of the object's longer side."""

NEAR = 4
"""Distance [px] from the frame's edge within which an outline counts as reaching it: masks leave out half-covered rows."""

FEWEST = 4
"""Least number of tracks from frame 0 for measuring the swing."""


def swings(seen: Observation) -> tuple[np.ndarray, np.ndarray]:
    """Places (K, 2) [px] in frame 0 of the tracks that start there, and the swing of each, its distance from its mean place (K,) [px]."""
    early = np.flatnonzero(seen.visible[0] & ~seen.on_centroid & (seen.visible.sum(axis=0) >= 3))
    places = np.where(seen.visible[:, early, None], seen.xy[:, early], np.nan)
    away = np.linalg.norm(places - np.nanmean(places, axis=0), axis=-1)
    return seen.xy[0, early], np.nanpercentile(away, 90, axis=0) if len(early) else np.zeros(0)


def propose_held(seen: Observation) -> np.ndarray | None:
    """The pixels (H, W) bool of frame 0 that seem to be held; None if none do, or if too little moves to tell.

    These are the pixels that the object never leaves, if they reach the frame's edge: the part near that edge. Otherwise they are those of
    its still end, where tracks hardly swing.
    """
    points, swing = swings(seen)
    if len(points) < FEWEST or np.percentile(swing, 90) < LEAST_SWING:
        return None
    first = np.asarray(seen.masks[0])
    stays = np.zeros(first.shape, np.int32)
    for mask in seen.masks:
        stays += mask
    kept = first & (stays >= STAYS * len(seen.masks))
    edge = _at_edge(kept, max(3, round(DEEP * max(np.ptp(axis) for axis in np.nonzero(first)))))
    if edge.any():
        return edge
    rows, columns = np.nonzero(kept)
    if not len(rows):
        return None
    from scipy.spatial import cKDTree  # slow to import, and most held places reach the frame's edge

    near, index = cKDTree(points).query(np.stack([columns, rows], axis=1), k=min(3, len(points)))
    quiet = np.mean(swing[index.reshape(len(rows), -1)], axis=1) < max(STILL_PIXELS, STILL * np.percentile(swing, 90))
    place = np.zeros_like(first)
    place[rows[quiet], columns[quiet]] = True
    count, labels, stats, _ = cv2.connectedComponentsWithStats(place.astype(np.uint8))
    if count < 2 or stats[1:, cv2.CC_STAT_AREA].max() < 12:
        return None
    return labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))


def _at_edge(kept: np.ndarray, deep: int) -> np.ndarray:
    """The pixels of `kept` (H, W) bool within `deep` [px] of any edge of the frame that `kept` touches, (H, W) bool."""
    place = np.zeros_like(kept)
    for turn in range(4):
        turned, at = np.rot90(kept, turn), np.rot90(place, turn)  # views: writing to `at` fills `place`
        if turned[:NEAR].sum() >= 3:
            at[:deep] |= turned[:deep]
    return place
