"""A penalty on forces that only stretch the body.

The gradient of a field has an antisymmetric part, which turns a body, and a symmetric part, which stretches it. A stiff body responds to a
stretching force by less than the tracking error, and to a single camera a body that grows looks like one that comes nearer, and one that
shrinks towards one side like one that tilts. Unconstrained, such forces would fit every small mismatch. Under a single camera the symmetric
gradient therefore keeps only a fraction of its prior variance. The same holds, more weakly, for noisy 3D points and several views, unless
the evidence rejects it (`evidence.prefer_belief`), as with a field whose waves are shorter than the body.
"""

from __future__ import annotations

import numpy as np

from .basis import SpatialBasis
from .constants import PRIOR


def stretch_rows(basis: SpatialBasis, x: np.ndarray, F: np.ndarray, at: np.ndarray, volume_only: bool = False) -> np.ndarray:
    """Rows that give the stretch of the body by the coefficients of each knot, in the body's attitude at that time.

    Only axes along which the body is long count: two of a plate, one of a post. A force across a plate that varies along it only tilts and
    bends the plate.

    Args:
        basis: modes and their rest gradients (N, modes, 3) [1/m].
        x: (N, 3) rest positions [m].
        F: (T+1, N, 3, 3) deformation gradients of a nearby simulation; they turn the body's axes.
        at: (knots,) times of the knots [frames].
        volume_only: only the trace of the gradient, which would change the body's volume.

    Returns:
        (knots, M, modes, 3): row (k, m) dotted with the coefficients of knot k is the mean over the particles of a smooth function times
        one symmetric component of the gradient of the acceleration [1/s²].
    """
    frames = len(F) - 1
    smooth = basis.phi[:, basis.degree <= PRIOR.stretch_degree] / len(basis.phi)
    nearest = np.minimum(np.rint(at).astype(int), frames)
    extent, axes = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[1:]
    axes = axes[extent > PRIOR.stretch_flat * extent[0]]
    turned = np.einsum("knij,aj->knai", F[nearest], axes)
    turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    along = np.einsum("npj,bj->npb", basis.gradient, axes)  # derivative of each mode along each axis
    # (knots, M, a, b, modes, 3): smooth function m, part along axis a of the derivative along axis b.
    slope = np.einsum("nm,npb,knai->kmabpi", smooth, along, turned, optimize=True)
    pairs = [(a, b) for a in range(len(axes)) for b in range(a, len(axes))]
    if not pairs:  # a body of one particle
        return np.zeros((len(slope), 0, *slope.shape[-2:]))
    rows = np.stack([0.5 * (slope[:, :, a, b] + slope[:, :, b, a]) for a, b in pairs], axis=2)
    if volume_only:
        rows = rows[:, :, [a == b for a, b in pairs]].sum(axis=2, keepdims=True)
    return rows.reshape(len(slope), -1, *slope.shape[-2:])


def stretch_precision(rows: np.ndarray, time: np.ndarray, space: np.ndarray, component: np.ndarray, share: float) -> np.ndarray:
    """The term to add to the prior's precision so that the stretch keeps about `share` of its standard deviation.

    Args:
        rows: (knots, M, modes, 3) from `stretch_rows`.
        time: (knots, knots) correlation over time.
        space: (knots, modes, modes) the prior's correlation of the modes at each knot.
        component: (3, 3) covariance of the force's components [m²/s⁴].

    Returns:
        (n, n) with n = knots modes 3.
    """
    implied = np.einsum("kmpi,kpq,ij,kmqj->m", rows, space, component, rows, optimize=True) / len(rows)
    weight = stretch_weights(implied, share)
    flat = rows.reshape(*rows.shape[:2], -1)
    inverse = np.linalg.inv(time + 1e-9 * np.eye(len(time)))
    extra = np.einsum("kma,kl,m,lmb->kalb", flat, inverse, weight, flat, optimize=True)
    return extra.reshape(flat.shape[0] * flat.shape[2], -1)


def stretch_weights(implied: np.ndarray, share: float) -> np.ndarray:
    """Weights (M,) of rows that have the variance `implied` (M,) under the prior; 0 for rows that are zero but for rounding."""
    real = implied > 1e-9 * implied.max(initial=0.0)
    return np.where(real, (share**-2 - 1.0) / np.where(real, implied, 1.0), 0.0)
