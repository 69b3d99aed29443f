"""Short digests of the shape, place and weights of objects, cheap enough to be computed at every change of the scene."""

from __future__ import annotations

import hashlib
from array import array
from collections.abc import Callable
from typing import Any, TypeVar

import bpy

from ...bake.animation import keyframes, keys_of_place, lineage, rounded, with_parents
from ...bake.plan import mark_of
from ...job.status import digest_of

T = TypeVar("T")


def geometry(obj: bpy.types.Object | None) -> tuple:
    """Digest of the shape and place of a mesh object without any bake: neither playing a bake nor scrubbing changes it."""
    if obj is None or obj.type != "MESH":
        return ()
    # neither name nor session id: a renaming changes the former, opening the file the latter
    return (len(obj.data.vertices), once_per_shape(obj, "", lambda: _coordinates(obj.data)), place(obj))


def place(obj: bpy.types.Object) -> list:
    """Where an object stands, independent of the current frame; its keyframes if it is animated. Those of a bake do not count."""
    mark = mark_of(obj)
    if mark is not None and mark["way"] == "TRANSFORM":
        return rounded(mark["former"]["world"])
    if not any(keys_of_place(each) or each.constraints or each.rigid_body for each in with_parents(obj)):
        return rounded(obj.matrix_world)
    return lineage(obj)


def may_move(obj: bpy.types.Object) -> bool:
    """Whether anything could move an object's vertices as the scene plays."""
    data = (obj, obj.data, obj.data.shape_keys)
    animated = any(each is not None and each.animation_data is not None for each in data)
    return animated or obj.parent is not None or bool(obj.constraints or obj.modifiers or obj.rigid_body)


def may_move_along(obj: bpy.types.Object) -> bool:
    """Whether anything could move an object, or change one of its numbers, as the scene plays."""
    return obj.animation_data is not None or obj.parent is not None or bool(obj.constraints or obj.rigid_body)


def moves(obj: bpy.types.Object | None) -> list:
    """Keyframes of all that moves an object's vertices: itself, shape keys, parents, and the objects of its modifiers and constraints."""
    if obj is None or obj.type != "MESH" or mark_of(obj) is not None and not obj.modifiers:
        return []
    sources: list = [obj.data.shape_keys, *(getattr(each, "object", None) for each in obj.modifiers)]
    sources += [getattr(each, "target", None) for each in obj.constraints]
    parent = obj if mark_of(obj) is None else obj.parent
    while parent is not None:
        sources.append(parent)
        parent = parent.parent
    return [curve for each in sources if each is not None for curve in keyframes(each)]


def seen_in_place_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Object:
    """The copy that carries the motion of an object which another edit has moved and hidden; the object itself where there is none."""
    lists = (scene.seeing_wind.bodies, *(edit.bodies for edit in scene.seeing_wind.edits))
    copies = (body.baked_copy for bodies in lists for body in bodies if body.object == obj)
    return next((copy for copy in copies if copy is not None and scene in copy.users_scene), obj)


def baked_motion(obj: bpy.types.Object, scene: bpy.types.Scene) -> list:
    """Stamp and keyframes of another edit's bake that moves a collider; empty if there is none."""
    seen = seen_in_place_of(obj, scene)
    mark = mark_of(seen)
    return [] if mark is None else [mark["stamp"], keyframes(seen), keyframes(seen.data.shape_keys) if seen.data.shape_keys else ()]


def weights(obj: bpy.types.Object, group: str) -> str:
    """Digest of the weights of a vertex group; "" if there is no group of that name."""
    found = obj.vertex_groups.get(group)
    if found is None:
        return ""
    index = found.index
    return once_per_shape(
        obj, group, lambda: digest_of([(v.index, g.weight) for v in obj.data.vertices for g in v.groups if g.group == index])
    )


def _coordinates(mesh: bpy.types.Mesh) -> str:
    flat = array("f", bytes(12 * len(mesh.vertices)))
    mesh.vertices.foreach_get("co", flat)
    return hashlib.sha256(flat.tobytes()).hexdigest()[:16]


def forget_geometry() -> None:
    """Drop all stored digests, after Blender has reported a change of meshes or weights."""
    _known.clear()


_known: dict[tuple[int, str], Any] = {}
"""Computed values by mesh session id and name, kept until Blender reports a change of meshes or weights."""


def once_per_shape(obj: bpy.types.Object, what: str, compute: Callable[[], T]) -> T:
    """The result of `compute` for an object's mesh; computed again only after the mesh or its weights have changed."""
    key = (obj.data.session_uid, what)
    if key not in _known:
        _known[key] = compute()
    return _known[key]
