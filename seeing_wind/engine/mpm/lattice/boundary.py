"""Which grid nodes hold a pinned body, and how the grid lies so that the answer does not depend on where the body stands.

Clamping every node that a pinned particle touches holds the body up to one and a half cells beyond the particles, by an amount that
changes as the grid is moved. Five choices take the grid out of it:

- The lattice's axes are those of the border between pinned and free material, where it lies askew (`border_axes`): steps of held nodes
  across an oblique border would let a bar bend a quarter too far.
- The lattice is laid relative to the pinned particles: along the axis in which pinned and free material face each other, a plane of
  nodes lies on the border, in the middle between the two. Velocity is zero there and grows from there on, as at a built-in end.
- A node is held when enough of the rest mass around it is pinned, counted with a Gaussian of one cell, which is wide enough not to
  feel where the single particles sit. The share is a half on the border and 0.16 a cell before it; the limit lies between.
- Where so few particles are pinned that no node has its share (a corner of a flag), the node nearest to each is clamped.
- Pinned particles near the boundary keep their place but deform with the grid and answer with their stress, as the foot of a post does.

`depth` moves the held plane below the border, in cells: for pins that were not chosen but observed, as what "hardly moved", and so
include some material that gives way. See docs/notebook/solver.md for what was measured.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr

from .colliders import Collider, align_lattice

FREE, PINNED, HELD = 0, 1, 2
"""HELD is pinned and out of reach of every free node: it takes no part at all."""

_HOLD = 0.25
"""Weight that a pinned particle must have on clamped nodes; at a flat boundary those at its brim have one half."""
_REACH = 3.0
"""Cells at which the Gaussian (standard deviation one cell) is cut."""
_ROUND = 2.6
"""Spacings round a free particle within which pinned ones tell where the border is; between two shells of a cubic lattice."""
_ONE_WAY = 0.8
"""Share of the border that must face along one line for the lattice to follow: 0.82 to 0.95 for flat ones, less for those too ragged to
say which way they face (a half for two at right angles)."""
_ASKEW = np.radians(4.0)
"""Below this a turned lattice is hardly better: half a cell over seven."""
_FACING = 1.8
"""Particles closer than this many spacings are neighbours (a cube's face diagonal is 1.41)."""


def border_axes(x: np.ndarray, pinned: np.ndarray, spacing: float) -> np.ndarray | None:
    """Axes (3, 3), as columns, one of which is normal to the border between pinned (N,) bool and free particles x (N, 3) [m].

    None where the world's own axes do: one of them is the normal, or there is no border, or none that faces one way.
    """
    if not pinned.any() or pinned.all():
        return None
    x = np.asarray(x, dtype=np.float64)
    free, held = x[~pinned], x[pinned]
    pairs = cKDTree(free).sparse_distance_matrix(cKDTree(held), _ROUND * spacing, output_type="coo_matrix")
    across = np.zeros_like(free)
    np.add.at(across, pairs.row, held[pairs.col] - free[pairs.row])
    length = np.linalg.norm(across, axis=1)
    across = across[length > 0.0] / length[length > 0.0, None]
    if not len(across):
        return None
    share, normals = np.linalg.eigh(across.T @ across / len(across))
    normal = normals[:, -1]
    axis = int(np.argmax(np.abs(normal)))
    normal = normal * np.sign(normal[axis])
    normal = _settled(normal, np.eye(3)[axis], x, pinned, free[length > 0.0], spacing)
    if share[-1] < _ONE_WAY or normal[axis] > np.cos(_ASKEW):
        return None
    # The least turn that takes the axis to the normal (Rodrigues).
    turn = np.cross(np.eye(3)[axis], normal)
    K = np.array([[0.0, -turn[2], turn[1]], [turn[2], 0.0, -turn[0]], [-turn[1], turn[0], 0.0]])
    return np.eye(3) + K + K @ K / (1.0 + normal[axis])


def _settled(normal: np.ndarray, upright: np.ndarray, x: np.ndarray, pinned: np.ndarray, border: np.ndarray, spacing: float) -> np.ndarray:
    """The border's normal (3,), or the world's axis `upright` (3,) or the body's, from what is held to what is not, if it may be that.

    A step of half a spacing across a border (M, 3) [m] tilts it: a post of four particles by 15 degrees, which then is damped twice as
    much and swings across a push along it.
    """
    around = border - border.mean(axis=0)
    radius = np.sqrt(((around - np.outer(around @ normal, normal)) ** 2).sum(axis=1).mean())
    unsure = np.arctan2(0.5 * spacing, radius)
    along = x[~pinned].mean(axis=0) - x[pinned].mean(axis=0)
    # Of a body that is held on all sides it is next to nothing, and not taken.
    along = along * np.sign(along @ normal) / max(float(np.linalg.norm(along)), spacing)
    nearest = max(upright, along, key=lambda one: float(one @ normal))
    return nearest if nearest @ normal > np.cos(unsure) else normal


def lattice_offset(
    x: np.ndarray, pinned: np.ndarray, spacing: float, dx: float, colliders: Sequence[Collider] = (), *, depth: float
) -> np.ndarray:
    """Position (3,) [m] of a node of the lattice, from rest positions x (N, 3) [m] and pinned (N,) bool; it moves with the body.

    Planes among the colliders that lie along an axis take the lattice with them, but for the axis that the pins need.

    Args:
        depth: cells below the border between free and pinned material at which a plane of nodes is to lie.
    """
    some = pinned.any() and not pinned.all()
    about = x[pinned] if some else x
    offset, axis = 0.5 * (about.min(axis=0) + about.max(axis=0)), -1
    if some:
        free, held = x[~pinned], x[pinned]
        distance, nearest = cKDTree(held).query(free)
        limit = max(_FACING * spacing, 1.2 * distance.min())
        back, opposite = cKDTree(free).query(held)
        # From either side, so that a ragged border counts alike above and below.
        above, below = distance <= limit, back <= limit
        pairs = [(free[above], held[nearest[above]]), (free[opposite[below]], held[below])]
        inwards = sum((b - a).mean(axis=0) for a, b in pairs)
        axis = int(np.argmax(np.abs(inwards)))
        border = 0.25 * sum(float((a + b)[:, axis].mean()) for a, b in pairs)
        offset[axis] = border + depth * dx * float(np.sign(inwards[axis]))
    return align_lattice(offset, dx, colliders, fixed_axis=axis)


def clamped_nodes(
    x: np.ndarray, mass: np.ndarray, pinned: np.ndarray, offset: np.ndarray, dx: float, *, depth: float
) -> tuple[np.ndarray, np.ndarray]:
    """First node (3,) int32 of a box of the lattice, and which of the box's nodes stand still, int32 (a, b, c) of 0 and 1.

    Args:
        x: (N, 3) rest positions [m].
        mass: (N,) [kg].
        pinned: (N,) bool.
        offset, dx: of the lattice [m].
        depth: as of `lattice_offset`.
    """
    if not pinned.any():
        return np.zeros(3, np.int32), np.zeros((1, 1, 1), np.int32)
    local = (x - offset) / dx
    base = np.floor(local[pinned] - 0.5).astype(int)
    lo = base.min(axis=0)
    touched = np.zeros(base.max(axis=0) + 3 - lo, bool)
    for corner in np.ndindex(3, 3, 3):
        touched[tuple((base - lo + corner).T)] = True
    clamp = np.zeros(touched.shape, np.int32)
    at = np.argwhere(touched)
    tree = cKDTree(local)
    share = ndtr(depth - 0.5)  # halfway between the last plane that is to be held and the next
    for node, near in zip(at, tree.query_ball_point(at + lo, _REACH)):
        weight = mass[near] * np.exp(-0.5 * ((local[near] - node - lo) ** 2).sum(axis=1))
        clamp[tuple(node)] = weight @ pinned[near] >= share * weight.sum()
    w = _spline(local[pinned] - base)
    hold = np.zeros(len(base))
    for corner in np.ndindex(3, 3, 3):
        hold += w[corner[0], :, 0] * w[corner[1], :, 1] * w[corner[2], :, 2] * clamp[tuple((base - lo + corner).T)]
    loose = local[pinned][hold < _HOLD]
    clamp[tuple((np.rint(loose).astype(int) - lo).T)] = 1
    return lo.astype(np.int32), clamp


def _spline(f: np.ndarray) -> np.ndarray:
    """Quadratic weights (3, n, 3) of the three nodes per axis at distance f (n, 3) in 0.5..1.5 from the first."""
    return np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2])


def particle_roles(
    x: np.ndarray, pinned: np.ndarray, offset: np.ndarray, dx: float, lo: np.ndarray, clamp: np.ndarray, *, kinematic: bool = False
) -> np.ndarray:
    """FREE, PINNED or HELD for every particle, (N,) int32. `kinematic`: the pinned ones follow a path, so none is HELD."""
    if kinematic:
        return np.where(pinned, PINNED, FREE).astype(np.int32)
    roles = np.where(pinned, HELD, FREE).astype(np.int32)
    base = np.floor((x[pinned] - offset) / dx - 0.5).astype(int) - lo
    reached = np.zeros(len(base), bool)
    for corner in np.ndindex(3, 3, 3):
        reached |= clamp[tuple((base + corner).T)] == 0
    roles[np.flatnonzero(pinned)[reached]] = PINNED
    return roles
