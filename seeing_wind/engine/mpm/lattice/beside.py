"""The motion of places next to points that move: pinned particles, or the vertices of a collider."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

_NEAREST = 12
"""How many of the nearest points determine the motion of a place."""


def carried(x: np.ndarray, then: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Where places x (P, 3) would be now if each moved rigidly with the points nearest to it, at `then` and `now` (M, 3); all [m]."""
    if not len(x):
        return x
    near = cKDTree(then).query(x, k=min(_NEAREST, len(then)))[1].reshape(len(x), -1)
    then, now = then[near], now[near]
    centre, centre_now = then.mean(axis=1, keepdims=True), now.mean(axis=1, keepdims=True)
    covariance = np.einsum("pki,pkj->pij", now - centre_now, then - centre)
    # A little of the identity is added: a rotation that the points do not determine (all on one line, or a single one) is then none.
    size = np.einsum("pki,pki->p", then - centre, then - centre)
    U, _, Vt = np.linalg.svd(covariance + (1e-6 * size + 1e-30)[:, None, None] * np.eye(3))
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    return centre_now[:, 0] + np.einsum("pij,pj->pi", U @ Vt, x - centre[:, 0])


def velocity_at(places: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Velocity (P, 3) [m/s] at places (P, 3) next to points x (M, 3) [m] with velocities v (M, 3) [m/s].

    It is a least-squares fit to the nearest points: their rigid motion, plus an affine fit to what remains.
    """
    if not len(places):
        return np.zeros((0, 3))
    near = cKDTree(x).query(places, k=min(_NEAREST, len(x)))[1].reshape(len(places), -1)
    centre, mean = x[near].mean(axis=1), v[near].mean(axis=1)
    r, u = x[near] - centre[:, None], v[near] - mean[:, None]
    size = np.einsum("pki,pki->p", r, r)[:, None, None] + 1e-30
    square = np.einsum("pki,pkj->pij", r, r)
    one = np.eye(3)
    inertia = np.trace(square, axis1=1, axis2=2)[:, None, None] * one - square + 1e-6 * size * one
    spin = np.linalg.solve(inertia, np.cross(r, u).sum(axis=1)[..., None])[..., 0]
    u = u - np.cross(spin[:, None], r)
    slope = np.einsum("pki,pkj->pij", u, r) @ np.linalg.inv(square + 1e-2 * size * one)
    away = places - centre
    return mean + np.cross(spin, away) + np.einsum("pij,pj->pi", slope, away)
