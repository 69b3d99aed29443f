"""Blender's cloth and particles in a wind: they are pushed by the air's velocity relative to their own, w = u - v, over their own area.

Blender's wind pushes a face by 0.02 W A ((S / fps - F v) . n) n, and a particle by W (S - F v): W is the effector weight, S the field's
strength, A the area, n the normal, fps frames per second of the scene, v the velocity (of cloth per frame, of particles per second), F the
field's flow times its falloff (measured in Blender 4.5). With S = u and F = 1 that is w, so bodies reach the wind's speed and no more.

The drag of air is quadratic, half rho C |w| (w . n) n; Blender's is linear, so the factor |w| is held at one speed: that at which a body at
rest in this wind feels the same in the mean (`field_object.linear_drag`). Nothing pushes along a face, where air rubs only lightly.
"""

from __future__ import annotations

import math

import bpy

from ....engine.errors import UsageError
from ..display import DRAG, FLOW, LINEAR, share

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


def let_flow(field: bpy.types.Object, clip_fps: float, scene_fps: float) -> None:
    """Let a body's own velocity count as the air's does: cloth moves per frame, and a frame is a picture of the clip."""
    field.field.flow = field[FLOW][0] * clip_fps / scene_fps


def said_of_drag(field: bpy.types.Object, rate: float, substeps_per_second: float) -> str:
    """How far Blender's drag is off the law of the recovery, and what to do where its steps are too coarse."""
    speed, off = held_speed(field), 100.0 * field[LINEAR][1]
    said = (
        f"Blender's drag is linear: right at {speed:.2g} m/s relative to the air, {off:.0f} % off on what stands still in this wind, "
        f"twice too strong at {0.5 * speed:.2g} m/s; what moves with the wind is right within {100.0 * field[FLOW][1]:.0f} % of its speed"
    )
    if rate > COARSE * substeps_per_second:
        said += f". Its steps are too coarse for so light a body: take {math.ceil(rate / (COARSE * substeps_per_second))} times as many"
    return said
