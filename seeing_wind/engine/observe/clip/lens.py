"""Lens distortion (OpenCV's five-number model): frames, and masks, points and boxes given over them, are straightened on the way in."""

from __future__ import annotations

import cv2
import numpy as np

from ...progress import Progress
from ...records import Camera
from .stored import Frames, each


class Lens:
    """Maps between filmed pixels and those of the pinhole camera with the same focal length and centre.

    A camera without distortion leaves everything as it is.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self.bends = any(camera.distortion)
        self._matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
        self._maps: tuple[np.ndarray, np.ndarray] | None = None
        if self.bends:
            size = (camera.width, camera.height)
            self._maps = cv2.initUndistortRectifyMap(self._matrix, np.array(camera.distortion), None, self._matrix, size, cv2.CV_32FC1)

    def straight(self, frames: Frames, progress: Progress) -> Frames:
        """`frames` (T+1, H, W, 3) uint8 as the pinhole would have filmed them; beyond the filmed part the rim is repeated."""
        if self._maps is None:
            return frames
        return each(frames, lambda t, frame: self.straight_one(frame), progress)

    def straight_one(self, frame: np.ndarray) -> np.ndarray:
        """One frame (H, W, 3) uint8, straightened as in `straight`."""
        if self._maps is None:
            return frame
        return cv2.remap(frame, *self._maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)

    def straight_map(self, values: np.ndarray, outside: float = 0.0) -> np.ndarray:
        """A mask or depth map (H, W) given over the filmed frame, over the straightened one; equal to `outside` beyond the filmed part."""
        if self._maps is None:
            return values
        whole = values.astype(np.uint8) if values.dtype == bool else values.astype(np.float32)
        moved = cv2.remap(whole, *self._maps, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=outside)
        return moved.astype(values.dtype)

    def filmed_map(self, values: np.ndarray) -> np.ndarray:
        """A mask (H, W) bool given over the straightened frame, over the filmed one; the inverse of `straight_map`."""
        if self._maps is None:
            return values
        height, width = values.shape
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
        places = self.straight_points(grid).astype(np.float32)
        return cv2.remap(values.astype(np.uint8), places[..., 0], places[..., 1], cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT) > 0

    def straight_points(self, xy: np.ndarray) -> np.ndarray:
        """The straightened pixels (..., 2) of filmed pixels xy (..., 2)."""
        if self._maps is None or not xy.size:
            return xy
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
        flat = np.ascontiguousarray(xy.reshape(-1, 1, 2), dtype=np.float64)
        moved = cv2.undistortPointsIter(flat, self._matrix, np.array(self.camera.distortion), None, self._matrix, criteria)
        return moved.reshape(xy.shape)

    def straight_box(self, box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        """The bounding box (x0, y0, x1, y1) [px] of a filmed box's outline after straightening."""
        x0, y0, x1, y1 = box
        s = np.linspace(0.0, 1.0, 17)
        edges = [np.stack([x0 + (x1 - x0) * s, np.full(17, y)], 1) for y in (y0, y1)]
        edges += [np.stack([np.full(17, x), y0 + (y1 - y0) * s], 1) for x in (x0, x1)]
        moved = self.straight_points(np.concatenate(edges))
        low, high = moved.min(axis=0), moved.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])
