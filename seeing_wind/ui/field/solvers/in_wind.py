"""Blender's solvers in a wind: bodies are pushed by the air's velocity relative to their own, w = u - v, over their own area.

Blender's texture force field with S = u pushes a face by 0.02 W A (u . n) n, a particle or rigid body by W u, and a point of a hair by
0.01 W u. It knows nothing of v; that is what a companion of the field object does, a wind of no strength: its *Flow* F pushes a face by
-0.02 W' F A (v . n) n, a particle or rigid body by -W' F v, and a point of a hair by -0.01 W' F v, with v of cloth and hair per frame.
W and W' are the weights of texture and of wind fields (measured in Blender 4.5 and 5.2).

The drag of air is quadratic, half rho C |w| (w . n) n; Blender's is linear, so the factor |w| is held at one speed: that at which a body at
rest in this wind feels the same in the mean (`field_object.linear_drag`). Nothing pushes along a face, where air rubs only lightly.
"""

from __future__ import annotations

import math

import bpy

from ....engine.conventions import in_figures
from ....engine.errors import UsageError
from ..display import BLOWS, DRAG, LINEAR, SLOWS, home_of, is_field, is_wind, share
from .matter import WEIGHT_LIMIT, Matter

FLOW = 10.0
"""Of the companion: as much as Blender takes, so that weights of wind fields stay small."""
SPHERE = 2.0 / 3.0
"""Drag of a sphere over that of its disk, by the same law: pressure on its windward half."""
COARSE = 0.5
"""Of the relative velocity lost in one substep. Above this Blender's explicit drag overshoots."""


def held_speed(field: bpy.types.Object) -> float:
    """The speed [m/s] at which Blender's drag is right, as the field's strength is set.

    Raises:
        UsageError: when no wind blows in it.
    """
    speed = abs(share(field)) * field[LINEAR][0]
    if not speed > 0.0:
        raise UsageError(f"No wind blows in {field.name}.", "Raise its strength, or let solvers feel the force.")
    return speed


def rate_of_cloth(field: bpy.types.Object, areal_density: float) -> float:
    """Share of its velocity relative to the air that a plate across it loses per second [1/s]; `areal_density` in kg/m²."""
    return field[DRAG] * held_speed(field) / areal_density


def rate_of_spheres(field: bpy.types.Object, density: float, radius: float) -> float:
    """The same for spheres of a density [kg/m³] and radius [m]."""
    return field[DRAG] * held_speed(field) * SPHERE * math.pi * radius**2 / (density * 4.0 / 3.0 * math.pi * radius**3)


def drag_of_surface(field: bpy.types.Object, surface: float) -> float:
    """The drag of a body that is turned every way over its velocity relative to the air, in the mean [kg/s].

    Args:
        surface: all of it [m²], both sides of what is flat. A piece of area A at an angle a to the wind resists by A cos²(a), a third of A
            in the mean, and one of two is in the lee: a sixth. For a ball it is exactly `SPHERE`.
    """
    return field[DRAG] * held_speed(field) * surface / 6.0


def rate_of_strands(field: bpy.types.Object, density: float, diameter: float) -> float:
    """Share of its velocity across itself that a round strand loses per second [1/s]; density in kg/m³, diameter in m.

    Over the windward half of a cylinder of diameter d, cos² of the angle to the wind comes to pi d / 4 for each metre.
    """
    return field[DRAG] * held_speed(field) / (density * diameter)


def weigh_wind(what: Matter, weights: bpy.types.EffectorWeights, push: float, slowing: float, mend: str) -> str:
    """Set the weights of the field (`push`) and of the companion that slows (`slowing`); returns what else that changes, or "".

    Raises:
        UsageError: when Blender takes no such weights.
    """
    times = max(1.0, push / WEIGHT_LIMIT, slowing / WEIGHT_LIMIT)
    what.weigh(weights, push / times, mend)
    weights.all, weights.wind = times, slowing / times
    still_air(bpy.context.scene, what.field)
    if times == 1.0:
        return ""
    return f"Its weight All multiplies the others, as one ends at {WEIGHT_LIMIT:g}: other force fields push {in_figures(times)} times. "


def still_air(scene: bpy.types.Scene, field: bpy.types.Object) -> bpy.types.Object:
    """The companion of a field object that slows what moves in its wind, made and linked to the scene where there is none.

    Of several winds one has it: it acts everywhere, and two would slow twice.
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
    # only where solvers feel the wind, and not the force
    driver = obj.driver_add("field.flow").driver
    variable = driver.variables.new()
    variable.name, variable.targets[0].id, variable.targets[0].data_path = "blows", field, f'["{BLOWS}"]'
    driver.expression = f"{FLOW:g}*blows"
    return obj


def one_still_air(scene: bpy.types.Scene) -> None:
    """Leave one companion that slows: of a wind where the scene has any, and of no field that has been deleted."""
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
    """How far Blender's drag is off the law of the recovery, and what to do where its steps are too coarse."""
    speed, off = held_speed(field), 100.0 * field[LINEAR][1]
    said = (
        f"Blender's drag is linear: right at {in_figures(speed, 2)} m/s relative to the air, {off:.0f} % off on what stands still in this "
        f"wind, twice as strong as it should be at {in_figures(0.5 * speed, 2)} m/s"
    )
    if rate > COARSE * substeps_per_second:
        said += f". Its steps are too coarse for so light a body: take {math.ceil(rate / (COARSE * substeps_per_second))} times as many"
    return said
