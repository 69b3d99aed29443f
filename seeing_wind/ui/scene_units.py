"""Metres and scene units."""

from __future__ import annotations

import bpy

from ..engine.errors import UsageError

METRES = "seeing_wind_metres"
"""Custom property of a field object: how many metres a unit of the scene was when its values were put into scene units."""
SAME = 1e-6
"""Relative difference of two scales that are the same in single precision."""


def metres_per_unit(scene: bpy.types.Scene) -> float:
    """How many metres one unit of the scene's coordinates is; 1 where the scene has no unit system."""
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else float(settings.scale_length)


def said_of_units(field: bpy.types.Object, scene: bpy.types.Scene) -> str:
    """That the scene's unit is another than that for which a field object was made, and what to do; "" where it is the same."""
    return " ".join(_other_units(field, scene))


def refuse_other_units(field: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """UsageError for a field object that was made for another unit than the scene has now: all that is made with it would be nonsense."""
    wrong = _other_units(field, scene)
    if wrong:
        raise UsageError(*wrong)


def _other_units(field: bpy.types.Object, scene: bpy.types.Scene) -> tuple[str, ...]:
    """Message and hint; none where the unit is the same, or nobody knows which it was."""
    now, then = metres_per_unit(scene), field.get(METRES, 0.0)
    if not then or abs(now / then - 1.0) < SAME:
        return ()
    wrong = f"{field.name} was made for a unit scale of {then:g}, and the scene's is {now:g}: place, size and strength are wrong."
    back, settings = f"et Unit Scale to {then:g} (Properties > Scene > Units).", scene.seeing_wind
    results = field == settings.field_object and settings.recovered_digest != ""  # those of a take, which can be loaded again
    return wrong, f"Press Reload in the Recover panel, or s{back}" if results else f"S{back}"
