"""Blender's rigid bodies in a field object."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..display import is_wind
from .matter import Matter, only_force

BODY = "seeing_wind_volume"
"""Custom property of a rigid body world: the volume [m³] for which its weight was set."""


def rigid_body(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    """The rigid body of an object, and a line that says what was set."""
    body, world = obj.rigid_body, scene.rigidbody_world
    if body is None or world is None:
        return
    if body.type != "ACTIVE" or body.kinematic:
        yield "Rigid body: it is passive or animated, so no wind moves it"
        return
    if is_wind(what.field):
        yield only_force("Rigid body")
        return
    # W of one cubic metre: what remains is the body's volume
    per_volume = what.scene_fps**2 / (what.clip_fps**2 * world.time_scale**2)
    if set_mass and BODY in scene:
        body.mass = scene[BODY] * what.density
    volume = body.mass / what.density
    what.weigh(world.effector_weights, volume * per_volume, "Give the body a smaller mass.")
    scene[BODY] = volume
    body.linear_damping = 0.0
    line = f"Rigid body: {body.mass:g} kg at {what.density:g} kg/m³; the wind acts at its origin and does not turn it"
    others = [
        other.name
        for other in (world.collection.objects if world.collection else ())
        if other != obj and other.rigid_body is not None and other.rigid_body.type == "ACTIVE"
    ]
    if others:
        line += f". Blender has one weight for all rigid bodies: {', '.join(others[:3])} move as matter of their mass over {volume:g} m³"
    yield line
