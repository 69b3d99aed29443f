"""Undistort pixels, from the clip's lens to a pinhole camera: the inverse of `Camera.filmed`."""

from __future__ import annotations

import numpy as np

from ....engine.records import Camera

ROUNDS, SMALLEST = 30, 1e-6
"""Maximum number of steps of Newton's method, and its tolerance [px]."""
WIDEST = 10.0
"""Largest radius in focal lengths, at an angle of 84 degrees: no pinhole camera sees more."""


def straightened(camera: Camera, xy: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of the clip -> pixels of the pinhole camera; NaN where no point is imaged."""
    wanted = np.asarray(xy, dtype=np.float64)
    found = wanted.copy()
    if not any(camera.distortion):
        return found
    with np.errstate(all="ignore"):  # pixels beyond the lens diverge
        for _ in range(ROUNDS):
            away = camera.filmed(found) - wanted
            if not np.nanmax(np.abs(away)) > SMALLEST:
                break
            # columns of the distortion's Jacobian, by central differences
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
    """Radius [focal lengths] up to which the distortion is monotonic; farther out, its formula folds the image over."""
    k1, k2, _, _, k3 = distortion
    radius = np.linspace(0.0, WIDEST, 2001)
    folded = 1.0 + 3.0 * k1 * radius**2 + 5.0 * k2 * radius**4 + 7.0 * k3 * radius**6 <= 0.0
    return float(radius[folded.argmax()]) if folded.any() else WIDEST
