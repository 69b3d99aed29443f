"""The Edit list from an edit.toml that was simulated elsewhere, so that one can go on with it in the panel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...engine.conventions import NO_GRAVITY
from ...engine.errors import TakeError
from ...engine.reading import read_array, read_arrays, read_toml
from ...engine.settings import BodyEdit, ColliderEdit, Edit, options_of
from ...engine.take import Take
from ..job.takes import shown
from ..option_properties import choice_of, give, panel_options
from ..scene_units import metres_per_unit
from .resimulate.edit_export import recovered_gravity

PINNED = "Pinned"
"""Name of the vertex group that is made of an edit's pins."""


def fill_edit(scene: bpy.types.Scene, take: Take, objects: dict[str, bpy.types.Object]) -> list[str] | None:
    """Fill the Edit list of a scene that has none.

    Args:
        take: of the re-simulation; it names its edit.toml. Where that is gone, the list stays empty.
        objects: the simulated bodies in the scene, by their names in the edit.

    Returns:
        What of it the list cannot say, in words: empty where it says now what was simulated. None where it was left as it is.

    Raises:
        TakeError: when the edit does not say what the panel can hold.
    """
    settings = scene.seeing_wind
    named = take.description().get("stages", {}).get("resimulate", {}).get("settings", {}).get("edit", "")
    if len(settings.bodies) or not Path(named).is_file():
        return None
    try:
        edit = read_toml(named)
        folder = Path(named).parent
        for entry in edit.get("body", []):
            _add(settings, entry, objects.get(entry["name"]), folder)
        left = [each for each in edit.get("collider", []) if not _add_collider(scene, each, folder)]
        told = _left_out(edit, left)
        strength, gravity = edit.get("field_strength", 1.0), edit.get("gravity")
        if "preroll" in edit:
            give(settings, options_of(Edit)["preroll"], edit["preroll"])
        settings.contact = bool(edit.get("contact", False))
        for t, value in enumerate(strength if isinstance(strength, list) else [strength]):
            settings.field_strength = float(value)
            if isinstance(strength, list):
                settings.keyframe_insert("field_strength", frame=settings.frame_start + t)
        if "field" in edit:
            give(settings, options_of(Edit)["field"], edit["field"])
        if gravity is not None:
            settings.edit_gravity = gravity
            settings.edit_gravity_mode = choice_of(gravity, {"SAME": recovered_gravity(shown(settings)), "NONE": NO_GRAVITY})
    except (AttributeError, KeyError, OSError, TypeError, ValueError) as error:
        raise TakeError(f"The edit {named} cannot be taken into the panel ({error}).", "Correct it, or insert the meshes anew.") from error
    return told


def _add(settings: bpy.types.PropertyGroup, entry: dict[str, Any], obj: bpy.types.Object | None, folder: Path) -> None:
    """A line of the list; what was pinned is a vertex group of the object."""
    body = settings.bodies.add()
    body.name = body.result = entry["name"]
    if entry["mesh"] == "recovered":
        body.is_recovered, body.baked_copy = True, obj
    else:
        body.object = obj
        if obj is not None and "pin" in entry:
            body.pin_group = _pin(obj, folder, entry)
    for one in panel_options(BodyEdit):
        if one.name in entry:
            give(body, one, entry[one.name])


def _pin(obj: bpy.types.Object, folder: Path, entry: dict[str, Any]) -> str:
    """A vertex group of what an edit pins, with its weights; returns its name."""
    pinned = read_array(folder / entry["pin"])
    weights = read_array(folder / entry["pin_weights"]) if "pin_weights" in entry else np.ones(len(pinned))
    group = obj.vertex_groups.new(name=PINNED)
    for vertex, weight in zip(pinned.tolist(), weights.tolist(), strict=True):
        group.add([vertex], weight, "REPLACE")
    return group.name


def _add_collider(scene: bpy.types.Scene, entry: dict[str, Any], folder: Path) -> bool:
    """A level plane is the floor, a mesh an object of its own, where it is at first. Returns whether the panel has it now."""
    settings, plane = scene.seeing_wind, entry.get("plane")
    if plane is not None:
        if tuple(plane[3:]) != (0.0, 0.0, 1.0) or settings.use_floor or entry.get("kind", "separate") != "separate":
            return False
        settings.use_floor, settings.floor_height = True, plane[2]
        settings.floor_friction = entry.get("friction", settings.floor_friction)
        return True
    if Path(entry["mesh"]).suffix.lower() != ".npz":
        return False
    arrays, mesh = read_arrays(folder / entry["mesh"]), bpy.data.meshes.new(entry["name"])
    mesh.from_pydata((arrays["vertices"] / metres_per_unit(scene)).tolist(), [], arrays["triangles"].tolist())
    obj = bpy.data.objects.new(entry["name"], mesh)
    scene.collection.objects.link(obj)
    collider = settings.colliders.add()
    collider.name, collider.object = obj.name, obj
    for one in panel_options(ColliderEdit):
        if one.name in entry:
            give(collider, one, entry[one.name])
    return True


def _left_out(edit: dict[str, Any], colliders: list[dict[str, Any]]) -> list[str]:
    """What of an edit is not in the panel now, in words: simulated again, it would be missing."""
    parts = [f"the collider {each['name']}" for each in colliders]
    parts += [f"how the collider {each['name']} moves" for each in edit.get("collider", []) if "mesh_path" in each]
    parts += [f"how the pins of {each['name']} move" for each in edit.get("body", []) if "pin_path" in each]
    parts += [f"the pins of {each['name']}" for each in edit.get("body", []) if each["mesh"] == "recovered" and "pin" in each]
    parts += [f"{each['name']} let go in part" for each in edit.get("body", []) if "free" in each]
    parts += ["Blender's own force fields"] * ("forces" in edit) + ["where the field was moved to"] * ("field_place" in edit)
    return [f"Re-simulate would leave out what the file of this edit cannot give the panel: {', '.join(parts)}"] if parts else []
