"""What stands behind a sample scene: a painted evening landscape, out of focus, from a seed with NumPy alone."""

from __future__ import annotations

import numpy as np
from painting import dot, mix
from scipy.ndimage import gaussian_filter


def make_backdrop(seed: int, width: int = 1280, height: int = 720) -> np.ndarray:
    """The frame (height, width, 3) uint8 sRGB: evening sky, a far row of trees and a meadow, all out of focus."""
    rng = np.random.default_rng(seed + 2)
    y = np.linspace(0.0, 1.0, height)[:, None]
    sky = np.array([0.60, 0.73, 0.86]) + (np.array([0.93, 0.91, 0.84]) - np.array([0.60, 0.73, 0.86])) * (y / 0.62)[..., None] ** 1.3
    picture = np.broadcast_to(sky, (height, width, 3)).copy()
    x = np.arange(width)
    for base, rise, colour, blur in ((0.60, 0.05, [0.56, 0.66, 0.68], 10), (0.64, 0.09, [0.42, 0.52, 0.44], 7)):
        line = gaussian_filter(rng.standard_normal(width), width / 40) * 5.0
        line += gaussian_filter(rng.standard_normal(width), width / 160) * 1.2
        top = base - rise * (0.5 + line / 3.0)
        mask = gaussian_filter((y > top[None, x]).astype(float), blur)
        picture = mix(picture, colour, mask)
    meadow = gaussian_filter((y > 0.70 + np.zeros(width)).astype(float), 7)
    tone = np.clip((y - 0.70) / 0.30, 0.0, 1.0)[..., None]
    picture += (np.array([0.60, 0.66, 0.36]) * (1 - tone) + np.array([0.36, 0.45, 0.20]) * tone - picture) * meadow[..., None]
    grass = gaussian_filter(rng.standard_normal((height, width)), (4, 14))
    picture *= 1.0 + (0.10 * grass / grass.std() * meadow)[..., None]
    for _ in range(46):
        cx, cy, radius = rng.uniform(0, width), rng.uniform(0.52, 0.72) * height, rng.uniform(9, 24)
        dot(picture, cx, cy, radius, rng.choice([[0.98, 0.90, 0.66], [0.80, 0.86, 0.62], [0.99, 0.80, 0.55]]), edge=3.0, amount=0.22)
    return (np.clip(picture + rng.normal(0.0, 0.006, (height, width, 1)), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
