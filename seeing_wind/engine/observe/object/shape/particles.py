"""Particles between the visible surface and the back.

Plates and posts get columns on a lattice in the frame, with layers along the line of sight. Balls and other solids, whose columns would be
much wider on the far side than on the near one, and blocks, whose sides are known, get cells of a cubic lattice.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ....errors import ObjectError
from ....masks import pixels_of
from ....progress import NoProgress, Progress
from ....records import Particles
from ....settings.build import PartMaterials
from .block import Block
from .columns import COVERAGE, MIN_SPACING_PIXELS, across_layers, columns_of, layers_of, spacing_for, surface_metric
from .on_stem import fill_parts
from .pins import held_dots
from .relief import Relief

SOLID = ("block", "ball", "solid")
"""Kinds of bodies that are filled by cells instead of columns."""

DOTS = 4
"""Least number of sample dots along each side of a cell, from which the part that the body covers is estimated."""

RANGE, TRIED = 1.0, 50
"""Range of the logarithm of a block's spacing round that of cubes of the wanted number, and the number of values tried on either side."""

FLAT = 1e-6
"""Variance of the particles along an axis, in units of the largest, below which they lie in a plane."""

MOST_SPREAD = 4.0 / 3.0
"""Largest factor by which the particles' second moments are raised: what two cells across lack."""

SAME = 0.08
"""Relative difference between the lengths of a block's sides below which they are meant to be equal."""

RIM = 0.002
"""Fraction of a block's dots that may lie beyond the outermost cells, as the pixels of its outline are uneven."""


def fill(
    relief: Relief,
    count: int,
    pin: np.ndarray | None = None,
    progress: Progress = NoProgress(),
    wider: float = 1.0,
    materials: PartMaterials | None = None,
    frame_dt: float = 1.0,
) -> Particles:
    """Fill the body with about `count` particles.

    Args:
        relief: front and back of the body.
        count: wanted number of particles; bodies of few pixels get fewer, and one on a stem gets as many as its stem requires.
        pin: (H, W) bool, where the body is held in frame 0; all layers of a held column are held.
        wider, materials, frame_dt: for a body on a stem, see `on_stem.fill_parts`.

    Returns:
        Particles whose volumes sum to the body's volume exactly.

    Raises:
        ObjectError: count below 1, or a pin that lies off the object.
    """
    if count < 1:
        raise ObjectError(f"{count} particles cannot stand for a body.", "Ask for some hundreds.")
    held = np.zeros_like(relief.mask) if pin is None else np.asarray(pin, dtype=bool)
    if held.any() and not (held & relief.mask).any():
        raise ObjectError("The pinned region lies off the object.", "Paint the part of the object that is held in the first frame.")
    if relief.parts is not None:
        return fill_parts(relief, relief.parts, held, wider, materials, frame_dt)
    if relief.kind in SOLID:
        return cells_of(relief, count, held)
    metric = surface_metric(relief)
    spacing = spacing_for(relief, metric, count, progress)
    columns = columns_of(relief, metric, spacing, held)
    layers = layers_of(columns.thickness, spacing)
    column, across = across_layers(layers)
    x = relief.points(columns.xy[column], across)
    return Particles(x=x, volume=columns.volume[column] / layers[column], pinned=columns.pinned[column], spacing=float(spacing))


def cells_of(relief: Relief, count: int, held: np.ndarray) -> Particles:
    """Fill a solid with about `count` cells of a lattice, clipped by the body's surface; held: (H, W) bool, where it is held.

    The lattice is cubic and along the camera's axes; a block's is along its sides, with layers that end at its face and its back.
    """
    volume_of_pixel = relief.pixel_volume()
    total = float(volume_of_pixel.sum())
    pixel = float(np.median(0.5 * (relief.front + relief.back)[relief.mask])) / np.sqrt(relief.camera.fx * relief.camera.fy)
    spacing = max(float(np.cbrt(total / count)), MIN_SPACING_PIXELS * pixel)
    dots, weight, ray = _dots(relief, spacing, pixel)
    block, on_pin = relief.block, held_dots(relief, held, dots, ray) if held.any() else np.zeros(len(dots), bool)
    if block is None:
        flat = (dots - np.average(dots, axis=0, weights=weight)) @ relief.camera.pose(0)[:3, :3] / spacing
        sites, cell = np.round(flat).astype(int), spacing**3
    else:
        spacing, sites, cell = _in_block(block, dots, spacing, count, MIN_SPACING_PIXELS * pixel, on_pin)
    sites, inverse = np.unique(sites, axis=0, return_inverse=True)
    covered = np.bincount(inverse.ravel(), weight)
    kept = covered >= min(COVERAGE * cell, covered.max())
    nearest = cKDTree(sites[kept]).query(sites)[1][inverse.ravel()]
    number = int(kept.sum())
    volume = np.bincount(nearest, weight, number)
    centre = np.stack([np.bincount(nearest, weight * dots[:, i], number) for i in range(3)], axis=1) / volume[:, None]
    centre = spread(centre, volume, dots, weight)
    pinned = np.zeros(number, dtype=bool)
    if held.any():
        share = np.bincount(nearest, weight * on_pin, number) / volume
        pinned = share > min(0.5, 0.99 * share.max())  # a pin smaller than a cell holds the cells it lies in
        if not pinned.any():  # it is smaller than the gaps between the dots
            painted = relief.points(pixels_of(held & relief.mask), 0.5)
            pinned[cKDTree(centre).query(painted)[1]] = True
    return Particles(x=centre, volume=volume, pinned=pinned, spacing=spacing)


def spread(centre: np.ndarray, volume: np.ndarray, dots: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Cell centres (N, 3) [m], moved apart until the particles' second moments are those of the body, given as dots (D, 3) [m] of `weight`
    (D,) [m³].

    Putting a cell's mass in its centre neglects its spread within the cell, and so underestimates the resistance to turning and bending:
    a post four cells across would lack 6 % of its stiffness. With two cells across, the particles move to the points of Gauss quadrature.
    """
    middle = np.average(dots, axis=0, weights=weight)
    body, cells = (np.cov(x.T, aweights=w, ddof=0) for x, w in ((dots, weight), (centre, volume)))
    values, axes = np.linalg.eigh(cells)
    wide = values > FLAT * values[-1]  # along an axis with one cell there is nothing to move apart
    if not wide.any():
        return centre
    scale = np.sqrt(values[wide])
    across = axes[:, wide] / scale
    ratio, turned = np.linalg.eigh(across.T @ body @ across)
    more = (turned * (np.sqrt(np.clip(ratio, 1.0, MOST_SPREAD)) - 1.0)) @ turned.T
    offset = centre - np.average(centre, axis=0, weights=volume)
    return middle + offset + offset @ (across * scale**2 @ more @ across.T).T


def _in_block(
    block: Block, dots: np.ndarray, spacing: float, count: int, finest: float, on_pin: np.ndarray
) -> tuple[float, np.ndarray, float]:
    """The cells of dots (D, 3) [m] in a lattice that ends at the block's sides, with about `count` cells of about `spacing` [m].

    Sides of the same length get the same number of cells, or a post would be stiffer one way than the other. If a part of the block is
    held, the dots `on_pin` (D,) bool, a layer ends at its border: how far a force bends the block grows with the cube of the free length.

    Returns:
        the spacing [m], at least `finest`; the cell of each dot (D, 3) int; the mean volume of a cell [m³].
    """
    flat = (dots - block.face.point) @ block.frame().T
    low, high = np.quantile(flat, RIM, axis=0), np.quantile(flat, 1.0 - RIM, axis=0)
    low[2], high[2] = 0.0, block.depth
    spacing, cells = _cells(high - low, spacing, count, finest)
    edges = [np.linspace(low[axis], high[axis], cells[axis] + 1) for axis in range(3)]
    if on_pin.any() and not on_pin.all():
        lever = flat[~on_pin].mean(axis=0) - flat[on_pin].mean(axis=0)
        axis = int(np.argmax(np.abs(lever)))
        edges[axis] = _ending_at(edges[axis], _border(flat[:, axis], on_pin, lever[axis] > 0.0))
    sites = [np.clip(np.searchsorted(one, flat[:, axis]) - 1, 0, len(one) - 2) for axis, one in enumerate(edges)]
    return spacing, np.stack(sites, axis=1), float(np.prod([np.diff(one).mean() for one in edges]))


def _cells(extent: np.ndarray, spacing: float, count: int, finest: float) -> tuple[float, np.ndarray]:
    """Spacing [m] and numbers of cells (3,) along a block's `extent` (3,) [m]: near `spacing` [m], with a product nearest to `count`."""
    length = extent.copy()
    for a, b in ((0, 1), (0, 2), (1, 2)):
        if abs(np.log(length[a] / length[b])) < SAME:
            length[[a, b]] = np.sqrt(length[a] * length[b])
    tried = np.maximum(spacing * np.exp(np.linspace(-RANGE, RANGE, 2 * TRIED + 1)), finest)
    cells = [layers_of(length, one) for one in tried]
    best = int(np.argmin([abs(np.log(one.prod() / count)) for one in cells]))
    return float(tried[best]), cells[best]


def _border(along: np.ndarray, held: np.ndarray, held_below: bool) -> float:
    """The place on an axis [m] that best separates the `held` (D,) bool dots from the others; `along`: (D,), the dots' places on it [m]."""
    order = np.argsort(along if held_below else -along)
    wins = np.cumsum(np.where(held[order], 1, -1))
    last = int(np.argmax(wins))
    return 0.5 * float(along[order[last]] + along[order[min(last + 1, len(order) - 1)]])


def _ending_at(edges: np.ndarray, border: float) -> np.ndarray:
    """The edges of the same number of cells, one edge at `border` and the others evenly spaced on either side of it."""
    cells, first, last = len(edges) - 1, edges[0], edges[-1]
    if cells < 2 or not first < border < last:
        return edges
    below = min(max(1, round(cells * (border - first) / (last - first))), cells - 1)
    return np.concatenate([np.linspace(first, border, below + 1), np.linspace(border, last, cells - below + 1)[1:]])


def _dots(relief: Relief, spacing: float, pixel: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Dots along the pixels' rays, several in a cell of `spacing` [m] each way; `pixel` is a pixel's width on the body [m].

    Returns:
        places (D, 3) [m], weights (D,) [m³] that add up to the body's volume, and the index (D,) of each dot's pixel among the mask's.
    """
    rows, columns = np.nonzero(relief.mask)
    near, far = relief.front[rows, columns], relief.back[rows, columns]
    thick = max(1, int(np.ceil(DOTS * (far - near).max() / spacing)))
    skip = max(1, int(spacing / (DOTS * pixel)))
    chosen = np.flatnonzero((rows % skip == 0) & (columns % skip == 0))
    rows, columns, near, far = rows[chosen], columns[chosen], near[chosen], far[chosen]
    depth = near[:, None] + (far - near)[:, None] * (np.arange(thick) + 0.5) / thick
    pixels = np.stack(np.broadcast_arrays(columns[:, None].astype(float), rows[:, None].astype(float)), axis=-1)
    dots = relief.camera.unproject(np.broadcast_to(pixels, (*depth.shape, 2)).reshape(-1, 2), depth.ravel())
    weight = ((far - near)[:, None] * depth**2).ravel()
    weight *= relief.pixel_volume().sum() / weight.sum()
    return dots, weight, np.repeat(chosen, thick)
