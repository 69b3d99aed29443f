"""Another thing that moves and touches the object: its pull or push would be taken for a force of the field."""

from __future__ import annotations

import cv2
import numpy as np

from ....conventions import frame_named
from ....masks import Masks, areas
from ....records import Doubt
from ...mask.background import Plate
from ...mask.cutting import opened
from ...mask.motion import cut, window_of, within
from ..stored import Frames, some_of

LOOKS = 9
"""Number of frames examined, spread over the clip."""

RIM, REACH = 0.03, 0.5
"""Distances from the outline up to which a blurred rim may reach, and up to which another thing is sought, in units of the root of the
object's area."""

DIFFERS = 6.0
"""Least difference of another thing from the background [times the noise]."""

LEAST = 0.04
"""Least area of another thing within REACH, in units of the object's."""

SWALLOWS = 1.5
"""Growth of the object's area, beside such a thing, from which a part of that thing is suspected in the outline."""


def touching(frames: Frames, masks: Masks, plate: Plate) -> Doubt | None:
    """The doubt to report if, in most frames, something other than a shadow differs from the background right beside the object.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; masks: (T+1, H, W) bool, the object in them; plate: the background.
    """
    chosen = [int(t) for t in some_of(len(frames), LOOKS) if masks[int(t)].any()]
    seen = [_beside(frames[t], masks[t], plate) for t in chosen]
    if not seen or np.mean([share > LEAST for share in seen]) <= 0.5:
        return None
    because = (
        f"Something else moves and touches the object ({100 * float(np.median(seen)):.0f} % of its area, beside it): if it is a rope, a "
        "hand or another thing, its pull is taken for a force of the field."
    )
    sizes = areas(masks[t] for t in chosen)
    if (grown := sizes.max() / sizes[0]) < SWALLOWS:
        return Doubt(0.65, because, "Mark both as one object, or mark where it is held.")
    worst = frame_named(chosen[int(sizes.argmax())])
    return Doubt(
        0.9,
        f"{because} In {worst}, the object's outline has {grown:.1f} times its first area, so a part of that thing may be in it.",
        "Look at the film, and correct the outline where it is wrong. Else mark both as one object, or mark where it is held.",
    )


def _beside(frame: np.ndarray, mask: np.ndarray, plate: Plate) -> float:
    """Area of other moving things that touch the object `mask` (H, W) bool, in units of the object's area."""
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
