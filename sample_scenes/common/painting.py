"""Painting into frames (H, W, 3) of colours in 0..1."""

from __future__ import annotations

import numpy as np


def mix(picture: np.ndarray, colour: list[float] | np.ndarray, amount: np.ndarray) -> np.ndarray:
    """`picture` (..., 3) towards `colour` by `amount` (...) in 0..1."""
    return picture + (np.asarray(colour) - picture) * amount[..., None]


def dot(
    picture: np.ndarray, cx: float, cy: float, radius: float, colour: list[float] | np.ndarray, *, edge: float = 1.0, amount: float = 1.0
) -> None:
    """Paint a disc into `picture`, in place: centre and radius in pixels, `edge` pixels from full to nothing, `amount` of its colour."""
    far = radius + edge
    rows = slice(max(int(cy - far), 0), max(int(cy + far) + 2, 0))
    columns = slice(max(int(cx - far), 0), max(int(cx + far) + 2, 0))
    y, x = np.arange(picture.shape[0])[rows, None], np.arange(picture.shape[1])[None, columns]
    inside = amount * np.clip((far - np.hypot(x - cx, y - cy)) / edge, 0.0, 1.0)
    picture[rows, columns] = mix(picture[rows, columns], colour, inside)
