"""Several edits of one field in one scene: one is active, the others are stored, and a copy stands beside its original."""

from __future__ import annotations

import bpy
from mathutils import Matrix, Vector

from ...engine.errors import UsageError
from ..bake.at_rest import discard, own_copy
from ..bake.bodies import HIDDEN, clear_body
from ..bake.motion import clear_bake
from ..bake.plan import leave
from ..job import status
from ..scene_units import metres_per_unit

MADE = "seeing_wind_made_for_edit"
"""Custom property of each object and collection that `duplicate` makes: its name then. One renamed since is the user's."""

GAP = 1.2
"""Distance between a copied edit and its original, in widths of the field."""


def switch(settings: bpy.types.PropertyGroup) -> None:
    """Activate the edit `active_edit`: store the present edit in its list entry, then load the settings of the other."""
    count = len(settings.edits)
    if count == 0 or settings.active_edit == settings.loaded_edit:
        return
    wanted = min(settings.active_edit, count - 1)
    if settings.loaded_edit < count:
        _keep(settings, settings.edits[settings.loaded_edit])
    # set first: loading the settings calls their update functions, which read the scene
    settings.loaded_edit = wanted
    _take_over(settings.edits[wanted], settings)
    if settings.active_edit != wanted:
        settings.active_edit = wanted
    status.refresh(settings.id_data)


def duplicate(scene: bpy.types.Scene) -> str:
    """Copy the present edit and its objects, place the copy beside it and make the copy active. Returns the name of the copy.

    The copies have their own meshes and material slots, and no bake yet. The original is left as it is.

    Raises:
        UsageError: when there is nothing to copy.
    """
    settings = scene.seeing_wind
    if not len(settings.bodies):
        raise UsageError("There is no edit to duplicate.", "Insert a mesh first.")
    if not len(settings.edits):
        settings.edits.add().name = "Edit 1"
        settings.loaded_edit = settings.active_edit = 0
    _keep(settings, settings.edits[settings.loaded_edit])
    new = settings.edits.add()
    new.name = _free_name(settings)
    _keep(settings, new)
    new.edit_folder = new.name.lower().replace(" ", "_")
    new.simulated_digest = new.simulated_take = new.simulated_stamp = ""
    new.coarse_digest = new.coarse_take = new.coarse_stamp = new.baked_digest = ""
    new.simulated_notes.clear()
    new.coarse_notes.clear()
    step = Vector((_width(settings) * GAP, 0.0, 0.0))
    new.offset = Vector(new.offset) + step
    collection = bpy.data.collections.new(new.name)
    collection[MADE] = collection.name
    scene.collection.children.link(collection)
    for body in new.bodies:
        body.result, body.baked_copy = "", None
        if body.object is not None:
            body.object = _beside(body.object, step / metres_per_unit(scene), collection)
            body.name = body.object.name
    settings.active_edit = len(settings.edits) - 1
    return new.name


def remove(settings: bpy.types.PropertyGroup) -> str:
    """Remove the present edit and make its neighbour active. Returns the name of the removed edit.

    The copies that `duplicate` made for the edit are removed, as are the baked stand-ins for these or for the recovered object, unless
    something else uses them. The user's own objects stay with their keyframes; *Clear Bake* removes these where no body of an edit has any.

    Raises:
        UsageError: when it is the only edit.
    """
    if len(settings.edits) < 2:
        raise UsageError("There is only one edit.", "Take its bodies off the list instead.")
    index = settings.loaded_edit
    name = settings.edits[index].name
    _let_go(settings)
    neighbour = index - 1 if index else 1
    _take_over(settings.edits[neighbour], settings)
    settings.edits.remove(index)
    settings.loaded_edit = neighbour - 1 if neighbour > index else neighbour
    settings.active_edit = settings.loaded_edit
    return name


def _let_go(settings: bpy.types.PropertyGroup) -> None:
    """Remove the objects that were made for the bodies of the present edit."""
    scene, index = settings.id_data, settings.loaded_edit
    others = [each for n, edit in enumerate(settings.edits) if n != index for each in (*edit.bodies, *edit.colliders)]
    kept = {each.object for each in others} | {each.baked_copy for each in others if hasattr(each, "baked_copy")}
    for body in settings.bodies:
        source = settings.recovered_object if body.is_recovered else body.object
        ours = body.is_recovered or (source is not None and _is_copy(source))
        going = [each for each in (body.baked_copy, None if body.is_recovered else source) if each is not None]
        if not ours or any(each in kept or _used_elsewhere(each, scene, [*going, source]) for each in going):
            leave(body, source)
            continue
        homes = [] if body.is_recovered else list(source.users_collection)
        clear_body(body)
        if not body.is_recovered:
            discard(source)
        for collection in homes:
            if not collection.all_objects and not collection.children:
                bpy.data.collections.remove(collection)


def _is_copy(obj: bpy.types.Object) -> bool:
    """Whether `duplicate` made an object, and both it and its collections still have the names they were given."""
    return obj.get(MADE) == obj.name and all(each.get(MADE) == each.name for each in obj.users_collection)


def _used_elsewhere(obj: bpy.types.Object, scene: bpy.types.Scene, among: list[bpy.types.Object]) -> bool:
    """Whether anything uses an object, apart from the scene, collections, and `among`, the objects of the same body."""
    users = bpy.data.user_map(subset={obj})[obj] - {scene, *among}
    return any(not isinstance(user, bpy.types.Collection) for user in users)


def _keep(settings: bpy.types.PropertyGroup, edit: bpy.types.PropertyGroup) -> None:
    """Store the active edit in its list entry."""
    _copy(settings, edit, _fields(edit))


def _take_over(edit: bpy.types.PropertyGroup, settings: bpy.types.PropertyGroup) -> None:
    """Load a stored edit into the scene's settings."""
    _copy(edit, settings, _fields(edit))


def _fields(edit: bpy.types.PropertyGroup) -> list[str]:
    """Names of the properties that a stored edit shares with the scene's settings: all but its name in the list."""
    return [prop.identifier for prop in edit.bl_rna.properties if prop.identifier not in ("rna_type", "name")]


def _copy(source: bpy.types.PropertyGroup, target: bpy.types.PropertyGroup, fields: list[str]) -> None:
    """Copy the properties `fields` of an edit, including those of its bodies and colliders."""
    for name in fields:
        if source.bl_rna.properties[name].type == "COLLECTION":
            _copy_items(getattr(source, name), getattr(target, name))
        else:
            setattr(target, name, getattr(source, name))


def _copy_items(source: bpy.types.bpy_prop_collection, target: bpy.types.bpy_prop_collection) -> None:
    target.clear()
    for item in source:
        new = target.add()
        for prop in item.bl_rna.properties:
            if not prop.is_readonly:
                setattr(new, prop.identifier, getattr(item, prop.identifier))


def _beside(obj: bpy.types.Object, step: Vector, collection: bpy.types.Collection) -> bpy.types.Object:
    copy = own_copy(obj)
    collection.objects.link(copy)
    copy[MADE] = copy.name
    clear_bake(copy)
    if HIDDEN in copy:
        del copy[HIDDEN]
    copy.hide_viewport = copy.hide_render = False
    bpy.context.view_layer.update()
    if copy.animation_data is None and not copy.constraints:
        copy.matrix_world = Matrix.Translation(step) @ copy.matrix_world
    else:
        # keyframes and constraints would override a change of the location itself
        copy.delta_location = Vector(copy.delta_location) + step
    return copy


def _free_name(settings: bpy.types.PropertyGroup) -> str:
    taken, number = {edit.name for edit in settings.edits}, 2
    while f"Edit {number}" in taken:
        number += 1
    return f"Edit {number}"


def _width(settings: bpy.types.PropertyGroup) -> float:
    """Width of the field along X [m]; one metre if there is no field."""
    obj = settings.field_object
    if obj is None or obj.type != "MESH" or not len(obj.data.vertices):
        return 1.0
    across = [corner[0] for corner in obj.bound_box]
    return max((max(across) - min(across)) * abs(obj.matrix_world.to_scale().x) * metres_per_unit(settings.id_data), 0.1)
