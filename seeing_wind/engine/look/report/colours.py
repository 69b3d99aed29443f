"""The colours of force: from purple (weak) to red (strong), as in the paper's figures, and the scale they belong to."""

from __future__ import annotations

import numpy as np

STOPS = np.array(
    [
        (0x80, 0x3D, 0xFF),
        (0x3F, 0x7B, 0xFA),
        (0x1A, 0xB9, 0xE4),
        (0x2E, 0xDB, 0xA0),
        (0x9B, 0xE8, 0x52),
        (0xFA, 0xD2, 0x3A),
        (0xFF, 0x8A, 0x2A),
        (0xFF, 0x2A, 0x1F),
    ],
    dtype=np.float64,
)
"""RGB from weak to strong: the paper's #8000FF..#FF0000 with its lightness evened, so that arrows show on dark and light ground."""


def force_colours(strength: np.ndarray) -> np.ndarray:
    """Strength (..., ) over the scale's top, clamped to 0..1 -> RGB (..., 3) in 0..255."""
    place = np.clip(np.asarray(strength, dtype=np.float64), 0.0, 1.0) * (len(STOPS) - 1)
    first = np.minimum(place.astype(int), len(STOPS) - 2)
    return STOPS[first] + (place - first)[..., None] * (STOPS[first + 1] - STOPS[first])


def scale_top(strength: np.ndarray) -> float:
    """A round number [N/m³] just above the 98th percentile of the strengths; 1 where there is no force."""
    top = float(np.percentile(strength, 98)) if np.size(strength) else 0.0
    if top <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(top))
    return float(next(power * step for step in (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10) if power * step >= top * (1 - 1e-9)))
