"""Aligning patches with the frame they were cut from, which keeps a chain of frame-to-frame steps from drifting.

Inverse-compositional affine alignment (Baker and Matthews 2004) of all patches at once, each normalised to its own mean and
deviation, so that brightness and contrast may change.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

HALF = 8
"""Half the patch's side: 17x17 pixels."""

BLUR = 0.7
"""Standard deviation of the blur before sampling, against noise and the codec's block edges [px]."""

ITERATIONS = 10
CONVERGED = 0.01
"""Size of the last update below which a patch needs no further iteration [px]."""

MOST_AT_ONCE = np.array([2.0, 2.0, 0.2, 0.2, 0.2, 0.2], np.float32)
"""Largest change per iteration of the position [px] and of the shape: beyond these, the linearisation is not valid."""

CORRELATED = 4.0
"""Number of neighbouring pixels whose residuals share one error (blur, the codec's blocks): a position's variance grows by this factor."""

_OFFSETS = np.stack(np.meshgrid(*2 * (np.arange(-HALF, HALF + 1, dtype=np.float32),)), axis=-1).reshape(-1, 2)
"""Single precision throughout a patch: OpenCV samples no finer, and it is twice as fast."""
_NEAR = np.exp(-0.5 * (_OFFSETS**2).sum(axis=1) / (0.6 * HALF) ** 2).astype(np.float32)


def smooth(image: np.ndarray) -> np.ndarray:
    """The smoothed grey frame (H, W) float32 that patches are cut from, for `image` (H, W, 3) uint8 RGB."""
    return cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), BLUR)


def sample(image: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Bilinear values (...,) of `image` (H, W) at points xy (..., 2) [px]; outside the image its rim is repeated."""
    points = np.ascontiguousarray(xy, dtype=np.float32)
    if not points.size:
        return np.zeros(points.shape[:-1], np.float32)
    flat = points.reshape(-1, points.shape[-2] if points.ndim > 2 else 1, 2)
    return cv2.remap(image, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(points.shape[:-1])


@dataclass(frozen=True)
class Patches:
    """Templates of K points, ready to be aligned with other frames. P = 17 * 17 pixels."""

    values: np.ndarray
    """(K, P) normalised to weighted mean 0 and deviation 1."""
    weight: np.ndarray
    """(K, P), summing to one: the object's mask times a Gaussian whose standard deviation is 0.6 of half the patch's side."""
    descent: np.ndarray
    """(K, 6, P) the inverse-compositional update's matrix: Hessian^-1 times weighted steepest descent."""
    covariance: np.ndarray
    """(K, 2, 2) covariance of the position [px²] for independent residuals of standard deviation 1 (normalised)."""

    def take(self, index: np.ndarray) -> Patches:
        """The patches of the points `index` only."""
        return Patches(self.values[index], self.weight[index], self.descent[index], self.covariance[index])


@dataclass(frozen=True)
class Alignment:
    """The positions and shapes at which K patches were found."""

    xy: np.ndarray
    """(K, 2) [px]."""
    affine: np.ndarray
    """(K, 2, 2): the patch's shape, the derivative of a position here by the position where the patch was cut."""
    ncc: np.ndarray
    """(K,) weighted normalised cross-correlation with the template."""
    sigma: np.ndarray
    """(K,) standard deviation of the position, estimated from the residuals [px]."""


def cut_patches(image: np.ndarray, mask: np.ndarray, xy: np.ndarray) -> Patches:
    """Templates round points xy (K, 2) [px] of the smoothed `image` (H, W), weighted by `mask` (H, W) float32 in 0..1."""
    grid = xy.astype(np.float32)[:, None, :] + _OFFSETS
    weight = _NEAR * sample(mask, grid) + np.float32(1e-9)
    weight /= weight.sum(axis=1, keepdims=True)
    values, deviation = _normalise(sample(image, grid), weight)
    step = np.array([[0.5, 0.0], [0.0, 0.5]], np.float32)
    gx = (sample(image, grid + step[0]) - sample(image, grid - step[0])) / deviation
    gy = (sample(image, grid + step[1]) - sample(image, grid - step[1])) / deviation
    u, v = _OFFSETS[:, 0], _OFFSETS[:, 1]
    steepest = np.stack([gx, gy, gx * u, gx * v, gy * u, gy * v], axis=1)
    # Normalising removes a constant and a factor from the residual, so their directions carry no information.
    for known in (np.ones_like(values), values):
        share = (steepest * (weight * known)[:, None, :]).sum(axis=2) / (weight * known**2).sum(axis=1)[:, None]
        steepest = steepest - share[:, :, None] * known[:, None, :]
    weighted = steepest * weight[:, None, :]
    hessian = np.matmul(weighted, np.swapaxes(steepest, 1, 2)).astype(np.float64)
    # A little damping of the four shape parameters (in units of their effect at the patch's rim) keeps flat patches from shearing.
    hessian += np.diag([1e-6, 1e-6, 2e-2, 2e-2, 2e-2, 2e-2]) * np.trace(hessian[:, :2, :2], axis1=1, axis2=2)[:, None, None]
    inverse = np.linalg.inv(hessian + 1e-12 * np.eye(6))
    descent = np.matmul(inverse.astype(np.float32), weighted)
    spread = np.matmul(descent[:, :2], np.swapaxes(descent[:, :2], 1, 2)).astype(np.float64)
    return Patches(values, weight, descent, spread)


def _normalise(raw: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    centred = raw - (weight * raw).sum(axis=1, keepdims=True)
    # A contrast of less than half a grey level is the codec's own.
    deviation = np.maximum(np.sqrt((weight * centred**2).sum(axis=1, keepdims=True)), 0.5)
    return centred / deviation, deviation


def align(patches: Patches, image: np.ndarray, xy: np.ndarray, affine: np.ndarray) -> Alignment:
    """Align the patches with the smoothed `image` (H, W), starting from positions (K, 2) [px] and shapes (K, 2, 2)."""
    xy, affine = np.array(xy, dtype=np.float64), np.array(affine, dtype=np.float64)
    moving = np.arange(len(xy))
    for _ in range(ITERATIONS):
        if not len(moving):
            break
        these = patches if len(moving) == len(xy) else patches.take(moving)
        residual = _values(image, xy[moving], affine[moving], these.weight) - these.values
        update = np.clip(np.matmul(these.descent, residual[:, :, None])[:, :, 0], -MOST_AT_ONCE, MOST_AT_ONCE)
        inverse = np.linalg.inv(np.eye(2) + update[:, 2:].reshape(-1, 2, 2))
        affine[moving] = np.matmul(affine[moving], inverse)
        step = np.matmul(affine[moving], update[:, :2, None])[:, :, 0]
        xy[moving] -= step
        moving = moving[np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2) > CONVERGED]
    values = _values(image, xy, affine, patches.weight)
    ncc = (patches.weight * values * patches.values).sum(axis=1)
    residual_variance = (patches.weight * (values - patches.values) ** 2).sum(axis=1)
    shape = np.matmul(np.matmul(affine, patches.covariance), np.swapaxes(affine, 1, 2))
    sigma = np.sqrt(CORRELATED * residual_variance * 0.5 * np.trace(shape, axis1=1, axis2=2))
    return Alignment(xy, affine, ncc, sigma)


def _values(image: np.ndarray, xy: np.ndarray, affine: np.ndarray, weight: np.ndarray) -> np.ndarray:
    grid = np.matmul(_OFFSETS, np.swapaxes(affine, 1, 2).astype(np.float32)) + xy.astype(np.float32)[:, None, :]
    return _normalise(sample(image, grid), weight)[0]
