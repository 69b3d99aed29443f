"""The background of a camera that moves: what was seen beside the object so far, carried along with the surroundings."""

from __future__ import annotations

import cv2
import numpy as np

from ..background import SIGHTS, Plate, largest
from ..cutting import grown
from .registered import corners_beside, homography_to

FRESH = 0.5
"""Weight of the newest frame in the background's colour: older ones were blurred by being carried along."""

AGREES = 4.0
"""Difference [times the noise] up to which a frame agrees with what was seen before; what differs more is at another depth, or moves."""


class PannedPlate:
    """The background from frame to frame, known where it looked alike the last three times that it was seen."""

    def __init__(self, frame: np.ndarray, mask: np.ndarray, plate: Plate) -> None:
        """`frame` (H, W, 3) uint8 RGB, `mask` (H, W) bool and `plate`, the background as far as it is known, are frame 0's."""
        self._gray, self._mask = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), mask
        self._color, self._noise = plate.color, plate.noise
        self._sights = np.where(plate.reliable & ~grown(mask), np.uint8(SIGHTS), np.uint8(0))

    def carried(self, gray: np.ndarray) -> Plate:
        """The background as seen in the next frame, `gray` (H, W) uint8; unknown everywhere if the camera's motion cannot be found."""
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
        """Add what `frame` (H, W, 3) uint8 RGB shows beside the object, now that its `mask` (H, W) bool is known."""
        off = ~grown(mask)
        now, before = (cv2.GaussianBlur(one, (0, 0), 1.0) for one in (frame, self._color))
        alike = largest(cv2.absdiff(now, before)) < AGREES * self._noise
        mixed = cv2.addWeighted(frame, FRESH, self._color, 1.0 - FRESH, 0.0)
        self._color = np.where(off[..., None], np.where((alike & (self._sights > 0))[..., None], mixed, frame), self._color)
        more = np.where(alike, np.minimum(self._sights, 254) + np.uint8(1), np.uint8(1))
        self._sights, self._mask = np.where(off, more, self._sights).astype(np.uint8), mask

    def state(self) -> dict[str, np.ndarray]:
        """All that later frames depend on, besides the newest frame."""
        return {"behind.color": self._color, "behind.sights": self._sights, "behind.mask": self._mask}

    def resume(self, frame: np.ndarray, state: dict[str, np.ndarray]) -> None:
        """Continue after `frame` (H, W, 3) uint8 RGB as the plate that returned `state` would have."""
        self._gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        self._color, self._sights, self._mask = state["behind.color"], state["behind.sights"], state["behind.mask"]
