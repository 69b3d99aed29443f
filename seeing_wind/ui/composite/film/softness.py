"""The blur of a clip: from lens, focus, sensor and encoder together."""

from __future__ import annotations

import math

import numpy as np

from ....engine.masks import Masks
from ....engine.record_arrays import from_arrays
from ....engine.take import Take
from ..light import LUMINANCE, linear
from ..mattes import softened, widened

ACROSS, FINE, LEVEL = 5.0, 0.25, 1.5
"""Pixels: length of a profile on each side of the rim, its step, and the part at each end that gives the level of that side."""
EVEN, FAINT, FEW = 0.1, 0.03, 12
"""Largest variation of a side as a fraction of the step; smallest usable step in linear values 0..1; least number of usable profiles."""
INTERPOLATED = 0.14
"""Variance [px²] that interpolation between pixels adds to the blur: a sharp step becomes a ramp one pixel long."""



def softness_of(take: Take) -> float:
    """Standard deviation [px] of the blur at the object's rim in frame 0; 0 if it cannot be measured."""
    arrays = take.read_arrays("observation.npz") if take.file("observation.npz").is_file() else {}
    image = arrays.get("image")
    if image is None or image.ndim != 3 or "masks.windows" not in arrays:
        return 0.0
    mask = from_arrays(Masks, arrays, "masks.")[0]
    return softness(image, mask) if mask.shape == image.shape[:2] else 0.0


def softness(image: np.ndarray, mask: np.ndarray) -> float:
    """Standard deviation [px] of the blur at the rim of a mask (H, W) bool in a frame (H, W, 3) uint8 sRGB; 0 if it cannot be measured.

    Along the rim's normal, blur turns a sharp step into its own integral; for a Gaussian, this rises from 1/4 to 3/4 within 1.349 standard
    deviations. Only profiles with uniform sides count, and of their widths the lower quartile, since motion may blur the others.
    """
    shade = linear(image) @ LUMINANCE
    smooth = softened(mask, 4).astype(np.float64)
    rows, columns = np.nonzero(mask & widened(~mask, 1))
    away = -np.stack([each[rows, columns] for each in np.gradient(smooth)], axis=1)
    length = np.linalg.norm(away, axis=1)
    inside = np.minimum.reduce([rows, columns, mask.shape[0] - 1 - rows, mask.shape[1] - 1 - columns]) > ACROSS
    told = (length > 0.0) & inside
    way = away[told] / length[told, None]
    at = np.arange(-ACROSS, ACROSS + 0.5 * FINE, FINE)
    seen = _between(shade, np.stack([rows, columns], axis=1)[told][:, None] + at[:, None] * way[:, None])
    ends = seen[:, at < -ACROSS + LEVEL], seen[:, at > ACROSS - LEVEL]
    low, high = (end.mean(axis=1) for end in ends)
    step = np.abs(high - low)
    even = np.maximum(*(end.std(axis=1) for end in ends)) < EVEN * step
    rising = (seen - low[:, None]) / np.where(step > 0.0, high - low, 1.0)[:, None]
    widths = [_width(each, at) for each in rising[even & (step > FAINT)]]
    if len(widths) < FEW:
        return 0.0
    blur = (np.quantile(widths, 0.25) / 1.349) ** 2 - INTERPOLATED
    return float(math.sqrt(max(blur, 0.0)))


def _width(rising: np.ndarray, at: np.ndarray) -> float:
    """Distance over which a step from 0 to 1 rises from its last value below 1/4 to its first value above 3/4."""
    begin = int(np.flatnonzero(rising < 0.25)[-1])
    end = begin + int(np.flatnonzero(rising[begin:] > 0.75)[0])
    cross = [at[k - 1] + FINE * (level - rising[k - 1]) / (rising[k] - rising[k - 1]) for k, level in ((begin + 1, 0.25), (end, 0.75))]
    return float(cross[1] - cross[0])


def _between(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values (H, W) interpolated bilinearly at positions (..., 2) in rows and columns."""
    low = np.floor(places).astype(int)
    (y, x), (v, u) = np.moveaxis(low, -1, 0), np.moveaxis(places - low, -1, 0)
    upper, lower = ((1.0 - u) * values[row, x] + u * values[row, x + 1] for row in (y, y + 1))
    return (1.0 - v) * upper + v * lower
