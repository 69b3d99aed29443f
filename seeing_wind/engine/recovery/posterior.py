"""How well the force is known: the posterior covariance of the solve, which comes free with it."""

from __future__ import annotations

import numpy as np

from .forward import Forward


def posterior_deviation(forward: Forward, covariance: np.ndarray) -> np.ndarray:
    """Standard deviation of one component of the acceleration on the particles, (T, N) [m/s²].

    Args:
        forward: basis and hats.
        covariance: (n, n) posterior covariance of the unknowns.
    """
    knots, modes, _ = forward.shape
    field = covariance[: forward.size, : forward.size].reshape(knots, modes, 3, knots, modes, 3)
    per_component = np.einsum("kmilni->kmln", field) / 3.0
    deviation = []
    for weights in forward.hats:
        active = np.flatnonzero(weights)
        block = sum(weights[k] * weights[j] * per_component[k, :, j] for k in active for j in active)
        deviation.append(np.sqrt(np.maximum(np.einsum("pm,mn,pn->p", forward.basis.phi, block, forward.basis.phi), 0.0)))
    return np.stack(deviation)
