"""A flag's print and its pole."""

from __future__ import annotations

import numpy as np
from painting import dot
from scipy.ndimage import gaussian_filter

POLE = 0.012
"""Half the pole's thickness [m]."""
ABOVE = 0.04
"""How far the pole stands out above the flag [m]."""


def striped(seed: int, height: float, side: float, size: int = 1024) -> np.ndarray:
    """The texture (size, size, 3) uint8 sRGB of a flag so high, on a square with that `side` round the middle of its held edge [m]: three
    stripes with printed dots and a weave, so that there are corners to track."""
    rng = np.random.default_rng(seed + 1)
    rows = (0.5 - (np.arange(size) + 0.5) / size)[:, None] * side / height + 0.5
    colours = np.array([[0.78, 0.12, 0.13], [0.95, 0.93, 0.88], [0.10, 0.22, 0.52]])
    stripe = np.clip((rows * 3).astype(int), 0, 2)
    image = colours[np.broadcast_to(stripe, (size, size))]
    weave = gaussian_filter(rng.standard_normal((size, size)), 3)
    image = image * (1.0 + 0.16 * weave / weave.std())[..., None]
    for _ in range(170):
        cx, cy, radius = rng.uniform(0.48, 1.0) * size, rng.uniform(0.34, 0.66) * size, rng.uniform(5, 13)
        dot(image, cx, cy, radius, rng.uniform(0.05, 1.0, 3))
    return (np.clip(image, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def pole(x: float, top: float) -> tuple[np.ndarray, np.ndarray, tuple[float, float, float]]:
    """Vertices, triangles and colour of a square bar behind the held edge at x, from below the frame to above the flag's `top` [m]."""
    low, high = np.array([x - POLE, 0.01, 0.2]), np.array([x + POLE, 0.01 + 2 * POLE, top + ABOVE])
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32), (0.25, 0.16, 0.09)
