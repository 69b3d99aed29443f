"""Colliders: planes and closed meshes, and how they are sampled at the lattice's nodes.

Planes act wherever the body goes. For a mesh, every node inside stores its depth and the direction to the nearest place of the surface (a
signed distance sampled on the lattice, as in Stomakhin et al. 2013, section 8).

Where contact begins: matter stops not at the outermost held node but about a cell before it, because its quadratic splines reach that far.
So a wall holds only nodes at least `INSET` cells behind it, which puts the surface of a resting body on the wall. Depending on where the
lattice lies, the held layer, and with it the contact, may still be half a cell off; `align_lattice` removes this error for planes normal to
one of the lattice's axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...conventions import in_figures, in_units
from ...errors import SimulationError, UsageError
from .beside import velocity_at
from .closed_mesh import signed_volume, triangle_areas
from .conditions import NONE
from .mesh_collider import KINDS, MeshCollider, check_kind
from .signed_distance import closest_on, inside_of, kept_inside_of, node_box

INSET = 0.95
"""Cells between a wall and the middle of the layer of nodes that begins to hold."""
_MOST_NODES = 3_000_000
"""Nodes of the box around all meshes (200 MB)."""
_THINNEST = 3.0
"""Least thickness of a mesh (twice its volume over its surface) [cells] for which held nodes are sure to fill it."""
_DEEP = 0.1
"""Depth inside a collider [cells] at which a particle may start without a note to the user."""


@dataclass(frozen=True)
class Plane:
    """An infinite plane; matter stays on the side that its normal points to."""

    point: tuple[float, float, float]
    """A point of the plane [m]."""
    normal: tuple[float, float, float]
    """Of any length."""
    kind: str = "separate"
    """separate: matter in contact may leave but not enter; slip: it may only slide; sticky: it does not move relative to the collider."""
    friction: float = 0.0
    """Coulomb's coefficient, for separate and slip."""

    def __post_init__(self) -> None:
        """UsageError: see `check_kind`."""
        check_kind("plane collider", self.kind, self.friction)
        for name in ("point", "normal"):
            object.__setattr__(self, name, _vector(getattr(self, name), f"The plane's {name}"))
        if not np.linalg.norm(self.normal) > 0.0:
            raise UsageError("The plane's normal has no length.", "Give the direction in which matter stays, such as 0 0 1 for a floor.")

    def side(self) -> tuple[np.ndarray, float]:
        """Unit normal n (3,) and d [m]: matter stays where n.x >= d."""
        n = np.array(self.normal) / np.linalg.norm(self.normal)
        return n, float(n @ self.point)


Collider = Plane | MeshCollider


def _vector(value: object, name: str) -> tuple[float, float, float]:
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise UsageError(f"{name} is {value}.", "Give three finite numbers.")
    return float(numbers[0]), float(numbers[1]), float(numbers[2])


# -- on the lattice ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ColliderGrid:
    """All colliders in the form that `conditions.boundary_velocity` takes."""

    planes: np.ndarray
    """(K, 8): unit normal, d, kind, friction, 0, 0; nodes with n.x < d are held [m]."""
    solid_lo: np.ndarray
    """(3,) int32, first node of `solid`."""
    solid: np.ndarray
    """(a, b, c, 8): kind (0 is outside), normal, friction, velocity of the wall [m/s]."""
    depth: np.ndarray
    """(a, b, c) depth of nodes inside a mesh, below its true surface [m]; 0 outside."""

    @property
    def active(self) -> bool:
        """Whether there is any collider."""
        return bool(self.planes[:, 4].any() or self.solid[..., 0].any())


NO_COLLIDERS = ColliderGrid(np.zeros((1, 8)), np.zeros(3, np.int32), np.zeros((1, 1, 1, 8)), np.zeros((1, 1, 1)))


def _planes(colliders: Sequence[Collider]) -> list[Plane]:
    for collider in colliders:
        if not isinstance(collider, (Plane, MeshCollider)):
            raise UsageError(f"{type(collider).__name__} is no collider.", "Give a Plane or a MeshCollider.")
    return [one for one in colliders if isinstance(one, Plane)]


def moves(collider: Collider) -> bool:
    """Whether a collider follows a path."""
    return isinstance(collider, MeshCollider) and collider.path is not None


def within_reach(colliders: Sequence[Collider], region: np.ndarray, frame: int) -> tuple[Collider, ...]:
    """The colliders that bodies in a region (2, 3) [m] could meet in a frame, planes always among them; none if none of these moves."""

    def near(mesh: MeshCollider) -> bool:
        at = mesh.vertices[None] if mesh.path is None else mesh.path[min(frame, len(mesh.path) - 1) :][:2]
        return bool((at.min(axis=(0, 1)) <= region[1]).all() and (at.max(axis=(0, 1)) >= region[0]).all())

    found = tuple(one for one in colliders if not isinstance(one, MeshCollider) or near(one))
    return found if any(moves(one) for one in found) else ()


def collider_grid(colliders: Sequence[Collider], offset: np.ndarray, dx: float, region: np.ndarray | None = None) -> ColliderGrid:
    """Colliders on the lattice with a node at `offset` (3,) [m] and spacing dx [m]; meshes only in a region (2, 3) [m], if it is given.

    Raises:
        UsageError: for something that is not a collider.
        SimulationError: when the box around the meshes has too many nodes.
    """
    walls = _planes(colliders)
    planes = np.zeros((max(1, len(walls)), 8))
    for at, wall in zip(planes, walls):
        n, d = wall.side()
        at[:6] = [*n, d - (INSET - 0.5) * dx, KINDS[wall.kind], wall.friction]
    boxes = [(mesh, *node_box(mesh, offset, dx, region)) for mesh in colliders if isinstance(mesh, MeshCollider)]
    boxes = [(mesh, first, last) for mesh, first, last in boxes if (first <= last).all()]
    if not boxes:
        return ColliderGrid(planes, NO_COLLIDERS.solid_lo, NO_COLLIDERS.solid, NO_COLLIDERS.depth)
    lo, hi = np.min([box[1] for box in boxes], axis=0), np.max([box[2] for box in boxes], axis=0)
    nodes = int(np.prod((hi - lo + 1).astype(np.int64)))
    if nodes > _MOST_NODES:
        raise SimulationError(
            f"The box around the mesh colliders has {in_figures(nodes)} grid nodes of {in_units(dx, 'm', 2)}, more than "
            f"{in_figures(_MOST_NODES)}.",
            "Use a plane for a large floor, cut the mesh to the part that bodies reach, or use fewer particles.",
        )
    solid, depth = np.zeros((*(hi - lo + 1), 8)), np.zeros(hi - lo + 1)
    for mesh, first, last in boxes:
        sampled = kept_inside_of if region is None else inside_of
        way_out, normals = sampled(mesh, tuple(first), tuple(last), tuple(offset), float(dx))
        part = tuple(slice(a, b + 1) for a, b in zip(first - lo, last - lo))
        deeper = way_out > depth[part]
        depth[part][deeper] = way_out[deeper]
        held = deeper & (way_out > (INSET - 0.5) * dx)
        solid[part][deeper, 0] = NONE
        solid[part][held, 0] = KINDS[mesh.kind]
        solid[part][held, 1:4] = normals[held]
        solid[part][held, 4] = mesh.friction
        if mesh.velocity is not None:
            nodes = offset + dx * (np.argwhere(held) + first)
            solid[part][held, 5:8] = velocity_at(nodes, mesh.vertices, mesh.velocity)
    return ColliderGrid(planes, lo.astype(np.int32), solid, depth)


def align_lattice(offset: np.ndarray, dx: float, colliders: Sequence[Collider], fixed_axis: int) -> np.ndarray:
    """The lattice's offset (3,) [m], moved so that a layer of nodes lies `INSET` cells behind the first plane along each axis.

    Args:
        fixed_axis: an axis along which the lattice must stay, -1 for none.
    """
    offset, done = np.array(offset, dtype=np.float64), {fixed_axis}
    for n, d in (plane.side() for plane in _planes(colliders)):
        axis = int(np.argmax(np.abs(n)))
        if axis not in done and abs(n[axis]) > 1.0 - 1e-9:
            offset[axis] = n[axis] * (d - INSET * dx)
            done.add(axis)
    return offset


def collider_notes(x: np.ndarray, colliders: Sequence[Collider], grid: ColliderGrid, offset: np.ndarray, dx: float) -> list[str]:
    """Notes for the user: particles x (N, 3) [m] that start inside colliders and how deep, and meshes too thin for the lattice."""
    notes = []
    for mesh in (collider for collider in colliders if isinstance(collider, MeshCollider)):
        thickness = 2.0 * abs(signed_volume(mesh.vertices, mesh.faces)) / triangle_areas(mesh.vertices, mesh.faces)[0].sum()
        if thickness < _THINNEST * dx:
            notes.append(
                f"A collider is about {in_units(thickness, 'm')} thick, less than {in_units(_THINNEST * dx, 'm')}: bodies may pass "
                "through it. Thicken it, or use more particles."
            )
    depth = np.zeros(len(x))
    for n, d in (plane.side() for plane in _planes(colliders)):
        depth = np.maximum(depth, d - x @ n)
    local = np.rint((x - offset) / dx).astype(np.int64) - grid.solid_lo
    near = np.flatnonzero(((local >= 0) & (local < grid.depth.shape)).all(axis=1))
    depth[near] = np.maximum(depth[near], grid.depth[tuple(local[near].T)])
    for mesh in (collider for collider in colliders if isinstance(collider, MeshCollider)):
        shallow = near[depth[near] < 2.0 * dx]  # so near the surface the depth of the nearest node is too coarse
        if len(shallow):
            closest, normal = closest_on(mesh, x[shallow], dx)
            way = closest - x[shallow]
            below = np.where((way * normal).sum(axis=1) > 0.0, np.linalg.norm(way, axis=1), 0.0)
            depth[shallow] = np.maximum(depth[shallow], np.where(below < 3.0 * dx, below, 0.0))
    inside = depth > _DEEP * dx
    if inside.any():
        notes.append(
            f"{inside.sum()} of {len(x)} particles start inside a collider, up to {in_units(depth.max(), 'm')} deep: they stay there or "
            "are torn off. Move the body or the collider."
        )
    return notes
