"""Fill the Edit list from an edit.toml that was simulated elsewhere, so that the user can continue with it in the panel."""

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
"""Name of the vertex group that is made from an edit's pins."""


def fill_edit(scene: bpy.types.Scene, take: Take, objects: dict[str, bpy.types.Object]) -> list[str] | None:
    """Fill the Edit list of a scene if it is empty.

    Args:
        take: the take of the re-simulation, which names its edit.toml. If that file is gone, the list is left as it is.
        objects: the scene's objects for the simulated bodies, by the bodies' names in the edit.

    Returns:
        Messages on what the list cannot express; empty if it now describes all that was simulated. None if the list was left as it is.

    Raises:
        TakeError: when the panel cannot hold the values of the edit.
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
    """Add an entry to the list of bodies; pinned vertices become a vertex group of the object."""
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
    """Make a vertex group of the vertices that an edit pins, with their weights. Returns its name."""
    pinned = read_array(folder / entry["pin"])
    weights = read_array(folder / entry["pin_weights"]) if "pin_weights" in entry else np.ones(len(pinned))
    group = obj.vertex_groups.new(name=PINNED)
    for vertex, weight in zip(pinned.tolist(), weights.tolist(), strict=True):
        group.add([vertex], weight, "REPLACE")
    return group.name


def _add_collider(scene: bpy.types.Scene, entry: dict[str, Any], folder: Path) -> bool:
    """Turn a level plane into the floor, and a mesh into an object at its initial place. Returns whether the panel could represent it."""
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
    """A message on the parts of an edit that the panel does not hold and another simulation would lack; empty if there are none."""
    parts = [f"the collider {each['name']}" for each in colliders]
    parts += [f"how the collider {each['name']} moves" for each in edit.get("collider", []) if "mesh_path" in each]
    parts += [f"how the pins of {each['name']} move" for each in edit.get("body", []) if "pin_path" in each]
    parts += [f"the pins of {each['name']}" for each in edit.get("body", []) if each["mesh"] == "recovered" and "pin" in each]
    parts += [f"{each['name']} let go in part" for each in edit.get("body", []) if "free" in each]
    parts += ["Blender's own force fields"] * ("forces" in edit) + ["where the field was moved to"] * ("field_place" in edit)
    parts += ["the further fields"] * ("further_field" in edit)
    return [f"Re-simulate would leave out what the file of this edit cannot give the panel: {', '.join(parts)}"] if parts else []
