"""From what a lens showed back to what a pinhole would have: the inverse of `Camera.filmed`."""

from __future__ import annotations

import numpy as np

from ....engine.records import Camera

ROUNDS, SMALLEST = 30, 1e-6
"""Steps of Newton's method at most, and when it has found a pixel [px]."""
WIDEST = 10.0
"""Focal lengths from the middle, 84 degrees: no pinhole sees more."""


def straightened(camera: Camera, xy: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of the clip's file as those of the pinhole camera; NaN where the lens shows nothing."""
    wanted = np.asarray(xy, dtype=np.float64)
    found = wanted.copy()
    if not any(camera.distortion):
        return found
    with np.errstate(all="ignore"):  # what lies beyond the lens runs away
        for _ in range(ROUNDS):
            away = camera.filmed(found) - wanted
            if not np.nanmax(np.abs(away)) > SMALLEST:
                break
            # the lens's own slopes: columns of its derivative
            (ax, ay), (bx, by) = (
                np.moveaxis(camera.filmed(found + step) - camera.filmed(found - step), -1, 0) for step in 0.5 * np.eye(2)
            )
            u, v = np.moveaxis(away, -1, 0)
            found -= np.stack([by * u - bx * v, ax * v - ay * u], axis=-1) / (ax * by - ay * bx)[..., None]
        lost = ~(np.abs(camera.filmed(found) - wanted).max(axis=-1) <= 100.0 * SMALLEST)
        radius = np.linalg.norm((found - (camera.cx, camera.cy)) / (camera.fx, camera.fy), axis=-1)
        lost |= ~(radius < _reach(camera.distortion))
    found[lost] = np.nan
    return found


def _reach(distortion: tuple[float, ...]) -> float:
    """Focal lengths from the middle up to which a lens shows things in their order; farther out its formula folds the frame over."""
    k1, k2, _, _, k3 = distortion
    radius = np.linspace(0.0, WIDEST, 2001)
    folded = 1.0 + 3.0 * k1 * radius**2 + 5.0 * k2 * radius**4 + 7.0 * k3 * radius**6 <= 0.0
    return float(radius[folded.argmax()]) if folded.any() else WIDEST
