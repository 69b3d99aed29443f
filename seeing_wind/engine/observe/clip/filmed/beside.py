"""Another thing that moves and touches the object: what it pulls or pushes counts as force of the field."""

from __future__ import annotations

import cv2
import numpy as np

from ....masks import Masks
from ....records import Doubt
from ...mask.background import Plate
from ...mask.cutting import opened
from ...mask.motion import cut, window_of, within
from ..stored import Frames, some_of

LOOKS = 9
"""Frames that are looked at, spread over the clip."""

RIM, REACH = 0.03, 0.5
"""How far from the outline a blurred rim may reach and another thing is looked for, in units of the root of the object's area."""

DIFFERS = 6.0
"""Times the noise by which it differs from the background."""

LEAST = 0.04
"""Its area, as far as it is within reach, in units of the object's."""


def touching(frames: Frames, masks: Masks, plate: Plate) -> Doubt | None:
    """Said where in most frames something that is no shadow differs from the background right beside the object.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; masks: (T+1, H, W) bool, the object in them; plate: the background.
    """
    chosen = some_of(len(frames), LOOKS)
    seen = [share for share in (_beside(frames[int(t)], masks[int(t)], plate) for t in chosen if masks[int(t)].any())]
    if not seen or np.mean([share > LEAST for share in seen]) <= 0.5:
        return None
    return Doubt(
        0.65,
        f"Something else moves and touches the object ({100 * float(np.median(seen)):.0f} % of its area, beside it): if it is a rope, a "
        "hand or another thing, what it pulls counts as the field's force.",
        "Mark both as one object, or mark where it is held.",
    )


def _beside(frame: np.ndarray, mask: np.ndarray, plate: Plate) -> float:
    """Area of what touches the object `mask` (H, W) bool, moves and is no part of it, in units of its own."""
    size = float(np.sqrt(mask.sum()))
    window = within(window_of(mask, round(REACH * size) + 4), frame)
    shape = cut(mask, window, cv2.BORDER_CONSTANT).astype(np.uint8)
    away, light = plate.compared(frame, window)
    away_from = cv2.distanceTransform(1 - shape, cv2.DIST_L2, 5)
    rim = max(3.0, RIM * size)
    differs = (away > DIFFERS * plate.noise) & (light == 0) & cut(plate.reliable, window, cv2.BORDER_CONSTANT)
    other = opened(differs & (away_from <= REACH * size) & (shape == 0))
    _, labels = cv2.connectedComponents(other.astype(np.uint8), connectivity=8)
    own = np.unique(labels[(away_from <= rim) & other])
    return float((np.isin(labels, own[own > 0]) & (away_from > rim)).sum() / mask.sum())
