"""What is behind the object before a camera that moves: what was seen beside it so far, carried along with the surroundings."""

from __future__ import annotations

import cv2
import numpy as np

from ..background import SIGHTS, Plate, largest
from ..cutting import grown
from .registered import corners_beside, homography_to

FRESH = 0.5
"""Weight of the newest sight of the background: older ones are blurred by having been carried along."""

AGREES = 4.0
"""Times the noise up to which a frame shows what was seen there before; what does not is at another depth, or moves itself."""


class PannedPlate:
    """The background, from frame to frame. It is known where it was seen three times, and each time alike."""

    def __init__(self, frame: np.ndarray, mask: np.ndarray, plate: Plate) -> None:
        """`frame` (H, W, 3) uint8 RGB and `mask` (H, W) bool of frame 0; `plate`: what is known of the background there."""
        self._gray, self._mask = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), mask
        self._color, self._noise = plate.color, plate.noise
        self._sights = np.where(plate.reliable & ~grown(mask), np.uint8(SIGHTS), np.uint8(0))

    def carried(self, gray: np.ndarray) -> Plate:
        """As the camera has it behind the object in the next frame, of which `gray` (H, W) uint8 is given; unknown where it is lost."""
        corners = corners_beside(self._gray, self._mask)
        there = None if corners is None else homography_to(self._gray, gray, corners, corners)
        size = gray.shape[::-1]
        if there is None:
            self._sights = np.zeros_like(self._sights)
        else:
            self._color = cv2.warpPerspective(self._color, there, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            self._sights = cv2.warpPerspective(self._sights, there, size, flags=cv2.INTER_NEAREST)
        self._gray = gray
        return Plate(self._color, self._sights >= SIGHTS, self._noise)

    def learn(self, frame: np.ndarray, mask: np.ndarray) -> None:
        """Take what `frame` (H, W, 3) uint8 RGB shows beside the object, whose `mask` (H, W) bool in it is known by now."""
        off = ~grown(mask)
        now, before = (cv2.GaussianBlur(one, (0, 0), 1.0) for one in (frame, self._color))
        alike = largest(cv2.absdiff(now, before)) < AGREES * self._noise
        mixed = cv2.addWeighted(frame, FRESH, self._color, 1.0 - FRESH, 0.0)
        self._color = np.where(off[..., None], np.where((alike & (self._sights > 0))[..., None], mixed, frame), self._color)
        more = np.where(alike, np.minimum(self._sights, 254) + np.uint8(1), np.uint8(1))
        self._sights, self._mask = np.where(off, more, self._sights).astype(np.uint8), mask

    def state(self) -> dict[str, np.ndarray]:
        """All that the frames to come depend on, besides the newest frame."""
        return {"behind.color": self._color, "behind.sights": self._sights, "behind.mask": self._mask}

    def resume(self, frame: np.ndarray, state: dict[str, np.ndarray]) -> None:
        """Go on behind `frame` (H, W, 3) uint8 RGB as what gave `state` would have."""
        self._gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        self._color, self._sights, self._mask = state["behind.color"], state["behind.sights"], state["behind.mask"]
