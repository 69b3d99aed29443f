"""New results in an old object: whatever points at the object (constraints, drivers, parents, collections, other scenes' modifiers) stays.

The results of a take are made as new objects, which is simple; what is there already then takes over their data, and the new ones go.
"""

from __future__ import annotations

import re

import bpy

from ..field.display import LOOP
from ..field.node_groups import FRAMES_PER_CLIP_FRAME, get_input, modifier_input, set_input
from ..field.texture.tree import remove_texture

OF_RESULTS = ("First Frame", "Length", FRAMES_PER_CLIP_FRAME)
"""Inputs of our modifiers that follow from the results; the others (density, slice, confidence shown) are the user's."""


def can_renew(obj: bpy.types.Object | None, scene: bpy.types.Scene) -> bool:
    """Whether an object made earlier can take over new results: it is still in the scene, and of this file."""
    return obj is not None and obj.library is None and obj.override_library is None and obj.name in scene.objects and obj.type == "MESH"


def renew(former: bpy.types.Object, new: bpy.types.Object) -> bpy.types.Object:
    """Let `former` show what `new` shows, and remove `new`. Returns `former`.

    Taken over: mesh with its materials, shape keys and their animation; place and parent; the modifiers that make the results what they
    are, with their settings; the settings of the force field, and our custom properties. Kept: whether the field loops, name, collections,
    constraints, further modifiers, particle systems, and everything that points at the object.
    """
    if former.mode != "OBJECT":  # Blender gives an object in Edit Mode no other mesh, and says nothing
        with bpy.context.temp_override(object=former, active_object=former):
            bpy.ops.object.mode_set(mode="OBJECT")
    _take_mesh(former, new)
    _take_modifiers(former, new)
    _take_place(former, new)
    if new.field is not None and new.field.type != "NONE" and former.field is not None:
        _copy(new.field, former.field)
        replaced, former.field.texture = former.field.texture, new.field.texture
        remove_texture(replaced)
    for key, value in new.items():
        if key.startswith("seeing_wind") and not (key == LOOP and LOOP in former):
            former[key] = value
    for collection in new.users_collection:
        collection.objects.unlink(new)
    new.user_remap(former)
    bpy.data.objects.remove(new)
    return former


def _take_mesh(former: bpy.types.Object, new: bpy.types.Object) -> None:
    old, name = former.data, former.data.name
    former.data = new.data
    if old.users == 0:
        bpy.data.meshes.remove(old)
        former.data.name = name
    former.show_only_shape_key, former.active_shape_key_index = new.show_only_shape_key, new.active_shape_key_index


def _take_modifiers(former: bpy.types.Object, new: bpy.types.Object) -> None:
    """Node groups, by the name of their modifier, which the user may have deleted. What is set on the arrows stays as it is."""
    for modifier in new.modifiers:
        name, tree = _base(modifier.name), modifier.node_group
        own = next((each for each in former.modifiers if each.type == "NODES" and _base(each.name) == name), None)
        if own is None:
            own = former.modifiers.new(name, "NODES")
        old = own.node_group
        own.node_group = tree
        if old is not None and old.users == 0:
            bpy.data.node_groups.remove(old)
            tree.name = name
        for each in OF_RESULTS:
            if modifier_input(modifier, each) is not None:
                set_input(own, each, get_input(modifier, each))


def _base(name: str) -> str:
    """A name without the numbers that Blender adds where it is taken."""
    return re.sub(r"\.\d{3}", "", name)


def _take_place(former: bpy.types.Object, new: bpy.types.Object) -> None:
    former.parent, former.parent_type, former.parent_bone = new.parent, new.parent_type, new.parent_bone
    former.matrix_parent_inverse = new.matrix_parent_inverse
    former.matrix_basis = new.matrix_basis


def _copy(source: bpy.types.bpy_struct, target: bpy.types.bpy_struct) -> None:
    for prop in source.bl_rna.properties:
        if not prop.is_readonly and prop.type != "POINTER":
            setattr(target, prop.identifier, getattr(source, prop.identifier))
