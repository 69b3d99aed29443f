"""Anti-aliased arrows that stay legible on any ground."""

from __future__ import annotations

import cv2
import numpy as np

OUTLINE = (18, 20, 24)
"""Dark, so that light arrows stand out on light pictures."""


def draw_arrow(canvas: np.ndarray, tail: np.ndarray, tip: np.ndarray, colour: tuple[float, ...], size: float) -> None:
    """Draw an anti-aliased arrow with a dark outline into `canvas` (H, W, 3), from `tail` to `tip` (2,) [px]; `size` scales its width."""
    span = tip - tail
    length = float(np.linalg.norm(span))
    if not np.isfinite(length) or length > 4 * max(canvas.shape):
        return
    if length < 2 * size:
        centre = _fixed(tail[None])[0]
        cv2.circle(canvas, (int(centre[0]), int(centre[1])), int(3.4 * size * 16), OUTLINE, -1, cv2.LINE_AA, 4)
        cv2.circle(canvas, (int(centre[0]), int(centre[1])), int(2.2 * size * 16), colour, -1, cv2.LINE_AA, 4)
        return
    along = span / length
    across = np.array([-along[1], along[0]])
    head = min(11.0 * size, 0.62 * length)
    half, wing = min(1.7 * size, 0.2 * head), 0.46 * head
    neck = length - 0.88 * head
    outline = [(0, -half), (neck, -half), (length - head, -wing), (length, 0), (length - head, wing), (neck, half), (0, half)]
    corners = _fixed(np.array([tail + a * along + b * across for a, b in outline]))
    cv2.polylines(canvas, [corners], True, OUTLINE, max(2, round(2.6 * size)), cv2.LINE_AA, 4)
    cv2.fillPoly(canvas, [corners], colour, cv2.LINE_AA, 4)


def _fixed(points: np.ndarray) -> np.ndarray:
    """Pixels in OpenCV's fixed point with four fractional bits."""
    return np.round(points * 16).astype(np.int32)
