"""What of a solid is held: the painted part of the picture shows the border on the visible side only, and the border runs on inside.

A pot is held up to its rim, also behind the rim, where the rays of unpainted pixels pass over it and go down. So the border is a plane:
through the border that is seen, and, as far as that does not say how the plane is tilted, along the view.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from .relief import Relief

ALONG_VIEW = 0.05
"""Weight of the plane running along the view, beside the border seen, for a body as thick as its border is long."""
MISPLACED = 0.1
"""Share of the smaller part of the front that may lie on the wrong side of the plane; else every layer behind a painted pixel is held."""


def held_dots(relief: Relief, held: np.ndarray, dots: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """Which dots (D, 3) [m] in the body are held, (D,) bool.

    Args:
        relief: front and back of the body.
        held: (H, W) bool, painted as held in picture 0.
        dots: places [m].
        pixel: (D,) number of each dot's pixel among those of the mask.
    """
    rows, columns = np.nonzero(relief.mask)
    painted = held[rows, columns]
    plane = _border_plane(relief, held & relief.mask)
    if plane is not None:
        front = relief.points(np.stack([columns, rows], axis=1).astype(float), 0.0)
        normal, offset = plane
        wrong = (front @ normal < offset) != painted
        if wrong.sum() <= MISPLACED * min(painted.sum(), (~painted).sum()):
            return dots @ normal < offset
    return painted[pixel]


def _border_plane(relief: Relief, held: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Normal (3,) away from what is held, and offset [m], of the plane through the border; None where nothing borders on it."""
    border = held & ndimage.binary_dilation(relief.mask & ~held)
    if not border.any():
        return None
    rows, columns = np.nonzero(border)
    xy = np.stack([columns, rows], axis=1).astype(float)
    front, back = relief.points(xy, 0.0), relief.points(xy, 1.0)
    centre, ray = front.mean(axis=0), np.median(back - front, axis=0)
    normal = np.linalg.eigh(np.cov(front.T, bias=True) + ALONG_VIEW * np.outer(ray, ray))[1][:, 0]
    rows, columns = np.nonzero(held)
    inside = relief.points(np.stack([columns, rows], axis=1).astype(float), 0.0).mean(axis=0)
    normal = normal if (inside - centre) @ normal < 0.0 else -normal
    return normal, float(centre @ normal)
