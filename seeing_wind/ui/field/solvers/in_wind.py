"""Blender's solvers in a wind: bodies are pushed by the air's velocity relative to their own, w = u - v, over their own area.

Blender's texture force field with S = u pushes a face by 0.02 W A (u . n) n, a particle or rigid body by W u, and a point of a hair by
0.01 W u. It does not depend on v; a companion of the field object adds that term, a wind of strength zero: its *Flow* F pushes a face by
-0.02 W' F A (v . n) n, a particle or rigid body by -W' F v, and a point of a hair by -0.01 W' F v, with v per frame for cloth and hair.
W and W' are the weights of texture and of wind fields (measured in Blender 4.5 and 5.2).

The drag of air is quadratic, half rho C |w| (w . n) n; Blender's is linear, so the factor |w| is fixed at one speed, the best fit for a
body at rest in this wind (`field_object.linear_drag`). There is no force along a face, where the friction of air is small.
"""

from __future__ import annotations

import math

import bpy

from ....engine.conventions import in_figures
from ....engine.errors import UsageError
from ..display import BLOWS, DRAG, LINEAR, SLOWS, home_of, is_field, is_wind, share
from .matter import WEIGHT_LIMIT, Matter

FLOW = 10.0
"""*Flow* of the companion: the largest value that Blender allows, so that the weights of wind fields stay small."""
SPHERE = 2.0 / 3.0
"""Ratio of the drag of a sphere to that of its disk, by the same law: pressure on the windward half."""
COARSE = 0.5
"""Share of the relative velocity lost in one substep above which Blender's explicit drag is too coarse."""


def held_speed(field: bpy.types.Object) -> float:
    """The speed [m/s] at which Blender's drag is right for the field's present strength.

    Raises:
        UsageError: when the field has no wind, or a strength of zero.
    """
    speed = abs(share(field)) * field[LINEAR][0]
    if not speed > 0.0:
        raise UsageError(f"No wind blows in {field.name}.", "Raise its strength, or let solvers feel the force.")
    return speed


def rate_of_cloth(field: bpy.types.Object, areal_density: float) -> float:
    """Rate [1/s] at which a plate across the wind loses its velocity relative to the air; `areal_density` in kg/m²."""
    return field[DRAG] * held_speed(field) / areal_density


def rate_of_spheres(field: bpy.types.Object, density: float, radius: float) -> float:
    """The same rate [1/s] for spheres of a density [kg/m³] and radius [m]."""
    return field[DRAG] * held_speed(field) * SPHERE * math.pi * radius**2 / (density * 4.0 / 3.0 * math.pi * radius**3)


def drag_of_surface(field: bpy.types.Object, surface: float) -> float:
    """Drag of a body divided by its velocity relative to the air [kg/s], averaged over all orientations.

    Args:
        surface: total area [m²], both sides of flat parts. A piece of area A whose normal is at an angle a to the wind contributes
            A cos²(a), A / 3 in the mean, and half of the pieces are in the lee: A / 6. For a ball this is exactly `SPHERE`.
    """
    return field[DRAG] * held_speed(field) * surface / 6.0


def rate_of_strands(field: bpy.types.Object, density: float, diameter: float) -> float:
    """Rate [1/s] at which a round strand loses its velocity across itself; density in kg/m³, diameter in m.

    Integrated over the windward half of a cylinder of diameter d, cos² of the angle to the wind gives pi d / 4 per metre.
    """
    return field[DRAG] * held_speed(field) / (density * diameter)


def weigh_wind(what: Matter, weights: bpy.types.EffectorWeights, push: float, slowing: float, mend: str) -> str:
    """Set the weights of the field (`push`) and of the companion (`slowing`). Returns a message on side effects, or "".

    Raises:
        UsageError: when Blender does not allow these weights.
    """
    times = max(1.0, push / WEIGHT_LIMIT, slowing / WEIGHT_LIMIT)
    what.weigh(weights, push / times, mend)
    weights.all, weights.wind = times, slowing / times
    still_air(bpy.context.scene, what.field)
    if times == 1.0:
        return ""
    return f"Its weight All multiplies the others, as one ends at {WEIGHT_LIMIT:g}: other force fields push {in_figures(times)} times. "


def still_air(scene: bpy.types.Scene, field: bpy.types.Object) -> bpy.types.Object:
    """The companion of a field object that slows what moves in its wind; made and linked to the scene if there is none.

    Several winds share one companion: it acts everywhere, and two would slow twice.
    """
    airs = [obj for obj in scene.objects if SLOWS in obj]
    of_winds = (air for air in airs if _blows_in(scene, air[SLOWS]))
    found = next((air for air in airs if air[SLOWS] == field), None) or next(of_winds, None)
    if found is not None:
        return found
    obj = bpy.data.objects.new(f"{field.name} Still Air", None)
    obj[SLOWS] = field
    home_of(field, scene).objects.link(obj)
    with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0], object=obj, active_object=obj):
        bpy.ops.object.forcefield_toggle()
    air = obj.field
    air.type, air.shape, air.strength, air.falloff_power, air.wind_factor, air.noise = "WIND", "POINT", 0.0, 0.0, 1.0, 0.0
    air.use_absorption, air.apply_to_rotation = False, False
    obj.parent, obj.empty_display_size, obj.hide_select = field, 0.01, True
    # active only if solvers feel the wind, not the force
    driver = obj.driver_add("field.flow").driver
    variable = driver.variables.new()
    variable.name, variable.targets[0].id, variable.targets[0].data_path = "blows", field, f'["{BLOWS}"]'
    driver.expression = f"{FLOW:g}*blows"
    return obj


def one_still_air(scene: bpy.types.Scene) -> None:
    """Keep a single companion in the scene: one of a wind, if there is any, and never that of a deleted field."""
    airs = [obj for obj in scene.objects if SLOWS in obj and obj.library is None]
    winds = [obj for obj in scene.objects if _blows_in(scene, obj)]
    there = [air for air in airs if air[SLOWS] is not None and scene in air[SLOWS].users_scene]
    kept = next((air for air in there if air[SLOWS] in winds or not winds), None)
    for air in airs:
        if air != kept:
            bpy.data.objects.remove(air)
    if airs and kept is None and winds:
        still_air(scene, winds[0])


def _blows_in(scene: bpy.types.Scene, obj: bpy.types.Object | None) -> bool:
    return is_field(obj) and is_wind(obj) and scene in obj.users_scene


def said_of_drag(field: bpy.types.Object, rate: float, substeps_per_second: float) -> str:
    """A message on the error of Blender's drag relative to the recovery's drag law, and on what to do if its steps are too coarse."""
    speed, off = held_speed(field), 100.0 * field[LINEAR][1]
    said = (
        f"Blender's drag is linear: right at {in_figures(speed, 2)} m/s relative to the air, {off:.0f} % off on what stands still in this "
        f"wind, twice as strong as it should be at {in_figures(0.5 * speed, 2)} m/s"
    )
    if rate > COARSE * substeps_per_second:
        said += f". Its steps are too coarse for so light a body: take {math.ceil(rate / (COARSE * substeps_per_second))} times as many"
    return said
