"""The noise of a clip."""

from __future__ import annotations

import math

import numpy as np

from ....engine.take import Take

NOISE_WINDOW = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
"""Second difference along both axes: responds to noise but not to smooth content (Immerkaer, Fast noise variance estimation, 1996)."""


def grain_of(take: Take) -> float:
    """Standard deviation of the clip's noise in display values 0..1, estimated in frame 0; 0 if the take has no image."""
    arrays = take.read_arrays("observation.npz") if take.file("observation.npz").is_file() else {}
    image = arrays.get("image")
    if image is None or image.ndim != 3 or min(image.shape[:2]) < 16:
        return 0.0
    bright = image[..., :3].astype(np.float64).mean(axis=-1) / 255.0
    height, width = bright.shape
    seen = sum(
        weight * bright[y : height - 2 + y, x : width - 2 + x] for y, row in enumerate(NOISE_WINDOW) for x, weight in enumerate(row)
    )
    # the median ignores edges; sqrt(3), since the mean of three channels is less noisy than each
    return float(np.median(np.abs(seen)) / 0.6745 / 6.0 * math.sqrt(3.0))
