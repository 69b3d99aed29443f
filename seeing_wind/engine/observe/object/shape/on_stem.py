"""Particles of a body on a stem: the stem's thickness sets the spacing of all, as the stem carries the load and the rest moves with it.

A thin, stiff stem would need too many explicit substeps: its waves are fast and its particles small. But the motion of a beam or a sheet
only depends on its mass and its bending stiffness, E times the second moment of the section. So the particles of the stem and of the sheets
are put k times as far from their middle, where 1/k² of the modulus gives the same bending stiffness, and keep their mass. Waves are then k
times slower and the grid k times coarser, so 1/k² of the substeps suffice. In tension the stem is k² times softer, which is not visible.

Head and leaves may have materials of their own. The leaves count in k as the stem does. A head of its own material is no thinner than it
looks, so it keeps its stiffness, up to what these substeps allow.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ....conventions import GRAVITY, in_units
from ....masks import pixels_of
from ....materials import LIMITS, substeps_needed
from ....records import Mixture, Particles
from ....settings.build import PartMaterials
from .columns import MIN_SPACING_PIXELS, across_layers, columns_of, layers_of, surface_metric
from .parts import Parts, sections
from .relief import Relief, sample

SLENDEREST = 10.0
"""Least length of the rod of particles, in units of its breadth: a broader one is not a beam."""

COARSE = 1.6
"""Spacing of the head's particles, in units of the stem's: one particle in each cell of the grid, so that the head stays in one piece."""


OWN_WEIGHT = 0.315
"""Part of the weight spread along a column that, at its free end, would make it buckle as well: 2.47 / 7.84, of Euler's column and of the
one that buckles under its own weight (Greenhill 1881)."""


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


def widening(relief: Relief, parts: Parts, materials: PartMaterials, frame_dt: float) -> float:
    """k, by how many times the particles are moved away from the middle, so that `LIMITS.max_substeps` substeps suffice for a frame of
    `frame_dt` [s]; at least 1, and at most so that the stem still is a beam."""
    thin = [materials.stem, *([materials.leaves] if parts.sheets.any() else [])]
    needed = max(substeps_needed(one, LIMITS.cell_spacings * _spacing(relief, parts), frame_dt) for one in thin)
    length = float(np.linalg.norm(np.diff(parts.axis, axis=0), axis=1).sum())
    most = length / (SLENDEREST * 2.0 * stem_spacing(parts))
    return max(1.0, min(math.sqrt(needed / LIMITS.max_substeps), most))


def fill_parts(
    relief: Relief, parts: Parts, held: np.ndarray, wider: float, materials: PartMaterials | None = None, frame_dt: float = 1.0
) -> Particles:
    """Fill a body on a stem with particles, those of the stem first.

    Args:
        held: (H, W) bool, where it is held in frame 0.
        wider: k, see `widening`.
        materials: those of the parts; None if all are alike.
        frame_dt: duration of a frame [s], for the substeps that a head of its own material needs.
    """
    pixel, spacing = _pixel(relief), wider * _spacing(relief, parts)
    sheets = [parts.sheets == number for number in range(1, parts.sheets.max() + 1)]
    filled = [_stem(relief, parts, held, pixel, wider), _columns(relief, parts.head, COARSE * spacing, held, 1.0)]
    filled += [_columns(relief, sheet, spacing, held, wider) for sheet in sheets]
    x, volume, pinned = (np.concatenate(values) for values in zip(*filled))
    softer = np.full(len(x), wider**-2)
    if materials is None or materials.alike:
        return Particles(x, volume, pinned, float(spacing), None if wider == 1.0 else softer)
    counts = [len(one[0]) for one in filled]
    count = (counts[0], counts[1], sum(counts[2:]))
    if materials.head is not materials.stem:
        needed = substeps_needed(materials.head, LIMITS.cell_spacings * spacing, frame_dt)
        softer[counts[0] : counts[0] + counts[1]] = min(1.0, (LIMITS.max_substeps / needed) ** 2)
    stiffness = None if (softer == 1.0).all() else softer
    return Particles(x, volume, pinned, float(spacing), stiffness, _mixture(materials, count))


def _mixture(materials: PartMaterials, count: tuple[int, int, int]) -> Mixture:
    """The materials by particle, for so many particles of the stem, the head and the leaves."""
    stem, each = materials.stem, (materials.stem, materials.head, materials.leaves)
    return Mixture(
        density=np.repeat([one.density / stem.density for one in each], count),
        youngs_modulus=np.repeat([one.youngs_modulus / stem.youngs_modulus for one in each], count),
        poisson_ratio=np.repeat([one.poisson_ratio for one in each], count),
        retardation=np.repeat([one.retardation for one in each], count),
    )


def top_heavy(relief: Relief, parts: Parts, particles: Particles, held: np.ndarray, materials: PartMaterials) -> str:
    """The note on a head that weighs more than its stem can bear upright; "" for a lighter one.

    A column held at its foot buckles under P = pi² E I / (4 L²) at its free end (Euler), where L reaches up to the head's centre of mass,
    as the head does not bend. `OWN_WEIGHT` of what is spread along the stem counts as well.

    Args:
        held: (H, W) bool, where the body is held in frame 0.
    """
    pixel, stem = _pixel(relief), materials.stem
    cut, radius = sections(parts, stem_spacing(parts), held), float(np.median(parts.radius)) * _pixel(relief)
    centre = pixels_of(parts.head).mean(axis=0)
    length = pixel * (float(cut.length[~cut.held].sum()) + float(np.linalg.norm(centre - parts.axis[-1])))
    mass = float(relief.pixel_volume()[parts.head].sum()) * materials.head.density
    carried = math.pi**3 / 16.0 * stem.youngs_modulus * radius**4 / length**2 / float(np.linalg.norm(GRAVITY))
    bears = max(0.0, carried - OWN_WEIGHT * (particles.mass(stem) - mass))
    if mass <= bears:
        return ""
    what = f"bears {in_units(bears, 'kg', 2)} besides itself" if bears else "does not even bear itself"
    return (
        f"The head weighs {in_units(mass, 'kg', 2)}, and a stem {in_units(2.0 * radius, 'm', 2)} thick of "
        f"{in_units(stem.youngs_modulus, 'Pa', 2)} {what}: upright, it would fall. Give a lighter material for the head "
        "(--head-material) or a stiffer stem (--youngs-modulus), or check the scale."
    )


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
