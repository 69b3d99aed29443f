"""What the bodies of an edit run into."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...errors import UsageError
from ...mpm.lattice.colliders import Collider, MeshCollider, Plane
from ...settings import ColliderEdit
from .mesh import load_mesh


def colliders_of(edits: Sequence[ColliderEdit], base_dir: Path) -> list[Collider]:
    """The solver's colliders for those of an edit.

    Args:
        base_dir: folder against which the edit's paths are understood.

    Raises:
        UsageError: neither mesh nor plane or both, no such mesh, one that is not closed, an unknown kind, negative friction; it names the
            collider.
    """
    return [_collider(edit, base_dir) for edit in edits]


def _collider(edit: ColliderEdit, base_dir: Path) -> Collider:
    if (edit.mesh is None) == (edit.plane is None):
        raise UsageError(f"The collider {edit.name} needs a mesh or a plane.", "Give exactly one of the two.")
    try:
        if edit.plane is not None:
            return Plane(point=edit.plane[:3], normal=edit.plane[3:], kind=edit.kind, friction=edit.friction)
        vertices, triangles = load_mesh(base_dir / str(edit.mesh))
        return MeshCollider(vertices=vertices, faces=triangles, kind=edit.kind, friction=edit.friction)
    except UsageError as error:
        raise UsageError(f"Collider {edit.name}: {error.message}", error.hint) from error
