"""Blender's cloth in a field object."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np

from ....engine.conventions import in_units
from ....engine.errors import UsageError
from ..display import is_wind
from .in_wind import FLOW, rate_of_cloth, said_of_drag, weigh_wind
from .matter import Matter
from .surface import area_of, faces_of

CLOTH_FACTOR = 0.02
"""Blender's constant factor on forces on cloth."""
STIFF = 4.0
"""Stiffness / (mass x substeps²) above which Blender's cloth solver stops early and loses part of the force (measured: 7 % at 12)."""


def cloth(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    """Calibrate the cloth of an object; yields a line that says what was set."""
    modifier = next((modifier for modifier in obj.modifiers if modifier.type == "CLOTH"), None)
    if modifier is None:
        return
    settings = modifier.settings
    area, vertices = _area_before(obj, modifier)
    if is_wind(what.field):
        yield _cloth_in_wind(obj, settings, area, vertices, what)
        return
    mass = settings.mass * vertices
    weight = mass / (CLOTH_FACTOR * area * what.density * what.clip_fps**2 * settings.time_scale**2)
    what.weigh(settings.effector_weights, weight, "Give the cloth a smaller vertex mass, or name a higher density.")
    what.fall(settings.effector_weights, settings.time_scale)
    settings.air_damping = 0.0
    line = (
        f"Cloth: right for the whole sheet of {vertices} vertices; calibrate again when its mesh or mass changes. Blender pushes faces but "
        "weighs vertices, so vertices at the rim feel half, those inside a little more than their share"
    )
    yield line + _said_of_stiffness(settings)


def _said_of_stiffness(settings: bpy.types.ClothSettings) -> str:
    if settings.tension_stiffness <= STIFF * settings.mass * settings.quality**2:
        return ""
    enough = int(np.ceil(np.sqrt(settings.tension_stiffness / (STIFF * settings.mass))))
    return f". It is so stiff for its mass that the solver stops early: raise Quality Steps to {enough}"


def _cloth_in_wind(obj: bpy.types.Object, settings: bpy.types.ClothSettings, area: float, vertices: int, what: Matter) -> str:
    """Calibrate a sheet of the given areal density, whatever its vertices weigh in Blender: only the ratio of push to mass matters."""
    if settings.time_scale != 1.0:
        raise UsageError(f"The cloth {obj.name} runs at a speed of {settings.time_scale:g}.", "Set its Speed Multiplier to 1.")
    rate = rate_of_cloth(what.field, what.areal_density)
    weight = rate * settings.mass * vertices / (CLOTH_FACTOR * area * what.clip_fps**2)
    # A cloth's velocity is per frame. A smaller vertex mass would make the cloth too stiff for its mass, so that Blender's solver stops
    # early and loses half of the push: so the weight is allowed to become large.
    said = f"Cloth: {in_units(what.areal_density, 'kg/m²')} in the wind. "
    said += weigh_wind(what, settings.effector_weights, weight, weight * what.clip_fps / FLOW, "Give the cloth a smaller vertex mass.")
    what.fall(settings.effector_weights)
    settings.air_damping = 0.0
    return said + said_of_drag(what.field, rate, what.clip_fps * settings.quality) + _said_of_stiffness(settings)


def _area_before(obj: bpy.types.Object, cloth: bpy.types.Modifier) -> tuple[float, int]:
    """World-space area [scene units²] and number of vertices of the mesh that is the input of a cloth modifier.

    Raises:
        UsageError: when the mesh has no faces.
    """
    behind = list(obj.modifiers)[obj.modifiers.find(cloth.name) :]
    shown = [modifier.show_viewport for modifier in behind]
    for modifier in behind:
        modifier.show_viewport = False
    try:
        places, corners = faces_of(obj)
    finally:
        for modifier, was in zip(behind, shown, strict=True):
            modifier.show_viewport = was
    area = area_of(places, corners)
    if not area > 0.0:
        raise UsageError(f"The cloth {obj.name} has no faces.", "Wind pushes faces: use a mesh with some.")
    return area, len(places)
