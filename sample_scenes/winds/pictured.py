"""The preview of a wind: its arrows in the plane of the two longest sides of its box, and below them its speed over time. NumPy only."""

from __future__ import annotations

import numpy as np

from seeing_wind.ui.field.arrows import ramp_colours
from seeing_wind.ui.field.lattice import SampledField

SIZE = 192
"""Of the frame [px]."""
ARROWS = 7
"""Along each side."""
STRONG = 9.0
"""m/s at which colours and curves end: winds can be compared."""
STRIP = 40
"""Height of the curve below the arrows [px]."""
GROUND = (0.035, 0.045, 0.06)
THICK = 1.6
"""Half of a line [px]."""


def pictured(sampled: SampledField) -> np.ndarray:
    """(SIZE, SIZE, 4) float32, the lowest row first: the wind in the middle of its time and box."""
    low, high = sampled.box
    across, up = sorted(np.argsort(high - low)[1:].tolist())
    share = (np.arange(ARROWS) + 0.5) / ARROWS
    places = np.tile(0.5 * (low + high), (ARROWS**2, 1))
    grid = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
    places[:, [across, up]] = low[[across, up]] + grid * (high - low)[[across, up]]
    middle = slice(len(sampled.velocity) // 2, len(sampled.velocity) // 2 + 1)
    wind = SampledField(sampled.points, sampled.velocity[middle], sampled.confidence[middle]).at(places)[0]
    speed = np.linalg.norm(wind, axis=1)
    strength = np.clip(speed / STRONG, 0.0, 1.0)
    image = np.ones((SIZE, SIZE, 4), dtype=np.float32)
    image[..., :3] = GROUND
    length, above = 0.9 * SIZE / ARROWS, np.array([SIZE, SIZE - STRIP])
    ways = wind[:, [across, up]] / max(float(speed.max()), 1e-9)
    for k in np.argsort(strength):  # the strongest on top
        at, way = above * grid[k] + [0, STRIP], ways[k]
        tip, tail = at + 0.5 * length * way, at - 0.5 * length * way
        side = 0.28 * np.array([-way[1], way[0]]) * length
        back = tip - 0.38 * length * way
        colour = ramp_colours(strength[k]) ** (1 / 2.2)
        for begin, end in ((tail, tip), (tip, back + side), (tip, back - side)):
            _line(image, begin, end, colour)
    _curve(image, np.linalg.norm(sampled.velocity, axis=-1).mean(axis=1))
    return image


def _curve(image: np.ndarray, speeds: np.ndarray) -> None:
    """Speeds (T,) [m/s] as columns along the lower edge."""
    for column in range(SIZE):
        strong = min(speeds[column * len(speeds) // SIZE] / STRONG, 1.0)
        image[: round(strong * (STRIP - 6)), column, :3] = 0.75 * ramp_colours(np.array(strong)) ** (1 / 2.2)


def _line(image: np.ndarray, begin: np.ndarray, end: np.ndarray, colour: np.ndarray) -> None:
    """Blend a line with soft edges into the frame."""
    low = np.clip(np.floor(np.minimum(begin, end) - 3.0).astype(int), 0, SIZE)
    high = np.clip(np.ceil(np.maximum(begin, end) + 4.0).astype(int), 0, SIZE)
    rows, columns = np.mgrid[low[1] : high[1], low[0] : high[0]]
    offset, along = np.stack([columns, rows], axis=-1) - begin, end - begin
    t = np.clip((offset @ along) / max(float(along @ along), 1e-9), 0.0, 1.0)
    away = np.linalg.norm(offset - t[..., None] * along, axis=-1)
    cover = np.clip(THICK + 0.5 - away, 0.0, 1.0)[..., None]
    part = image[low[1] : high[1], low[0] : high[0], :3]
    part[:] = (1.0 - cover) * part + cover * colour
