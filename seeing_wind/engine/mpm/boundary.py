"""Which grid nodes hold a pinned body still, and how the grid lies so that the answer does not depend on where the body stands.

Clamping every node that a pinned particle touches holds the body up to one and a half cells beyond the particles, and moves as the grid
is moved. Here the lattice is laid relative to the pinned particles: along the axis in which pinned and free material face each other
a plane of nodes goes through the middle between the two. Then only the nodes whose rest mass is mainly pinned stand still: those on that plane and behind it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

CLAMP_FRACTION = 0.25
"""A node stands still when at least this share of the rest mass around it is pinned. With a plane of nodes at the boundary the share is one
half on it and 1/48 on the next, so the choice lies far from both."""

_FACING = 1.8
"""Particles closer than this many spacings are neighbours (a cube's face diagonal is 1.41)."""


def lattice_offset(x: np.ndarray, pinned: np.ndarray, spacing: float) -> np.ndarray:
    """Position (3,) [m] of a node of the lattice, from rest positions x (N, 3) [m] and pinned (N,) bool; moves with the body."""
    some = pinned.any() and not pinned.all()
    about = x[pinned] if some else x
    offset = 0.5 * (about.min(axis=0) + about.max(axis=0))
    if some:
        free = x[~pinned]
        distance, nearest = cKDTree(x[pinned]).query(free)
        facing = distance < max(_FACING * spacing, distance.min() * 1.2)
        across = free[facing] - x[pinned][nearest[facing]]
        axis = int(np.argmax(np.abs(across.mean(axis=0))))
        offset[axis] = (0.5 * (free[facing] + x[pinned][nearest[facing]]))[:, axis].mean()
    return offset


def clamped_nodes(x: np.ndarray, mass: np.ndarray, pinned: np.ndarray, offset: np.ndarray, dx: float) -> tuple[np.ndarray, np.ndarray]:
    """First node (3,) int32 of a box of the lattice, and which of the box's nodes stand still, int32 (a, b, c) of 0 and 1."""
    if not pinned.any():
        return np.zeros(3, np.int32), np.zeros((1, 1, 1), np.int32)
    local = (x - offset) / dx
    base = np.floor(local - 0.5).astype(int)
    lo = base[pinned].min(axis=0) - 3
    dims = base[pinned].max(axis=0) + 6 - lo
    near = np.all((base >= lo) & (base + 3 <= lo + dims), axis=1)
    total, held = np.zeros(dims), np.zeros(dims)
    f = local[near] - base[near]
    w = np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2])
    for i, j, k in np.ndindex(3, 3, 3):
        index = tuple((base[near] - lo + [i, j, k]).T)
        share = mass[near] * w[i, :, 0] * w[j, :, 1] * w[k, :, 2]
        np.add.at(total, index, share)
        np.add.at(held, index, share * pinned[near])
    return lo.astype(np.int32), ((held >= CLAMP_FRACTION * total) & (held > 0.0)).astype(np.int32)
