"""A digest of everything that a re-simulation depends on, cheap enough to be made at every change of the scene."""

from __future__ import annotations

import hashlib
from array import array
from typing import Any

import bpy

from ....engine.settings import BodyEdit, ColliderEdit, Edit
from ...bake.animation import keyframes
from ...bake.plan import mark_of
from ...job.status import digest_of
from ...option_properties import values_of
from ...scene_units import metres_per_unit


def edit_digest(scene: bpy.types.Scene) -> str:
    """Of everything that `resimulate` depends on: the field, and the bodies as they stand. "" while there are no bodies."""
    settings = scene.seeing_wind
    moved = [_body(body) for body in settings.bodies if body.is_recovered or body.object is not None]
    if not moved:
        return ""
    gravity = (settings.edit_gravity_mode, settings.edit_gravity_mode == "CUSTOM" and tuple(settings.edit_gravity))
    path = settings.path_from_id("field_strength")
    strength = [curve for curve in keyframes(scene) if curve[0] == path] or settings.field_strength
    colliders = [(values_of(each, ColliderEdit), _geometry(each.object)) for each in settings.colliders if each.object is not None]
    floor = (settings.floor_height, settings.floor_friction) if settings.use_floor else None
    scene_wide = (strength, gravity, values_of(settings, Edit), colliders, floor, tuple(settings.offset), metres_per_unit(scene))
    return digest_of(settings.recovered_digest, settings.recovered_stamp or settings.recovered_take, moved, *scene_wide)


def body_values(body: bpy.types.PropertyGroup) -> dict[str, Any]:
    """The values of `BodyEdit` that the panel gives; a mass goes before a density, and the clip's own object keeps its material."""
    values = values_of(body, BodyEdit)
    instead = {"density": None} if values["mass"] is not None else {}
    return values | instead | ({"material": None} if body.is_recovered else {})


def _body(body: bpy.types.PropertyGroup) -> tuple:
    held = (body.pin_group, body.is_recovered and body.free_mode, body.free_group)
    weights = _weights(body.object, body.pin_group) if body.object is not None and body.pin_group else ""
    return (body.is_recovered, _geometry(body.object), body_values(body), held, weights)


def _geometry(obj: bpy.types.Object | None) -> tuple:
    """Shape and place of a mesh object before any bake: neither playing a bake nor scrubbing changes it."""
    if obj is None or obj.type != "MESH":
        return ()
    # neither name nor session id: the one changes at a renaming, the other whenever the file is opened
    return (len(obj.data.vertices), _once(obj, "", lambda: _coordinates(obj.data)), _place(obj))


def _place(obj: bpy.types.Object) -> list:
    """Where an object stands, the same at every frame; its keyframes where it moves by itself. Those of a bake do not count."""
    mark = mark_of(obj)
    if mark is not None and mark["way"] == "TRANSFORM":
        return _rounded(mark["former"]["world"])
    lineage, moves = [obj], [_keys_of_place(obj)]
    while lineage[-1].parent is not None:
        lineage.append(lineage[-1].parent)
        moves.append(_keys_of_place(lineage[-1]))
    if not any(moves) and not any(each.constraints or each.rigid_body for each in lineage):
        return _rounded(obj.matrix_world)
    return [(keys or _rounded(each.matrix_basis), _rounded(each.matrix_parent_inverse)) for each, keys in zip(lineage, moves)]


def _keys_of_place(obj: bpy.types.Object) -> list:
    return [curve for curve in keyframes(obj) if curve[0].startswith(("location", "rotation", "scale", "delta_"))]


def _rounded(matrix) -> list[float]:
    return [round(value, 5) for row in matrix for value in row]


def _weights(obj: bpy.types.Object, group: str) -> str:
    """Of the weights of a vertex group."""
    found = obj.vertex_groups.get(group)
    if found is None:
        return ""
    index = found.index
    return _once(obj, group, lambda: digest_of([(v.index, g.weight) for v in obj.data.vertices for g in v.groups if g.group == index]))


def _coordinates(mesh: bpy.types.Mesh) -> str:
    flat = array("f", bytes(12 * len(mesh.vertices)))
    mesh.vertices.foreach_get("co", flat)
    return hashlib.sha256(flat.tobytes()).hexdigest()[:16]


def forget_geometry() -> None:
    """Blender says that meshes or weights have changed: they are digested anew."""
    _known.clear()


_known: dict[tuple[int, str], str] = {}
"""Digests of meshes and weights, by session id: computed once, and again after Blender said that the mesh has changed."""


def _once(obj: bpy.types.Object, what: str, compute) -> str:
    key = (obj.data.session_uid, what)
    if key not in _known:
        _known[key] = compute()
    return _known[key]
