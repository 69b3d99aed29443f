"""The thickness of a rounded body behind each of its pixels, from its outline and from how much its visible side bulges.

The union of the balls on the outline's maximal inscribed circles is everywhere as deep as it is broad (Igarashi et al. 1999, "Teddy",
inflate outlines in this way): a stem gets the section of a stem, a head that of a head. Real bodies are flatter or deeper than that. The
measured front shows by how much: its rise over a surface through its rim, relative to that of the balls' front, is used for the back, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import spsolve

from ...clip.depth import filled

SIDE = 160
"""Side [px] beyond which outlines are inflated on every second pixel, every third, and so on: the result is smooth."""
LEAK = 2
"""Width [px] along the outline in which depths may be the background's; what bulges only with these pixels is flat."""
RIM = 1.0
"""Distance from the outline [px] up to which pixels define the surface through the rim."""
SMOOTHED = 1.0
"""Standard deviation of the Gaussian over which the local bulge is measured, in radii of the inscribed circle there."""
SHRUNK, WIDER = 0.02, 8.0
"""Weight of the wider surroundings in the local bulge, and how many times as wide their Gaussian is."""
FLATTEST, DEEPEST = 0.3, 1.5
"""Bounds of the local bulge; 1 is round."""
LEAKED = 0.5
"""If, without the pixels along the outline, the bulge falls below this fraction of itself, these pixels cause it, not the body."""
CLOSEST = 0.5
"""Largest ratio of radius to distance that is assumed; such a ball fills the frame."""


@dataclass(frozen=True)
class Inflated:
    """A rounded body behind its front."""

    thickness: np.ndarray
    """(H, W) metres along the view axis behind the visible surface, 0 off the mask."""
    bulge: float
    """Rise of the front over its rim, relative to the balls': 0 is flat, 1 round."""


@dataclass(frozen=True)
class Balls:
    """The union of the balls on the maximal inscribed circles of an outline."""

    half: np.ndarray
    """(H, W) half its depth [px], 0 off the mask."""
    radius: np.ndarray
    """(H, W) radius [px] of the deepest ball there."""
    rim: np.ndarray
    """(H, W) distance from the outline [px]."""


def inflate(front: np.ndarray, mask: np.ndarray, pixel: float) -> Inflated:
    """The body behind the front (H, W) [m] with the silhouette `mask` (H, W) bool; `pixel` is a pixel's width on the body [m]."""
    cut = ndimage.find_objects(mask.astype(int))[0]
    step = -(-max(mask[cut].shape) // SIDE)
    few, shape = (slice(None, None, step),) * 2, mask[cut][::step, ::step]
    if not shape.any():  # thinner than the step everywhere
        return Inflated(np.zeros(mask.shape), 0.0)
    near, union = front[cut][few], balls(shape)
    local, whole = bulges(near, shape, step * pixel, union)
    inner = ndimage.binary_erosion(shape, iterations=-(-LEAK // step))
    without = bulges(near, inner, step * pixel, balls(inner))[1] if inner.any() else whole
    leaks = without < LEAKED * whole
    local = local * max(without, 0.0) / whole if leaks else local
    # In perspective, a ball's outline is not its widest circle, which lies behind the outline's by radius² / distance.
    hidden = np.minimum(union.radius * step * pixel / near, CLOSEST)
    depth = 2.0 * step * pixel * np.clip(local / (1.0 - hidden), FLATTEST, DEEPEST) * union.half
    thickness = np.zeros(mask.shape)
    thickness[cut] = np.where(mask[cut], _finer(depth, shape, step, mask[cut].shape), 0.0)
    return Inflated(thickness, without if leaks else whole)


def _finer(image: np.ndarray, mask: np.ndarray, step: int, shape: tuple[int, int]) -> np.ndarray:
    """An image given on every `step`-th pixel, interpolated on all pixels; off its mask it continues the nearest pixel's value."""
    if step == 1:
        return image
    return ndimage.map_coordinates(filled(image, mask), np.indices(shape) / step, order=1, mode="nearest")


def from_rim(mask: np.ndarray) -> np.ndarray:
    """Distance (H, W) [px] of the pixels of a silhouette (H, W) bool from its rim, which runs along the frame too; -0.5 outside."""
    return np.asarray(ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] - 0.5)


def balls(mask: np.ndarray) -> Balls:
    """The balls in a silhouette `mask` (H, W) bool.

    half² = max over centres c of radius(c)² - |pixel - c|², computed as a distance transform with parabolas, one axis after the other.
    """
    rim = np.where(mask, from_rim(mask), 0.0)
    square, radius = np.where(mask, rim**2, -np.inf), rim
    for axis in (0, 1):
        best, of = square.copy(), radius.copy()
        for shift in range(1, min(int(np.ceil(rim.max())) + 1, mask.shape[axis])):
            ahead, behind = [slice(None)] * 2, [slice(None)] * 2
            ahead[axis], behind[axis] = slice(shift, None), slice(None, -shift)
            for to, source in ((tuple(ahead), tuple(behind)), (tuple(behind), tuple(ahead))):
                better = square[source] - shift**2 > best[to]
                best[to] = np.where(better, square[source] - shift**2, best[to])
                of[to] = np.where(better, radius[source], of[to])
        square, radius = best, of
    return Balls(np.where(mask, np.sqrt(np.maximum(square, 0.0)), 0.0), np.where(mask, radius, 0.0), rim)


def bulges(front: np.ndarray, mask: np.ndarray, pixel: float, union: Balls) -> tuple[np.ndarray, float]:
    """Rise of the front over its rim relative to the balls': near each pixel (H, W), and on the whole. 0 is flat, 1 round.

    Args:
        front: (H, W) depth of the visible surface [m].
        mask: (H, W) bool, the silhouette.
        pixel: a pixel's width on the body [m].
        union: `balls` of the mask.
    """
    edge = mask & (union.rim < RIM)
    rise = _from_rim(-front / pixel, mask, edge)
    round_rise = _from_rim(union.half, mask, edge)
    both, square = rise * round_rise, round_rise**2
    if not square.any():
        return np.zeros(mask.shape), 0.0
    whole = float(both.sum() / square.sum())
    widths = 2.0 ** np.arange(max(2, int(np.ceil(np.log2(max(2.0, SMOOTHED * union.radius.max())))) + 1))
    tiny = 1e-9 * square.max()
    level = [
        (_blur(both, s) + SHRUNK * _blur(both, WIDER * s) + tiny * whole)
        / (_blur(square, s) + SHRUNK * _blur(square, WIDER * s) + tiny)
        for s in widths
    ]  # fmt: skip
    at = np.log2(np.maximum(1.0, SMOOTHED * union.radius))
    rows, columns = np.indices(mask.shape)
    return ndimage.map_coordinates(np.stack(level), [at, rows, columns], order=1, mode="nearest"), whole


def _blur(image: np.ndarray, sigma: float) -> np.ndarray:
    """The image blurred by a Gaussian; its mean if the Gaussian is wider than the image."""
    return ndimage.gaussian_filter(image, sigma, truncate=3.0) if sigma < max(image.shape) else np.full(image.shape, image.mean())


def _from_rim(image: np.ndarray, mask: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """The image (H, W) minus the harmonic function that equals it on the `edge` (H, W) bool of the mask; 0 off the mask."""
    inner = mask & ~edge
    if not inner.any():
        return np.zeros(mask.shape)
    number = np.full(mask.shape, -1)
    number[inner] = np.arange(inner.sum())
    rows, columns = np.nonzero(inner)
    degree, known = np.zeros(len(rows)), np.zeros(len(rows))
    pairs = []
    for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        y, x = rows + dy, columns + dx
        inside = (y >= 0) & (y < mask.shape[0]) & (x >= 0) & (x < mask.shape[1])
        inside[inside] &= mask[y[inside], x[inside]]
        degree += inside
        there = np.where(inside, number[np.where(inside, y, 0), np.where(inside, x, 0)], -1)
        pairs.append(np.stack([np.flatnonzero(there >= 0), there[there >= 0]]))
        rim = inside & (there < 0)
        known[rim] += image[y[rim], x[rim]]
    i, j = np.concatenate(pairs, axis=1)
    matrix = diags_array(degree) - coo_array((np.ones(len(i)), (i, j)), shape=(len(rows), len(rows)))
    result = np.zeros(mask.shape)
    result[inner] = image[inner] - spsolve(matrix.tocsc(), known)
    return result
