"""Painting into frames (H, W, 3) of colours in 0..1."""

from __future__ import annotations

import numpy as np


def mix(image: np.ndarray, colour: list[float] | np.ndarray, amount: np.ndarray) -> np.ndarray:
    """`image` (..., 3) towards `colour` by `amount` (...) in 0..1."""
    return image + (np.asarray(colour) - image) * amount[..., None]


def dot(image: np.ndarray, cx: float, cy: float, radius: float, colour: list[float] | np.ndarray) -> None:
    """Paint a disc into `image`, in place: centre and radius in pixels, a pixel from full to nothing."""
    far = radius + 1.0
    rows = slice(max(int(cy - far), 0), max(int(cy + far) + 2, 0))
    columns = slice(max(int(cx - far), 0), max(int(cx + far) + 2, 0))
    y, x = np.arange(image.shape[0])[rows, None], np.arange(image.shape[1])[None, columns]
    inside = np.clip(far - np.hypot(x - cx, y - cy), 0.0, 1.0)
    image[rows, columns] = mix(image[rows, columns], colour, inside)
