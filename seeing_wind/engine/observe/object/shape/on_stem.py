"""Particles of a body on a stem: the stem's size sets that of all, as the stem carries the load and the rest goes with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....records import Particles
from .columns import MIN_SPACING_PIXELS, columns_of, layers_of, surface_metric
from .parts import Parts, sections
from .relief import Relief, sample

COARSE = 1.6
"""Spacing of the head, in units of the stem's: a particle to each of the grid's cells, so that it stays in one piece."""


def stem_spacing(parts: Parts) -> float:
    """Distance of the stem's particles [px]: its usual radius, but no less than pixels can tell."""
    return max(float(np.median(parts.radius)), MIN_SPACING_PIXELS)


def too_fine(parts: Parts) -> str | None:
    """What to say of a stem that is thinner than its particles; None of one that is not."""
    breadth = 2.0 * float(np.median(parts.radius))
    if breadth >= 2.0 * MIN_SPACING_PIXELS:
        return None
    return (
        f"The stem is {breadth:.1f} px thick, and its particles are {MIN_SPACING_PIXELS:g} px apart at least: it bends as a thicker one, "
        "and only the stiffness that its motion shows makes up for that. Film closer."
    )


def fill_parts(relief: Relief, parts: Parts, held: np.ndarray) -> Particles:
    """Fill a body on a stem. held: (H, W) bool, where it is held in picture 0."""
    pixel = np.sqrt(np.linalg.det(surface_metric(relief)))
    spacing = stem_spacing(parts) * pixel
    filled = [_stem(relief, parts, held, pixel), _columns(relief, parts.head, COARSE * spacing, held)]
    filled += [_columns(relief, parts.sheets == number, spacing, held) for number in range(1, parts.sheets.max() + 1)]
    x, volume, pinned = (np.concatenate(values) for values in zip(*filled))
    return Particles(x=x, volume=volume, pinned=pinned, spacing=float(spacing))


def _stem(relief: Relief, parts: Parts, held: np.ndarray, pixel: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Four particles to a section, half the radius off the axis: places (N, 3) [m], volumes (N,) [m³], and which are held (N,)."""
    place, radius, direction = sections(parts, stem_spacing(parts))
    across = np.stack([-direction[:, 1], direction[:, 0]], axis=1) * 0.5 * radius[:, None]
    middle = 0.5 * (sample(relief.front, place) + sample(relief.back, place))
    x = [
        relief.camera.unproject(place + side * across, middle + depth * 0.5 * radius * pixel)
        for side in (-1.0, 1.0)
        for depth in (-1.0, 1.0)
    ]
    volume = np.tile(radius**2, 4)
    volume *= relief.pixel_volume()[parts.stem].sum() / volume.sum()
    row, column = (np.clip(np.round(place[:, i]).astype(int), 0, held.shape[1 - i] - 1) for i in (1, 0))
    return np.concatenate(x), volume, np.tile(held[row, column], 4)


def _columns(relief: Relief, part: np.ndarray, spacing: float, held: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns behind the pixels of `part` (H, W), `spacing` [m] apart, as `_stem`."""
    alone = replace(relief, mask=part)
    columns = columns_of(alone, surface_metric(alone), spacing, held & part)
    layers = layers_of(columns.thickness, spacing)
    column = np.repeat(np.arange(len(layers)), layers)
    first = np.cumsum(layers) - layers
    across = (np.arange(len(column)) - first[column] + 0.5) / layers[column]
    return relief.points(columns.xy[column], across), columns.volume[column] / layers[column], columns.pinned[column]
