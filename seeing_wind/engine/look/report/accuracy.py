"""Errors of a recovered field against a known one: the two numbers of the paper's tables."""

from __future__ import annotations

import numpy as np

from ...errors import UsageError

WEAK = 0.05
"""Places where the true force is below this fraction of the clip's root mean square are left out: a relative error means nothing there."""


def field_errors(want: np.ndarray, got: np.ndarray, free: np.ndarray | None = None) -> tuple[float, float]:
    """Magnitude error [%] and direction error [degrees], means over free particles and frames.

    Args:
        want: (T, N, 3) true force density [N/m³].
        got: (T, N, 3) recovered force density [N/m³] at the same points.
        free: (N,) bool, the particles that are not held; None counts all.

    Raises:
        UsageError: for shapes that differ, values that are not finite, or a truth without any force.
    """
    want, got = np.asarray(want, dtype=np.float64), np.asarray(got, dtype=np.float64)
    if want.shape != got.shape or want.ndim != 3:
        raise UsageError(f"The recovered force has shape {got.shape}, the truth {want.shape}.")
    if not (np.isfinite(want).all() and np.isfinite(got).all()):
        raise UsageError("The forces to compare have values that are not finite.")
    if free is not None:
        want, got = want[:, free], got[:, free]
    size, norm = np.linalg.norm(want, axis=-1), np.linalg.norm(got, axis=-1)
    use = size > WEAK * np.sqrt((size**2).mean()) if size.size else np.zeros(size.shape, dtype=bool)
    if not use.any():
        raise UsageError("The true force is zero everywhere: there is nothing to compare with.")
    cosine = (want * got).sum(axis=-1) / np.maximum(size * norm, 1e-12)
    magnitude = 100 * np.abs(norm - size)[use] / size[use]
    return float(magnitude.mean()), float(np.degrees(np.arccos(np.clip(cosine[use], -1, 1))).mean())


def uniform_errors(want: np.ndarray, free: np.ndarray | None = None) -> tuple[float, float]:
    """The errors of the uniform field with the right net force in every frame: those of a recovery without any spatial detail."""
    want = np.asarray(want, dtype=np.float64)
    chosen = want if free is None else want[:, free]
    return field_errors(want, np.broadcast_to(chosen.mean(axis=1, keepdims=True), want.shape), free)
