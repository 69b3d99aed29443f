"""The objects by which a scene shows a recovered field, and why they may not be seen.

Without NumPy: the user's selection is compared with them.
"""

from __future__ import annotations

import bpy

from ..clip.match import said_of_range
from ..field.display import LEGEND_MARK, SAMPLES_MARK, SURE, is_field, said_of_unseen
from ..field.node_groups import get_input

POINTERS = ("field_object", "arrows_object", "recovered_object")
"""Results to which the scene's settings have pointers."""

SAMPLES_OBJECT, LEGEND = "samples", "legend"
"""Results that are children of the field object."""


def made_before(settings: bpy.types.PropertyGroup) -> dict[str, bpy.types.Object]:
    """The result objects of a former run by the names above, without those that the user has deleted."""
    found = {name: getattr(settings, name) for name in POINTERS}
    for child in settings.field_object.children if settings.field_object is not None else ():
        for name, mark in ((SAMPLES_OBJECT, SAMPLES_MARK), (LEGEND, LEGEND_MARK)):
            if mark in child:
                found[name] = child
    # after the user deletes the field object, these two stay behind without a parent
    for obj in settings.id_data.objects:
        for name, mark in ((SAMPLES_OBJECT, SAMPLES_MARK), (LEGEND, LEGEND_MARK)):
            if found.get(name) is None and obj.parent is None and mark in obj:
                found[name] = obj
    return {name: obj for name, obj in found.items() if obj is not None}


def shows_field(obj: bpy.types.Object, settings: bpy.types.PropertyGroup) -> bool:
    """Whether an object is a field or displays one; such an object never becomes a body or an obstacle, even when selected."""
    return is_field(obj) or SURE in obj or any(obj == each for name, each in made_before(settings).items() if name != "recovered_object")


def said_of_view(scene: bpy.types.Scene) -> list[str]:
    """Why the field is not visible in the present scene, and what to do; empty when it is visible."""
    settings = scene.seeing_wind
    field, arrows, first = settings.field_object, settings.arrows_object, settings.frame_start
    beside = said_of_range(scene, first, first + int(field["seeing_wind_frames"])) if field is not None else ""
    modifier = next((each for each in arrows.modifiers if each.type == "NODES"), None) if arrows is not None else None
    unseen = said_of_unseen(arrows, get_input(modifier, "Confidence Shown") or 0.0) if modifier is not None else ""
    return [each for each in (beside, unseen) if each]
