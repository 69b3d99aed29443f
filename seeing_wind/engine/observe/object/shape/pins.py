"""The held part of a solid: paint in the frame shows its border on the visible side only, and the border must be continued inside.

A pot is held up to its rim, also behind the rim, where the rays of unpainted pixels pass over the rim and go down. So the border is the
plane that separates the painted front from the rest; as far as the paint leaves its tilt open, it runs along the view. A block is held
straight across if the paint allows it: paint is rough, and a border that is tilted by a few degrees makes a post respond to a wind with a
swing across it. Otherwise, what is painted on the block's face is held straight behind that face.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.optimize import minimize
from scipy.special import expit

from ....masks import pixels_of
from .block import Block
from .relief import Relief

RIM = 2
"""Distance [px] from the outline up to which pixels are not used to find the border: paint seldom reaches the outline exactly."""
SOFT, TILTED = 1e-4, 3.0
"""Penalty on the sharpness of the border, and its factor for the tilt against the view."""
GRAZING = 0.05
"""Least cosine between a pixel's ray and the surface that it shows."""
MISPLACED = 0.1
"""Fraction of the smaller part of the front that may lie on the wrong side; if more does, every layer behind a painted pixel is held."""
SLANTED = 0.25
"""The same fraction for a border straight across a block: roughly painted, it may slant by as much as the block is broad."""


def held_dots(relief: Relief, held: np.ndarray, dots: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """Which dots (D, 3) [m] in the body are held, (D,) bool.

    Args:
        relief: front and back of the body.
        held: (H, W) bool, painted as held in frame 0.
        dots: places [m].
        pixel: (D,) index of each dot's pixel among those of the mask.
    """
    painted, front = held[relief.mask], relief.points(pixels_of(relief.mask), 0.0)

    def misplaced(guess: np.ndarray) -> float:
        return float((guess != painted).sum() / max(1, min(painted.sum(), (~painted).sum())))

    plane, block = _border_plane(relief, held & relief.mask), relief.block
    straight = None if block is None else _across(block, painted, front, relief)
    if straight is not None:
        return dots @ straight[0] < straight[1]
    by_plane = np.inf if plane is None else misplaced(front @ plane[0] < plane[1])
    by_block = np.inf if block is None else misplaced(block.held(front, held))
    if plane is not None and by_plane <= min(by_block, MISPLACED):
        return dots @ plane[0] < plane[1]
    if block is not None and by_block <= MISPLACED:
        return block.held(dots, held)
    return painted[pixel]


def _across(block: Block, painted: np.ndarray, front: np.ndarray, relief: Relief) -> tuple[np.ndarray, float] | None:
    """The plane perpendicular to one of the block's edges with as much of the visible surface on its held side as is painted.

    Args:
        painted: (P,) bool, which pixels of the mask are painted as held.
        front: (P, 3) the points that these pixels show [m].

    Returns:
        normal (3,) away from the held part, and offset [m]; None if too much of the paint, or of the rest, would lie on the wrong side.
    """
    ray = front - relief.camera.pose(0)[:3, 3]
    normal = np.stack([plane.normal for plane in (block.face, *block.sides)])[np.maximum(block.shown()[relief.mask], 0)]
    distance = np.linalg.norm(ray, axis=1)
    area = distance**3 / np.maximum(np.abs((ray * normal).sum(axis=1)), GRAZING * distance)  # of the surface behind a pixel
    smaller, best = min(area[painted].sum(), area[~painted].sum()), None
    for axis in (*block.frame(), *-block.frame()):
        height = front @ axis
        order = np.argsort(height)
        offset = float(height[order[min(np.searchsorted(np.cumsum(area[order]), area[painted].sum()), len(order) - 1)]])
        wrong = float(area[(height < offset) != painted].sum())
        if wrong <= SLANTED * smaller and (best is None or wrong < best[0]):
            best = (wrong, axis, offset)
    return None if best is None else best[1:]


def _border_plane(relief: Relief, held: np.ndarray) -> tuple[np.ndarray, float] | None:
    """The plane that best separates the painted part of the front from the rest, by logistic regression with a ridge penalty.

    Returns:
        normal (3,) away from the held part, and offset [m]; None if all or none of the front is painted, or no plane separates it.
    """
    inner = ndimage.binary_erosion(relief.mask, iterations=RIM)
    if not ((held & inner).any() and (inner & ~held).any()):
        return None
    front = relief.points(pixels_of(inner), 0.0)
    centre, axes, side = front.mean(axis=0), relief.camera.pose(0)[:3, :3], np.where(held[inner], -1.0, 1.0)
    scale = float(np.sqrt(front.var(axis=0).sum()))
    local = np.column_stack([(front - centre) @ axes / scale, np.ones(len(front))])
    ridge = SOFT * np.array([1.0, 1.0, TILTED, 0.0])

    def loss(w: np.ndarray) -> tuple[float, np.ndarray]:
        margin = side * (local @ w)
        pull = -(side * expit(-margin)) @ local / len(local)
        return float(np.logaddexp(0.0, -margin).mean() + ridge @ w**2), pull + 2.0 * ridge * w

    w = minimize(loss, np.zeros(4), jac=True, method="L-BFGS-B").x
    steep = float(np.linalg.norm(w[:3]))
    if not steep > 0.0:
        return None
    normal = axes @ w[:3] / steep
    return normal, float(centre @ normal - w[3] / steep * scale)
