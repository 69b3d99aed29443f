"""Conversion between metres and scene units."""

from __future__ import annotations

import bpy

from ..engine.errors import UsageError

METRES = "seeing_wind_metres"
"""Custom property of a field object: the length of a scene unit [m] when its values were converted to scene units."""
SAME = 1e-6
"""Relative difference below which two scales are the same in single precision."""


def metres_per_unit(scene: bpy.types.Scene) -> float:
    """Length of one unit of the scene's coordinates [m]; 1 if the scene has no unit system."""
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else float(settings.scale_length)


def said_of_units(field: bpy.types.Object, scene: bpy.types.Scene) -> str:
    """A message, with a hint, that a field object was made for another scene unit than the present one; "" if it is the same."""
    return " ".join(_other_units(field, scene))


def refuse_other_units(field: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Raise UsageError for a field object that was made for another scene unit than the present one: all results would be wrong."""
    wrong = _other_units(field, scene)
    if wrong:
        raise UsageError(*wrong)


def _other_units(field: bpy.types.Object, scene: bpy.types.Scene) -> tuple[str, ...]:
    """Message and hint; empty if the unit is the same, or the former one is not known."""
    now, then = metres_per_unit(scene), field.get(METRES, 0.0)
    if not then or abs(now / then - 1.0) < SAME:
        return ()
    wrong = f"{field.name} was made for a unit scale of {then:g}, and the scene's is {now:g}: place, size and strength are wrong."
    back, settings = f"et Unit Scale to {then:g} (Properties > Scene > Units).", scene.seeing_wind
    results = field == settings.field_object and settings.recovered_digest != ""  # from a take, which can be loaded again
    return wrong, f"Press Reload in the Recover panel, or s{back}" if results else f"S{back}"
