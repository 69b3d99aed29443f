"""The colliders of an edit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...errors import UsageError
from ...mpm.lattice.colliders import Collider, Plane
from ...mpm.lattice.mesh_collider import MeshCollider
from ...settings import ColliderEdit
from .mesh import load_mesh
from .pins import read_way


def colliders_of(edits: Sequence[ColliderEdit], base_dir: Path, frames: int) -> list[Collider]:
    """The solver's colliders for those of an edit, in a field of `frames` frames.

    Args:
        base_dir: folder to which the edit's paths are relative.

    Raises:
        UsageError: for neither mesh nor plane or both, a missing mesh or one that is not closed, a path that does not fit, an unknown kind,
            or negative friction; the message names the collider.
    """
    return [_collider(edit, base_dir, frames) for edit in edits]


def _collider(edit: ColliderEdit, base_dir: Path, frames: int) -> Collider:
    if (edit.mesh is None) == (edit.plane is None):
        raise UsageError(f"The collider {edit.name} needs a mesh or a plane.", "Give exactly one of the two.")
    if edit.mesh_path is not None and edit.mesh is None:
        raise UsageError(f"The collider {edit.name} has a mesh_path, but no mesh.", "Leave it out; a plane stands still.")
    try:
        if edit.plane is not None:
            return Plane(point=edit.plane[:3], normal=edit.plane[3:], kind=edit.kind, friction=edit.friction)
        vertices, triangles = load_mesh(base_dir / str(edit.mesh))
        way = None
        if edit.mesh_path is not None:
            way = read_way(base_dir / edit.mesh_path, (frames + 1, len(vertices), 3), "the mesh's way")
        return MeshCollider(vertices=vertices, faces=triangles, kind=edit.kind, friction=edit.friction, path=way)
    except UsageError as error:
        raise UsageError(f"Collider {edit.name}: {error.message}", error.hint) from error
