"""Colours of Gaussians that depend on the viewing direction, and how they turn with the body.

Real spherical harmonics up to degree 3 with the signs and the order of Kerbl et al. 2023, "3D Gaussian splatting", as in their PLY files.
A Gaussian that the body turns by R (the polar rotation of its F) has in the direction d the colour that it had at rest in the direction
R^T d; a stretch does not turn it (Xie et al. 2024, "PhysGaussian", section 3.5).
"""

from __future__ import annotations

import numpy as np

from ..records import Gaussians
from .gaussians import SH0, blended_gradients

_SH1 = 0.4886025119029199
_SH2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
_SH3 = (
    -0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154, -0.4570457994644658, 1.445305721320277,
    -0.5900435899266435,
)  # fmt: skip

NEWTON, CLOSE = 12, 1e-9
"""Newton iterations, at most, and how far from a rotation they may end; matrices that end farther off (flattened, mirrored) get an SVD."""


def harmonics(directions: np.ndarray, bands: int) -> np.ndarray:
    """Values (..., bands) of the first `bands` (1, 4, 9 or 16) harmonics in the directions of unit vectors (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    values = [np.full_like(x, SH0), -_SH1 * y, _SH1 * z, -_SH1 * x]
    if bands > 4:
        second = (x * y, y * z, 2.0 * z * z - x * x - y * y, x * z, x * x - y * y)
        values += [factor * value for factor, value in zip(_SH2, second)]
    if bands > 9:
        round_z, in_plane = 4.0 * z * z - x * x - y * y, x * x - y * y
        third = (
            y * (3.0 * x * x - y * y), x * y * z, y * round_z, z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y), x * round_z, z * in_plane,
            x * (x * x - 3.0 * y * y),
        )  # fmt: skip
        values += [factor * value for factor, value in zip(_SH3, third)]
    return np.stack(values[:bands], axis=-1)


def polar_rotations(F: np.ndarray) -> np.ndarray:
    """The rotation R of each F = R S, (..., 3, 3); the nearest rotation for an F that mirrors."""
    # Newton's iteration (N. J. Higham, Computing the polar decomposition, 1986) on all at once takes a third of the time of as many SVDs.
    R = np.asarray(F, dtype=np.float64)
    for _ in range(NEWTON):
        cofactors = _cofactors(R)
        determinant = np.einsum("...i,...i->...", R[..., 0, :], cofactors[..., 0, :])[..., None, None]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            before, R = R, 0.5 * (R + cofactors / determinant)
        if np.nanmax(np.abs(R - before), initial=0.0) < CLOSE:
            break
    # The cofactors of a rotation are the rotation itself.
    left = ~(np.abs(_cofactors(R) - R).max(axis=(-1, -2)) < CLOSE)
    if left.any():
        U, _, Vt = np.linalg.svd(F[left])
        U[..., 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
        R[left] = U @ Vt
    return R


def _cofactors(M: np.ndarray) -> np.ndarray:
    """The determinant times the inverse transpose of matrices (..., 3, 3)."""
    after, last = M[..., [1, 2, 0], :], M[..., [2, 0, 1], :]
    return after[..., [1, 2, 0]] * last[..., [2, 0, 1]] - after[..., [2, 0, 1]] * last[..., [1, 2, 0]]


def seen_colours(gaussians: Gaussians, x: np.ndarray, eye: np.ndarray, F: np.ndarray | None = None) -> np.ndarray:
    """RGB (G, 3) in 0..1 of Gaussians centred at x (G, 3) [m], seen from a camera at `eye` (3,) [m].

    Args:
        F: (N, 3, 3) deformation gradients of the particles; None for a body that has not turned.
    """
    toward = x - eye
    toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    if F is not None:
        toward = np.einsum("gba,gb->ga", polar_rotations(blended_gradients(gaussians, F)), toward)
    values = harmonics(toward, gaussians.sh.shape[1])
    return np.clip(0.5 + np.einsum("gk,gkc->gc", values, gaussians.sh), 0.0, 1.0)
