"""Which grid nodes hold a pinned body, and how the grid is placed so that the result does not depend on where the body stands.

Clamping every node that a pinned particle touches would hold the body up to one and a half cells beyond the particles, by an amount that
changes as the grid is moved. Five choices remove this dependence on the grid:

- Where the border between pinned and free material is oblique, the lattice's axes follow it (`border_axes`): stair-steps of held nodes
  across an oblique border would let a bar bend a quarter too far.
- The lattice is placed relative to the pinned particles: along the axis in which pinned and free material face each other, a plane of
  nodes lies on the border, midway between the two. Velocity is zero there and grows from there on, as at a built-in end.
- A node is held when enough of the rest mass around it is pinned, weighted with a Gaussian of one cell, which is wide enough not to
  depend on where single particles sit. The share is a half on the border and 0.16 a cell before it; the limit lies between.
- Where so few particles are pinned that no node reaches this share (a corner of a flag), the node nearest to each of them is clamped.
- Pinned particles near the boundary keep their place but deform with the grid and respond with their stress, as the foot of a post does.

`depth` moves the held plane below the border, in cells: for pins that were not chosen but observed to have "hardly moved", and so
include some material that gives way. docs/notebook/solver.md has the measurements.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr

from .colliders import Collider, align_lattice

FREE, PINNED, HELD = 0, 1, 2
"""Roles of a particle. HELD is pinned and touches no free node: it is left out of the simulation."""

_HOLD = 0.25
"""Least total weight that a pinned particle must have on clamped nodes; at a flat border, particles at its edge have one half."""
_REACH = 3.0
"""Cells at which the Gaussian (standard deviation one cell) is cut off."""
_ROUND = 2.6
"""Radius around a free particle, in spacings, within which pinned particles determine the border; between two shells of a cubic lattice."""
_ONE_WAY = 0.8
"""Share of the border that must face along one line for the lattice to follow it: 0.82 to 0.95 for flat borders, less for those too ragged
to have a direction (a half for two borders at right angles)."""
_ASKEW = np.radians(4.0)
"""Least angle for which the lattice is turned; below it, half a cell over seven, there is hardly anything to gain."""
_FACING = 1.8
"""Particles closer than this many spacings are neighbours (a cube's face diagonal is 1.41)."""


def border_axes(x: np.ndarray, pinned: np.ndarray, spacing: float) -> np.ndarray | None:
    """Axes (3, 3), as columns, one of which is normal to the border between pinned (N,) bool and free particles x (N, 3) [m].

    None where the world's axes will do: one of them is the normal, or there is no border, or it does not face one way.
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
    # The smallest rotation that takes the axis to the normal (Rodrigues).
    turn = np.cross(np.eye(3)[axis], normal)
    K = np.array([[0.0, -turn[2], turn[1]], [turn[2], 0.0, -turn[0]], [-turn[1], turn[0], 0.0]])
    return np.eye(3) + K + K @ K / (1.0 + normal[axis])


def _settled(normal: np.ndarray, upright: np.ndarray, x: np.ndarray, pinned: np.ndarray, border: np.ndarray, spacing: float) -> np.ndarray:
    """The border's normal (3,), replaced by the world's axis `upright` (3,) or by the body's axis if it cannot be told from one of them.

    The body's axis leads from the pinned particles to the free ones. A step of half a spacing across the border (M, 3) [m] tilts the
    normal: that of a post four particles wide by 15 degrees, and the post is then damped twice as much and swings sideways when pushed.
    """
    around = border - border.mean(axis=0)
    radius = np.sqrt(((around - np.outer(around @ normal, normal)) ** 2).sum(axis=1).mean())
    unsure = np.arctan2(0.5 * spacing, radius)
    along = x[~pinned].mean(axis=0) - x[pinned].mean(axis=0)
    # For a body that is held on all sides it is close to zero, and so is not chosen.
    along = along * np.sign(along @ normal) / max(float(np.linalg.norm(along)), spacing)
    nearest = max(upright, along, key=lambda one: float(one @ normal))
    return nearest if nearest @ normal > np.cos(unsure) else normal


def lattice_offset(
    x: np.ndarray, pinned: np.ndarray, spacing: float, dx: float, colliders: Sequence[Collider] = (), *, depth: float
) -> np.ndarray:
    """Position (3,) [m] of a node of the lattice, from rest positions x (N, 3) [m] and pinned (N,) bool; it moves with the body.

    Along each axis the lattice is aligned with the first collider plane normal to it, except along the axis that the pins determine.

    Args:
        depth: how far below the border between free and pinned material a plane of nodes is to lie [cells].
    """
    some = pinned.any() and not pinned.all()
    about = x[pinned] if some else x
    offset, axis = 0.5 * (about.min(axis=0) + about.max(axis=0)), -1
    if some:
        free, held = x[~pinned], x[pinned]
        distance, nearest = cKDTree(held).query(free)
        limit = max(_FACING * spacing, 1.2 * distance.min())
        back, opposite = cKDTree(free).query(held)
        # Found from either side, so that both sides of a ragged border have the same weight.
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
    """First node (3,) int32 of a box of the lattice, and which of the box's nodes are clamped, (a, b, c) int32 of 0 and 1.

    Args:
        x: (N, 3) rest positions [m].
        mass: (N,) [kg].
        pinned: (N,) bool.
        offset, dx: of the lattice [m].
        depth: as in `lattice_offset`.
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
    share = ndtr(depth - 0.5)  # halfway between the outermost plane of nodes that is to be held and the next
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
    """Quadratic weights (3, n, 3) of the three nodes along each axis, for distances f (n, 3) in 0.5..1.5 from the first [cells]."""
    return np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2])


def particle_roles(
    x: np.ndarray, pinned: np.ndarray, offset: np.ndarray, dx: float, lo: np.ndarray, clamp: np.ndarray, *, kinematic: bool = False
) -> np.ndarray:
    """FREE, PINNED or HELD for every particle, (N,) int32. `kinematic`: pinned particles follow a path, so none is HELD."""
    if kinematic:
        return np.where(pinned, PINNED, FREE).astype(np.int32)
    roles = np.where(pinned, HELD, FREE).astype(np.int32)
    base = np.floor((x[pinned] - offset) / dx - 0.5).astype(int) - lo
    reached = np.zeros(len(base), bool)
    for corner in np.ndindex(3, 3, 3):
        reached |= clamp[tuple((base + corner).T)] == 0
    roles[np.flatnonzero(pinned)[reached]] = PINNED
    return roles
