"""The Edit list from an edit.toml that was simulated elsewhere, so that one can go on with it in the panel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ...engine.errors import TakeError
from ...engine.reading import read_toml
from ...engine.settings import BodyEdit, Edit, options_of
from ...engine.take import Take
from ..option_properties import give, panel_options


def fill_edit(scene: bpy.types.Scene, take: Take, objects: dict[str, bpy.types.Object]) -> None:
    """Fill the Edit list of a scene that has none.

    Args:
        take: of the re-simulation; it names its edit.toml. Where that is gone, the list stays empty.
        objects: the simulated bodies in the scene, by their names in the edit.

    Raises:
        TakeError: when the edit does not say what the panel can hold.
    """
    settings = scene.seeing_wind
    named = take.description().get("stages", {}).get("resimulate", {}).get("settings", {}).get("edit", "")
    if len(settings.bodies) or not Path(named).is_file():
        return
    try:
        edit = read_toml(named)
        for entry in edit.get("body", []):
            _add(settings, entry, objects.get(entry["name"]))
        strength, gravity = edit.get("field_strength", 1.0), edit.get("gravity")
        settings.contact = bool(edit.get("contact", False))
        for t, value in enumerate(strength if isinstance(strength, list) else [strength]):
            settings.field_strength = float(value)
            if isinstance(strength, list):
                settings.keyframe_insert("field_strength", frame=settings.frame_start + t)
        if "field" in edit:
            give(settings, options_of(Edit)["field"], edit["field"])
        if gravity is not None:
            settings.edit_gravity_mode, settings.edit_gravity = "CUSTOM", gravity
    except (AttributeError, KeyError, OSError, TypeError, ValueError) as error:
        raise TakeError(f"The edit {named} cannot be taken into the panel ({error}).", "Correct it, or insert the meshes anew.") from error


def _add(settings: bpy.types.PropertyGroup, entry: dict[str, Any], obj: bpy.types.Object | None) -> None:
    body = settings.bodies.add()
    body.name = body.result = entry["name"]
    if entry["mesh"] == "recovered":
        body.is_recovered, body.baked_copy = True, obj
    else:
        body.object = obj
    for one in panel_options(BodyEdit):
        if one.name in entry:
            give(body, one, entry[one.name])
