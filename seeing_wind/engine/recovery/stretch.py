"""Forces that only stretch: what a stiff body hides, and one camera cannot tell from depth.

A field's gradient has a part that turns a body and a symmetric part that stretches it. A stiff body answers the second with less than a
tracking error, and in one camera's picture a body that grew looks like one that came nearer, one that shrank to one side like one that
tilted. Left to the data, such forces soak up every small mismatch. What is known beforehand: air hardly compresses, so the divergence of
a wind is small (in the truth of other simulators, flags, plates and squeezed clay: a fifth to a half of the shear). So the prior gives
the divergence, and under a single camera the whole symmetric gradient, a fraction of the variance that the rest of it implies.
"""

from __future__ import annotations

import numpy as np

from .basis import SpatialBasis, knots

DEGREE = 1
"""Highest degree of the smooth functions on which the gradient is held down."""
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def stretch_rows(basis: SpatialBasis, F: np.ndarray, spacing: float, divergence_only: bool) -> np.ndarray:
    """How the coefficients of each knot stretch the body as it lies at that time.

    Args:
        basis: modes and their rest gradients (N, modes, 3) [1/m].
        F: (T+1, N, 3, 3) deformation gradients of a nearby simulation; they turn rest gradients into gradients in the world.
        spacing: frames between knots.
        divergence_only: the trace of the gradient; otherwise all six components of its symmetric part.

    Returns:
        (knots, M, modes, 3): row (k, m) dotted with the coefficients of knot k is the mean over the particles of a smooth function times
        the divergence, or times one symmetric component (a_i,j + a_j,i) / 2, of the acceleration [1/s²].
    """
    frames = len(F) - 1
    smooth = basis.phi[:, basis.degree <= DEGREE] / len(basis.phi)
    at = np.minimum(np.rint(knots(frames, spacing)).astype(int), frames)
    world = np.einsum("npj,knji->knpi", basis.gradient, np.linalg.inv(F[at]))
    slope = np.einsum("nm,knpi->kmpi", smooth, world)
    if divergence_only:
        return slope
    rows = np.zeros((*slope.shape[:2], len(PAIRS), *slope.shape[2:]))
    for pair, (i, j) in enumerate(PAIRS):
        rows[:, :, pair, :, i] += 0.5 * slope[..., j]
        rows[:, :, pair, :, j] += 0.5 * slope[..., i]
    return rows.reshape(len(slope), -1, *slope.shape[2:])


def stretch_precision(rows: np.ndarray, time: np.ndarray, space: np.ndarray, component: np.ndarray, share: float) -> np.ndarray:
    """What to add to the prior's precision so that the stretch keeps about `share` of its standard deviation.

    Args:
        rows: (knots, M, modes, 3) from `stretch_rows`.
        time, space, component: the prior's factors, (knots, knots), (modes,), (3, 3).

    Returns:
        (knots modes 3,) squared.
    """
    implied = np.einsum("kmpi,p,ij,kmpj->m", rows, space, component, rows, optimize=True) / len(rows)
    # Components that the body hardly has (across a thin plate) are measured by the others' scale.
    implied = np.maximum(implied, 0.05 * implied.max(initial=0.0))
    weight = (share**-2 - 1.0) / implied if implied.all() else np.zeros_like(implied)
    flat = rows.reshape(*rows.shape[:2], -1)
    extra = np.einsum("kma,kl,m,lmb->kalb", flat, np.linalg.inv(time), weight, flat, optimize=True)
    return extra.reshape(flat.shape[0] * flat.shape[2], -1)
