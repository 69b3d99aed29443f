"""Where the object seems to be held, from its motion: what it never leaves, at the frame's edge or at the still end of its swing."""

from __future__ import annotations

import cv2
import numpy as np

from ...records import Observation

STAYS = 0.95
"""Part of the frames in which a pixel has to be the object's for the object to stay there."""

STILL, STILL_PIXELS = 0.05, 0.5
"""Swing of a held end, in units of what the liveliest parts swing by and, at least, in pixels: a stem that is bent at its tip is that still
over its lowest fifth, and a track's error is no swing."""

LEAST_SWING = 2.0
"""Pixels of swing below which nothing can be said."""

DEEP = 0.04
"""Depth of a proposed place at the frame's edge, in units of the object's longer side."""

NEAR = 4
"""Pixels from the frame's edge within which an outline reaches it: half-covered rows are left out of it."""

FEWEST = 4
"""Tracks of frame 0 from which a swing can be measured."""


def swings(seen: Observation) -> tuple[np.ndarray, np.ndarray]:
    """Places (K, 2) [px] in frame 0 of the tracks that start there, and how far each strays from its mean place (K,) [px]."""
    early = np.flatnonzero(seen.visible[0] & ~seen.on_centroid & (seen.visible.sum(axis=0) >= 3))
    places = np.where(seen.visible[:, early, None], seen.xy[:, early], np.nan)
    away = np.linalg.norm(places - np.nanmean(places, axis=0), axis=-1)
    return seen.xy[0, early], np.nanpercentile(away, 90, axis=0) if len(early) else np.zeros(0)


def propose_held(seen: Observation) -> np.ndarray | None:
    """The pixels (H, W) bool of frame 0 that seem to be held; None where nothing does, or too little moves to tell.

    The object's pixels that it never leaves, where they reach the frame's edge; else those at its still end, where the tracks there
    swing by next to nothing.
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
    from scipy.spatial import cKDTree  # slow to import, and most of what is held reaches the frame's edge

    near, index = cKDTree(points).query(np.stack([columns, rows], axis=1), k=min(3, len(points)))
    quiet = np.mean(swing[index.reshape(len(rows), -1)], axis=1) < max(STILL_PIXELS, STILL * np.percentile(swing, 90))
    place = np.zeros_like(first)
    place[rows[quiet], columns[quiet]] = True
    count, labels, stats, _ = cv2.connectedComponentsWithStats(place.astype(np.uint8))
    if count < 2 or stats[1:, cv2.CC_STAT_AREA].max() < 12:
        return None
    return labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))


def _at_edge(kept: np.ndarray, deep: int) -> np.ndarray:
    """The pixels of `kept` (H, W) bool within `deep` of an edge of the frame that `kept` touches."""
    place = np.zeros_like(kept)
    for turn in range(4):
        turned, at = np.rot90(kept, turn), np.rot90(place, turn)  # views
        if turned[:NEAR].sum() >= 3:
            at[:deep] |= turned[:deep]
    return place
