"""Air hardly compresses, so a wind's divergence is small; and a stiff body hides it.

A force that pulls a body apart in all directions alike stretches a stiff body by less than a tracking error, and in one camera's picture
a body that grew looks like one that came nearer. Left to the data, such forces soak up every small mismatch. Fields that act through air
have little of them (in the truth of other simulators, flags, plates and squeezed clay: a fifth to a half of the shear), so the prior is
told so: the divergence, projected on smooth functions of the body, has a fraction of the variance that the rest of the prior implies.
"""

from __future__ import annotations

import numpy as np

from .basis import SpatialBasis, knots

DEGREE = 1
"""Highest degree of the smooth functions on which the divergence is held down."""


def divergence_rows(basis: SpatialBasis, F: np.ndarray, spacing: float) -> np.ndarray:
    """How the coefficients of each knot make divergence on the body as it lies at that time.

    Args:
        basis: modes and their rest gradients (N, modes, 3) [1/m].
        F: (T+1, N, 3, 3) deformation gradients of a nearby simulation; they turn rest gradients into gradients in the world.
        spacing: frames between knots.

    Returns:
        (knots, M, modes, 3): row (k, m) dotted with the coefficients of knot k is the mean of phi_m div a over the particles [1/s²].
    """
    frames = len(F) - 1
    smooth = basis.phi[:, basis.degree <= DEGREE] / len(basis.phi)
    at = np.minimum(np.rint(knots(frames, spacing)).astype(int), frames)
    inverse = np.linalg.inv(F[at])
    world = np.einsum("npj,knji->knpi", basis.gradient, inverse)
    return np.einsum("nm,knpi->kmpi", smooth, world)


def solenoidal_precision(rows: np.ndarray, time: np.ndarray, space: np.ndarray, component: np.ndarray, share: float) -> np.ndarray:
    """What to add to the prior's precision so that the divergence keeps `share` of its standard deviation.

    Args:
        rows: (knots, M, modes, 3) from `divergence_rows`.
        time, space, component: the prior's factors, (knots, knots), (modes,), (3, 3).

    Returns:
        (knots modes 3,) squared.
    """
    implied = np.einsum("kmpi,p,ij,kmpj->m", rows, space, component, rows, optimize=True) / len(rows)
    weight = np.where(implied > 0.0, (share**-2 - 1.0) / np.where(implied > 0.0, implied, 1.0), 0.0)
    flat = rows.reshape(*rows.shape[:2], -1)
    extra = np.einsum("kma,kl,m,lmb->kalb", flat, np.linalg.inv(time), weight, flat, optimize=True)
    return extra.reshape(flat.shape[0] * flat.shape[2], -1)
