"""The background behind the object in every frame of the re-simulated clip."""

from __future__ import annotations

import cv2
import numpy as np

from ...records import Observation
from ..over_clip import Box

INPAINT = 5
"""Radius [px] of the inpainting behind the object, where a moving camera gives no clean background."""

LIGHT = 2.0
"""Standard deviation [px] of the blur that reduces a frame to the light on the background: the edges of shadows stay, texture does not."""

FAR = 6.0
"""The same over `LIGHT`, for the far light, which is used where the object hides the background nearby."""

RANGE = 4.0
"""Light may change by at most this factor either way; a larger change is another moving thing, of which only a faint trace is shown."""

FAINT = 0.01
"""Weight of the far light everywhere; it only matters where no near light is seen."""


REACH = 64
"""Pixels around a box on which the light or the inpainting inside it can depend: four deviations of the far light, and a margin."""


def behind(observation: Observation, t: int, image: np.ndarray, box: Box | None = None) -> np.ndarray:
    """The background of frame t, (H, W, 3) uint8 RGB, or only the part in `box`, (h, w, 3).

    For a camera that stands still it is the clean plate in the light of that frame: shadows, above all the object's own, are not
    simulated but measured, and so other moving things leave a blurred trace. For a moving camera it is the frame itself with the object
    inpainted.

    Args:
        image: (H, W, 3) uint8 RGB, frame t without lens distortion, at the observation's size.
    """
    height, width = image.shape[:2]
    x0, y0, x1, y1 = box or (0, 0, width, height)
    # Multiples of four, so that the frame reduced four times has the same pixels as without a box.
    left, top = max(x0 - REACH, 0) // 4 * 4, max(y0 - REACH, 0) // 4 * 4
    near = (slice(top, min(y1 + REACH, height)), slice(left, min(x1 + REACH, width)))
    image, mask = image[near], observation.masks[t][near]
    if np.ndim(observation.camera.camera_to_world) == 3:
        found = without_object(image, mask)
    else:
        found = relit(observation.background[near], image, mask)
    return found[y0 - top : y1 - top, x0 - left : x1 - left]


def without_object(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """A frame (H, W, 3) uint8 with the object inpainted (Telea 2004)."""
    hidden = cv2.dilate(mask.astype(np.uint8), np.ones((9, 9), np.uint8))
    return cv2.inpaint(np.ascontiguousarray(image), hidden, INPAINT, cv2.INPAINT_TELEA)


def relit(plate: np.ndarray, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The plate (H, W, 3) uint8 in the light of `image`: multiplied by the ratio of the two, blurred, outside the object's `mask`."""
    off = (cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0).astype(np.float32)[..., None]
    now, usual = _light(image * off), _light(plate * off)
    ratio = np.clip((now + FAINT) / (usual + FAINT), 1.0 / RANGE, RANGE)
    return np.clip(np.round(plate * ratio), 0, 255).astype(np.uint8)


def _light(frame: np.ndarray) -> np.ndarray:
    """The frame blurred by `LIGHT`, plus `FAINT` times the far light, which is blurred in a frame reduced four times."""
    height, width = frame.shape[:2]
    small = cv2.resize(frame, (max(width // 4, 1), max(height // 4, 1)), interpolation=cv2.INTER_AREA)
    far = cv2.resize(cv2.GaussianBlur(small, (0, 0), FAR * LIGHT / 4), (width, height), interpolation=cv2.INTER_LINEAR)
    return cv2.GaussianBlur(frame, (0, 0), LIGHT) + FAINT * far
