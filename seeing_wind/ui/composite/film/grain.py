"""The noise of a clip."""

from __future__ import annotations

import math

import numpy as np

from ....engine.take import Take

NOISE_WINDOW = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
"""Second difference across both axes: sees noise, and nothing of what is smooth (Immerkaer, Fast noise variance estimation, 1996)."""


def grain_of(take: Take) -> float:
    """Standard deviation of the clip's noise, of display values in 0..1, from frame 0 beside the object; 0 where it is not known."""
    arrays = take.read_arrays("observation.npz") if take.file("observation.npz").is_file() else {}
    image = arrays.get("image")
    if image is None or image.ndim != 3 or min(image.shape[:2]) < 16:
        return 0.0
    bright = image[..., :3].astype(np.float64).mean(axis=-1) / 255.0
    height, width = bright.shape
    seen = sum(
        weight * bright[y : height - 2 + y, x : width - 2 + x] for y, row in enumerate(NOISE_WINDOW) for x, weight in enumerate(row)
    )
    # the median leaves edges out; a mean of three channels has less noise than one of them
    return float(np.median(np.abs(seen)) / 0.6745 / 6.0 * math.sqrt(3.0))
