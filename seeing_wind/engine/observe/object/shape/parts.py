"""A body that stands or hangs on something thin: its stem, the head that the stem carries, and the sheets that grow from the stem.

An outline alone is enough to tell the parts of a flower that is held at its foot: the load's path runs from the held part to the widest
place, and where that path is narrow, it runs through a stem. A stem is a rod of its local width, round as most are. The head is locally as
deep as it is broad (`balls`), and what grows beside the load's path, such as leaves and twigs, is a thin sheet.

The rod has four particles per section, half its radius off the axis, which gives it the second moment of a disc, r² / 4 each way, and so
its bending stiffness. The particles are a radius apart, and the size of the grid's cells follows: cells that the stem does not fill would
not let it bend properly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from ....masks import pixels_of
from .inflate import balls, from_rim

CARRIES = 0.5
"""Radius along the load's path, in units of the widest circle's, from which it is in the head and no longer in the stem."""

SLENDER, SLIM = 4.0, 0.35
"""Least length of a stem in units of its breadth, and its largest radius in units of the widest circle's."""

CENTRED = 2.0
"""Power of the distance to the outline that divides the cost of a path's step, so that the path keeps to the middle."""

SWELLS = 1.3
"""Largest radius of a stem in units of its median: where a leaf begins, the outline is wider than the stem."""

ROOTED = 3.0
"""Least length of a stem's held part in units of its sections, two of the grid's cells: a shorter one could turn like a hinge."""

BESIDE = 1.0
"""Distance [px] beyond its radius up to which ragged pixels of the outline belong to the stem."""

SHEET_PIXELS = 24
"""Least area [px] of a sheet; a smaller region beside the stem is its own ragged outline."""


@dataclass(frozen=True)
class Parts:
    """Stem, head and sheets in frame 0."""

    axis: np.ndarray
    """(S, 2) points about a pixel apart on the stem's axis, from the held part to the head [px]."""
    radius: np.ndarray
    """(S,) radius of the stem there [px]."""
    stem: np.ndarray
    """(H, W) bool."""
    head: np.ndarray
    """(H, W) bool."""
    sheets: np.ndarray
    """(H, W) int: the number, from 1, of the sheet that a pixel belongs to, else 0."""

    def half(self) -> np.ndarray:
        """Half the depth (H, W) of stem and head [px], 0 elsewhere."""
        return np.where(self.stem, balls(self.stem).half, np.where(self.head, balls(self.stem | self.head).half, 0.0))


def parts_of(mask: np.ndarray, held: np.ndarray) -> Parts | None:
    """The parts of the silhouette `mask` (H, W) bool of a body that is held in `held` (H, W) bool; None if no stem carries the rest."""
    foot = held & mask
    if not foot.any():
        return None
    rim = np.where(mask, from_rim(mask), 0.0)
    widest = np.unravel_index(int(rim.argmax()), rim.shape)
    largest = float(rim[widest])
    way = _way(mask, rim, foot, widest)
    if way is None:
        return None
    along = rim[way[:, 0], way[:, 1]]
    wide = np.flatnonzero(along < CARRIES * largest)
    if not len(wide):
        return None
    usual = float(np.median(along[: wide[-1] + 1]))
    end = np.flatnonzero(along[: wide[-1] + 1] <= SWELLS * usual)[-1] + 1
    way, along = way[:end], along[:end]
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    if length < SLENDER * 2.0 * usual or usual > SLIM * largest:
        return None
    radius = np.clip(ndimage.gaussian_filter1d(along, max(2.0, 2.0 * usual), mode="nearest"), 0.5, SWELLS * usual)
    axis = _smooth(way[:, ::-1].astype(float), max(2.0, 2.0 * usual))
    distance, nearest = cKDTree(axis).query(pixels_of(mask))
    stem = np.zeros_like(mask)
    stem[mask] = distance <= radius[nearest] + BESIDE
    return Parts(axis, radius, *_beside(mask, stem, widest))


def _smooth(line: np.ndarray, sigma: float) -> np.ndarray:
    """A line of points (S, 2), smoothed along itself by a Gaussian; its ends stay in place, as point reflection continues it there."""
    more = min(int(3.0 * sigma), len(line) - 1)
    beyond = np.pad(line, ((more, more), (0, 0)), mode="reflect", reflect_type="odd")
    return ndimage.gaussian_filter1d(beyond, sigma, axis=0)[more : more + len(line)]


def _way(mask: np.ndarray, rim: np.ndarray, foot: np.ndarray, widest: tuple[np.intp, ...]) -> np.ndarray | None:
    """Rows and columns (S, 2) of the path along the middle of the mask from the far end of `foot` to `widest`; None if there is none.

    rim: (H, W) distance from the outline [px]; foot: (H, W) bool, the held part; widest: row and column of the widest place.
    """
    rows, columns = np.nonzero(mask)
    number = np.full(mask.shape, -1)
    number[rows, columns] = np.arange(len(rows))
    pairs, cost = [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        there = np.stack([rows + down, columns + right])
        inside: np.ndarray = np.all((there >= 0) & (there < np.array(mask.shape)[:, None]), axis=0)
        inside[inside] &= mask[there[0, inside], there[1, inside]]
        here, there = np.flatnonzero(inside), there[:, inside]
        middle = 0.5 * (rim[rows[here], columns[here]] + rim[there[0], there[1]])
        pairs.append(np.stack([here, number[there[0], there[1]]]))
        cost.append(np.hypot(down, right) / middle**CENTRED)
    i, j = np.concatenate(pairs, axis=1)
    graph = coo_array((np.concatenate(cost), (i, j)), shape=(len(rows), len(rows))).tocsr()
    reached, before = dijkstra(graph, directed=False, indices=number[widest], return_predecessors=True)
    end = foot[rows, columns] & np.isfinite(reached) & (rim[rows, columns] >= 0.5 * rim[foot].max())
    if not end.any():
        return None
    far = np.hypot(rows - int(widest[0]), columns - int(widest[1]))
    at = int(np.where(end, far, -1.0).argmax())
    way = [at]
    while at != number[widest]:
        at = int(before[at])
        way.append(at)
    return np.stack([rows[way], columns[way]], axis=1)


def _beside(mask: np.ndarray, stem: np.ndarray, widest: tuple[np.intp, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stem, head (H, W) bool and the sheets' numbers (H, W) int of a `mask` (H, W) bool, from the approximate `stem` (H, W) bool."""
    labels, count = ndimage.label(mask & ~stem, structure=np.ones((3, 3)))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    head = labels == labels[widest]
    sheet = (sizes >= SHEET_PIXELS) & (np.arange(count + 1) != labels[widest])
    sheet[0] = False
    numbers = np.where(sheet, np.cumsum(sheet), 0)[labels]
    return mask & ~head & (numbers == 0), head, numbers


@dataclass(frozen=True)
class Sections:
    """The stem divided into M sections across its axis."""

    place: np.ndarray
    """(M, 2) centres [px]."""
    radius: np.ndarray
    """(M,) [px]."""
    direction: np.ndarray
    """(M, 2) unit vectors along the axis."""
    length: np.ndarray
    """(M,) along the axis [px]."""
    held: np.ndarray
    """(M,) bool."""


def sections(parts: Parts, step: float, held: np.ndarray) -> Sections:
    """The stem divided into sections about `step` [px] long.

    The part that is `held` (H, W) bool ends between two sections, as how far a force bends the stem grows with the cube of its free length.
    A held part shorter than `ROOTED` sections is lengthened to that, beyond the stem's end.
    """
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(parts.axis, axis=0), axis=1))])
    column, row = np.clip(np.round(parts.axis).astype(int), 0, np.array(held.shape)[::-1] - 1).T
    on = np.flatnonzero(held[row, column])
    border = float(gone[min(on[-1] + 1, len(gone) - 2)]) if len(on) else 0.0
    begin = min(0.0, border - ROOTED * step) if border else 0.0
    foot = np.linspace(begin, border, max(1, round((border - begin) / step)) + 1)[:-1] if border else np.zeros(0)
    edges = np.concatenate([foot, np.linspace(border, gone[-1], max(2, round((gone[-1] - border) / step)) + 1)])
    at = 0.5 * (edges[1:] + edges[:-1])
    place = np.stack([np.interp(at, gone, parts.axis[:, i]) for i in range(2)], axis=1)
    beyond = min(len(gone) - 1, max(1, round(step)))
    place += np.minimum(at, 0.0)[:, None] * (parts.axis[beyond] - parts.axis[0]) / gone[beyond]
    direction = np.gradient(place, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return Sections(place, np.interp(at, gone, parts.radius), direction, np.diff(edges), at < border)
