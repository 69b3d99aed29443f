"""Put new results into existing objects, so that references to these (constraints, drivers, parents, other scenes' modifiers) stay valid.

The results of a take are first made as new objects, which is simple; the existing objects then take over their data, and the new objects
are removed.
"""

from __future__ import annotations

import re

import bpy

from ..composite.own import drop_unused
from ..field.display import LOOP
from ..field.node_groups import FIRST_FRAME, FRAMES_PER_CLIP_FRAME, get_input, modifier_input, set_input
from ..field.texture.tree import parts_of, remove_texture

OF_RESULTS = (FIRST_FRAME, "Length", FRAMES_PER_CLIP_FRAME)
"""Inputs of our modifiers that follow from the results; the others (density, slice, confidence shown) are the user's."""


def can_renew(obj: bpy.types.Object | None, scene: bpy.types.Scene) -> bool:
    """Whether an existing object can take over new results: a mesh that is still in the scene and local to this file."""
    return obj is not None and obj.library is None and obj.override_library is None and obj.name in scene.objects and obj.type == "MESH"


def renew(former: bpy.types.Object, new: bpy.types.Object) -> bpy.types.Object:
    """Let `former` show what `new` shows, and remove `new`. Returns `former`.

    Taken over: the mesh with its materials, shape keys and their animation; transform and parent; our own modifiers and those of their
    inputs that follow from the results; the settings of the force field; and our custom properties. Kept: whether the field loops, name,
    collections, constraints, other modifiers, particle systems, and every reference to the object.
    """
    if former.mode != "OBJECT":  # in Edit Mode, Blender silently ignores a new mesh
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
        gone = _discard_mesh(old)
        former.data.name = name
        for material in former.data.materials:
            _take_name(material, gone)
            for image in _images(material):
                _take_name(image, gone)
        keys = former.data.shape_keys
        if keys is not None and keys.animation_data is not None and keys.animation_data.action is not None:
            _take_name(keys.animation_data.action, gone)
    former.show_only_shape_key, former.active_shape_key_index = new.show_only_shape_key, new.active_shape_key_index


def discard(obj: bpy.types.Object) -> None:
    """Remove one of our objects with the mesh and node groups that only it used."""
    data, groups = obj.data, _groups(obj)
    bpy.data.objects.remove(obj)
    if isinstance(data, bpy.types.Mesh) and data.users == 0:
        _discard_mesh(data)
    for group in groups:
        if group.users == 0:
            bpy.data.node_groups.remove(group)


def tidy(made: dict[str, bpy.types.Object], before: str) -> None:
    """Give results the names that they would have in a file without earlier results, and remove unused datablocks that hold these names.

    Args:
        made: the results by the names of `POINTERS`, `SAMPLES_OBJECT` and `LEGEND`.
        before: name of the new field object before it was merged into the former one; names of other results begin with it.
    """
    now = made["field_object"].name
    texture = made["field_object"].field.texture
    blocks = [block for obj in made.values() for block in (obj, obj.data, *_groups(obj))] + list(parts_of(texture))
    pools = ((bpy.types.Object, bpy.data.objects), (bpy.types.Mesh, bpy.data.meshes), (bpy.types.NodeTree, bpy.data.node_groups),
             (bpy.types.Texture, bpy.data.textures), (bpy.types.Image, bpy.data.images))  # fmt: skip
    for block in blocks:
        if block.name == before or block.name.startswith(f"{before} "):
            name = now + _base(block.name.removeprefix(before))
            drop_unused(next(pool for kind, pool in pools if isinstance(block, kind)), name)
            block.name = name


def _groups(obj: bpy.types.Object) -> list[bpy.types.NodeTree]:
    return [each.node_group for each in obj.modifiers if each.type == "NODES" and each.node_group is not None]


def _discard_mesh(mesh: bpy.types.Mesh) -> set[str]:
    """Remove a mesh that nothing uses, with the materials, images and keyframes that only it used. Returns the freed names."""
    keys = mesh.shape_keys
    action = keys.animation_data.action if keys is not None and keys.animation_data is not None else None
    materials = [each for each in mesh.materials if each is not None]
    images = [image for each in materials for image in _images(each)]
    gone = {mesh.name}
    bpy.data.meshes.remove(mesh)
    for pool, blocks in ((bpy.data.materials, materials), (bpy.data.images, images), (bpy.data.actions, [action] if action else [])):
        for each in [each for each in dict.fromkeys(blocks) if each.users == 0]:
            gone.add(each.name)
            pool.remove(each)
    return gone


def _images(material: bpy.types.Material | None) -> list[bpy.types.Image]:
    nodes = material.node_tree.nodes if material is not None and material.node_tree is not None else ()
    return [node.image for node in nodes if node.type == "TEX_IMAGE" and node.image is not None]


def _take_name(block: bpy.types.ID, free: set[str]) -> None:
    """Give a new datablock the name of its former counterpart, if that is among the `free` names."""
    name = next((each for each in free if _base(each) == _base(block.name)), None)
    if name is not None:
        block.name = name


def _take_modifiers(former: bpy.types.Object, new: bpy.types.Object) -> None:
    """Put new node groups into the modifiers of the same name, made anew if the user deleted them. The user's inputs stay as they are."""
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
    """A name without the numeric suffixes that Blender adds to make names unique."""
    return re.sub(r"\.\d{3}", "", name)


def _take_place(former: bpy.types.Object, new: bpy.types.Object) -> None:
    former.parent, former.parent_type, former.parent_bone = new.parent, new.parent_type, new.parent_bone
    former.matrix_parent_inverse = new.matrix_parent_inverse
    former.matrix_basis = new.matrix_basis


def _copy(source: bpy.types.bpy_struct, target: bpy.types.bpy_struct) -> None:
    for prop in source.bl_rna.properties:
        if not prop.is_readonly and prop.type != "POINTER":
            setattr(target, prop.identifier, getattr(source, prop.identifier))
