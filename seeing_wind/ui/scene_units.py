"""Conversion between metres and scene units."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..engine.errors import TakeError, UsageError
from .field.display import is_field
from .job import takes
from .user_paths import absolute

METRES = "seeing_wind_metres"
"""Custom property of a field object: the length of a scene unit [m] when its values were converted to scene units."""
SAME = 1e-6
"""Relative difference below which two scales are the same in single precision."""
ALIKE = 1e-3
"""Largest relative difference between the sides of a field's box and of its take's, both over their longest, for the same field."""


def metres_per_unit(scene: bpy.types.Scene) -> float:
    """Length of one unit of the scene's coordinates [m]; 1 if the scene has no unit system."""
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else float(settings.scale_length)


def unit_of(field: bpy.types.Object) -> float:
    """Length of the scene unit [m] that a field object was made for; 0 if it is not known. Winds without a take are those of the library,
    which is made in metres."""
    return float(field.get(METRES, 0.0 if field.get("seeing_wind_take") else 1.0))


def learn_units(scene: bpy.types.Scene) -> None:
    """Note the unit of field objects that an earlier version made without noting it; called when their file is opened.

    Without its take, a field is taken to be made for the scene's present unit, so that at least a later change is noticed.
    """
    for field in scene.objects if scene.library is None else ():
        if is_field(field) and not unit_of(field) and field.library is None and field.override_library is None:
            field[METRES] = _unit_by_take(field, scene) or metres_per_unit(scene)


def _unit_by_take(field: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Size of a field's box in its take [m] over that of the object's mesh [scene units]; 0 if the take is gone or has another field."""
    import numpy as np

    from ..engine.take import Take
    from .job.take_reading import field_summary

    settings = scene.seeing_wind
    shown = field == settings.field_object and settings.recovered_take
    try:
        sides = np.ptp(field_summary(Take(takes.shown(settings) if shown else Path(absolute(field["seeing_wind_take"])))).box, axis=0)
    except (TakeError, OSError):
        return 0.0
    ratios = sides / np.ptp([vertex.co for vertex in field.data.vertices], axis=0)
    if not np.ptp(ratios) < ALIKE * ratios.max():
        return 0.0
    found, now = float(f"{ratios.mean():.4g}"), metres_per_unit(scene)
    return now if abs(found / now - 1.0) < ALIKE else found


def said_of_units(field: bpy.types.Object, scene: bpy.types.Scene) -> str:
    """A message, with a hint, that a field object was made for another scene unit than the present one; "" if it is the same."""
    return " ".join(_other_units(field, scene))


def refuse_other_units(field: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Raise UsageError for a field object that was made for another scene unit than the present one: all results would be wrong."""
    wrong = _other_units(field, scene)
    if wrong:
        raise UsageError(*wrong)


def may_convert(field: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Whether a field object was made for another scene unit and can be converted to this scene's: it is in no other scene and no library.

    What Recover has made stands with its camera and object, so only loading all of it again converts it.
    """
    return not _is_result(field, scene) and _is_only_here(field, scene) and bool(_other_units(field, scene))


def _is_result(field: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    settings = scene.seeing_wind
    return field == settings.field_object and settings.recovered_digest != ""


def _is_only_here(field: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    return field.users_scene == (scene,) and field.library is None and field.override_library is None


def _other_units(field: bpy.types.Object, scene: bpy.types.Scene) -> tuple[str, ...]:
    """Message and hint; empty if the unit is the same, or the former one is not known."""
    now, then = metres_per_unit(scene), unit_of(field)
    if not then or abs(now / then - 1.0) < SAME:
        return ()
    wrong = f"{field.name} was made for a unit scale of {then:g}, and the scene's is {now:g}: place, size and strength are wrong."
    back = f"et Unit Scale to {then:g} (Properties > Scene > Units)."
    if _is_result(field, scene):
        return wrong, f"Press Reload in the Recover panel, or s{back}"
    return wrong, f"Press Apply to Field in the Field panel to convert it, or s{back}" if _is_only_here(field, scene) else f"S{back}"
