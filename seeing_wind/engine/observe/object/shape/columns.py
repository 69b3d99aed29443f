"""Columns along the line of sight, on a lattice in the frame, into which plates, posts and the parts of a body on a stem are divided."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ....masks import pixels_of
from ....progress import Progress
from .relief import Relief

MIN_SPACING_PIXELS = 2.0
"""Least distance [px] between columns: more columns would invent detail."""
THINNEST_LAYER = 0.25
"""Least distance between two layers, in units of the spacing, for a body to get a second one; two layers can bend, one cannot."""
COVERAGE = 0.3
"""Fraction of a lattice cell that the object must cover for it to become a column; smaller pieces join the nearest column."""
COUNT_TOLERANCE = 0.08
"""Relative error in the number of particles at which the search for a spacing stops."""


@dataclass(frozen=True)
class Columns:
    """The lattice cells that cover the silhouette, each with the part of the body behind it."""

    xy: np.ndarray
    """(M, 2) centre of each column's pixels [px]."""
    volume: np.ndarray
    """(M,) [m³]."""
    thickness: np.ndarray
    """(M,) mean distance from front to back [m]."""
    pinned: np.ndarray
    """(M,) bool: whether more than half of the column's pixels are held."""


def layers_of(thickness: np.ndarray, spacing: float) -> np.ndarray:
    """Number of layers (M,) of columns of a `thickness` (M,) [m]: about one per spacing, at least two where they stay far enough apart."""
    regular = np.round(thickness / spacing)
    return np.maximum(regular, np.where(thickness / 2.0 >= THINNEST_LAYER * spacing, 2, 1)).astype(int)


def across_layers(layers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The particles of columns with `layers` (M,) layers: the column of each (N,), and its place from front, 0, to back, 1, (N,)."""
    column = np.repeat(np.arange(len(layers)), layers)
    first = np.cumsum(layers) - layers
    return column, (np.arange(len(column)) - first[column] + 0.5) / layers[column]


def surface_metric(relief: Relief) -> np.ndarray:
    """Metres per pixel (2, 2) along the plane that fits the visible surface best: a lattice is to be regular there, not in the frame.

    Rows are coordinates in that plane, columns are frame x and y.
    """
    xy = pixels_of(relief.mask)
    points = relief.points(xy, 0.0 if relief.kind == "plate" else 0.5)
    design = np.column_stack([np.ones(len(xy)), xy])
    slope = np.linalg.lstsq(design, points, rcond=None)[0][1:]  # (2, 3): world metres per pixel
    # The symmetric square root of the first fundamental form: a pure stretch, which does not rotate the frame's axes.
    values, vectors = np.linalg.eigh(slope @ slope.T)
    metre_per_pixel = np.median(relief.front[relief.mask]) / np.sqrt(relief.camera.fx * relief.camera.fy)
    sizes = np.clip(np.sqrt(np.maximum(values, 0.0)), 0.5 * metre_per_pixel, 4.0 * metre_per_pixel)
    return vectors @ np.diag(sizes) @ vectors.T


def columns_of(relief: Relief, metric: np.ndarray, spacing: float, held: np.ndarray) -> Columns:
    """Divide the silhouette into cells of a square lattice of `spacing` [m] in the surface's plane.

    metric: see `surface_metric`; held: (H, W) bool, where the body is held.
    """
    pixels, held = pixels_of(relief.mask), held[relief.mask]
    cell_pixels = spacing / np.sqrt(np.linalg.det(metric))
    # For small cells, pixels are subdivided; otherwise the lattice would alias with the pixel grid.
    parts = max(1, int(np.ceil(5.0 / cell_pixels)))
    offsets = (np.arange(parts) + 0.5) / parts - 0.5
    dots = (pixels[:, None] + np.stack(np.meshgrid(offsets, offsets), -1).reshape(1, -1, 2)).reshape(-1, 2)
    owner = np.repeat(np.arange(len(pixels)), parts**2)
    flat = dots @ metric.T / spacing
    flat -= flat.mean(axis=0)
    sites, inverse, sizes = _cells(np.round(flat).astype(int))
    kept = sizes >= min(COVERAGE * (cell_pixels * parts) ** 2, sizes.max())
    nearest = cKDTree(sites[kept]).query(sites)[1][inverse]
    number = int(kept.sum())
    volume_of_dot = relief.pixel_volume()[relief.mask][owner] / parts**2
    dots_in = np.bincount(nearest, minlength=number)
    centre = np.stack([np.bincount(nearest, dots[:, i], number) for i in range(2)], axis=1) / dots_in[:, None]
    gap = (relief.back - relief.front)[relief.mask][owner]
    pinned = np.bincount(nearest, held[owner].astype(float), number) > 0.5 * dots_in
    if held.any() and not pinned.any():
        # A pin smaller than a cell holds the cell it lies in.
        pinned[np.bincount(nearest, held[owner].astype(float), number).argmax()] = True
    return Columns(
        xy=centre, volume=np.bincount(nearest, volume_of_dot, number), thickness=np.bincount(nearest, gap, number) / dots_in, pinned=pinned
    )


def _cells(indices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same as `np.unique` for rows `indices` (D, 2) of integers, without sorting millions of them.

    Returns:
        The distinct rows (C, 2) in order, the index (D,) of each row among them, and the number (C,) of rows equal to each.
    """
    lowest = indices.min(axis=0)
    width = int(np.ptp(indices[:, 1])) + 1
    code = (indices - lowest) @ np.array([width, 1])
    count = np.bincount(code)
    taken = np.flatnonzero(count)
    place = np.zeros(len(count), dtype=np.intp)
    place[taken] = np.arange(len(taken))
    return np.stack(np.divmod(taken, width), axis=1) + lowest, place[code], count[taken]


def spacing_for(relief: Relief, metric: np.ndarray, count: int, progress: Progress) -> float:
    """Lattice spacing [m] that gives about `count` particles, by bisection on its logarithm."""
    pixel = np.sqrt(np.linalg.det(metric))
    finest, coarsest = MIN_SPACING_PIXELS * pixel, np.sqrt(relief.mask.sum()) * pixel
    low, high = np.log(finest), np.log(max(coarsest, finest))
    nothing_held = np.zeros_like(relief.mask)

    def particles(spacing: float) -> int:
        progress.check()
        return int(layers_of(columns_of(relief, metric, spacing, nothing_held).thickness, spacing).sum())

    if particles(finest) <= count:
        return float(finest)
    middle = high
    for _ in range(20):
        middle = 0.5 * (low + high)
        found = particles(float(np.exp(middle)))
        if abs(found - count) <= COUNT_TOLERANCE * count:
            break
        low, high = (middle, high) if found > count else (low, middle)
    return float(np.exp(middle))
