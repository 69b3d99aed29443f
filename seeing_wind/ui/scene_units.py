"""Metres and scene units."""

from __future__ import annotations

import bpy


def metres_per_unit(scene: bpy.types.Scene) -> float:
    """How many metres one unit of the scene's coordinates is; 1 where the scene has no unit system."""
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else float(settings.scale_length)
