"""Particles of a body on a stem: the stem's thickness sets the spacing of all, as the stem carries the load and the rest moves with it.

A thin, stiff stem would need too many explicit substeps: its waves are fast and its particles small. But the motion of a beam or a sheet
only depends on its mass and its bending stiffness, E times the second moment of the section. So the particles of the stem and of the sheets
are put k times as far from their middle, where 1/k² of the modulus gives the same bending stiffness, and keep their mass. Waves are then k
times slower and the grid k times coarser, so 1/k² of the substeps suffice. In tension the stem is k² times softer, which is not visible.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ....materials import LIMITS, Material, substeps_needed
from ....records import Particles
from .columns import MIN_SPACING_PIXELS, across_layers, columns_of, layers_of, surface_metric
from .parts import Parts, sections
from .relief import Relief, sample

SLENDEREST = 10.0
"""Least length of the rod of particles, in units of its breadth: a broader one is not a beam."""

COARSE = 1.6
"""Spacing of the head's particles, in units of the stem's: one particle in each cell of the grid, so that the head stays in one piece."""


def stem_spacing(parts: Parts) -> float:
    """Spacing of the stem's particles [px]: its median radius, but no less than pixels can resolve."""
    return max(float(np.median(parts.radius)), MIN_SPACING_PIXELS)


def too_fine(parts: Parts) -> str | None:
    """The warning for a stem that is thinner than its particles; None for a thicker one."""
    breadth = 2.0 * float(np.median(parts.radius))
    if breadth >= 2.0 * MIN_SPACING_PIXELS:
        return None
    return (
        f"The stem is {breadth:.1f} px thick, but its particles are at least {MIN_SPACING_PIXELS:g} px apart, so it is as stiff as a "
        "thicker one; only the stiffness that is estimated from its motion can make up for that. Film closer."
    )


def widening(relief: Relief, parts: Parts, material: Material, frame_dt: float) -> float:
    """k, by how many times the particles are moved away from the middle, so that `LIMITS.max_substeps` substeps suffice for a frame of
    `frame_dt` [s]; at least 1, and at most so that the stem still is a beam."""
    needed = substeps_needed(material, LIMITS.cell_spacings * _spacing(relief, parts), frame_dt)
    length = float(np.linalg.norm(np.diff(parts.axis, axis=0), axis=1).sum())
    most = length / (SLENDEREST * 2.0 * stem_spacing(parts))
    return max(1.0, min(math.sqrt(needed / LIMITS.max_substeps), most))


def fill_parts(relief: Relief, parts: Parts, held: np.ndarray, wider: float) -> Particles:
    """Fill a body on a stem with particles. held: (H, W) bool, where it is held in frame 0; wider: k, see `widening`."""
    pixel, spacing = _pixel(relief), wider * _spacing(relief, parts)
    sheets = [parts.sheets == number for number in range(1, parts.sheets.max() + 1)]
    filled = [_stem(relief, parts, held, pixel, wider), _columns(relief, parts.head, COARSE * spacing, held, 1.0)]
    filled += [_columns(relief, sheet, spacing, held, wider) for sheet in sheets]
    x, volume, pinned = (np.concatenate(values) for values in zip(*filled))
    softer = None if wider == 1.0 else np.full(len(x), wider**-2)
    return Particles(x=x, volume=volume, pinned=pinned, spacing=float(spacing), stiffness=softer)


def _pixel(relief: Relief) -> float:
    """Width of a pixel on the body [m]."""
    return float(np.sqrt(np.linalg.det(surface_metric(relief))))


def _spacing(relief: Relief, parts: Parts) -> float:
    """Spacing of the stem's particles [m] without `widening`."""
    return stem_spacing(parts) * _pixel(relief)


def _stem(
    relief: Relief, parts: Parts, held: np.ndarray, pixel: float, wider: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Four particles per section, half the radius off the axis: places (N, 3) [m], volumes (N,) [m³], and which are held (N,) bool."""
    cut = sections(parts, wider * stem_spacing(parts), held)
    off = 0.5 * wider * cut.radius
    across = np.stack([-cut.direction[:, 1], cut.direction[:, 0]], axis=1) * off[:, None]
    middle = 0.5 * (sample(relief.front, cut.place) + sample(relief.back, cut.place))
    x = [
        relief.camera.unproject(cut.place + side * across, middle + depth * off * pixel)
        for side in (-1.0, 1.0)
        for depth in (-1.0, 1.0)
    ]
    volume = np.tile(cut.radius**2 * cut.length, 4)
    volume *= relief.pixel_volume()[parts.stem].sum() / volume.sum()
    return np.concatenate(x), volume, np.tile(cut.held, 4)


def _columns(
    relief: Relief, part: np.ndarray, spacing: float, held: np.ndarray, wider: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Particles in columns behind the pixels of `part` (H, W) bool, `spacing` [m] apart; returns the same as `_stem`."""
    alone = replace(relief, mask=part)
    columns = columns_of(alone, surface_metric(alone), spacing, held & part)
    layers = layers_of(wider * columns.thickness, spacing)
    column, across = across_layers(layers)
    return relief.points(columns.xy[column], 0.5 + wider * (across - 0.5)), columns.volume[column] / layers[column], columns.pinned[column]
