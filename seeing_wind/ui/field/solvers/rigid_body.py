"""Blender's rigid bodies in a field object."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ....engine.conventions import in_units
from ....engine.errors import UsageError
from ...scene_units import metres_per_unit
from ..display import is_wind
from .in_wind import FLOW, drag_of_surface, said_of_drag, weigh_wind
from .matter import Matter
from .surface import surface_of

BODY, SURFACE = "seeing_wind_volume", "seeing_wind_surface"
"""Custom properties of a scene: the volume [m³] (or, in a wind, the surface [m²]) for which the common weight of rigid bodies was set."""
MASSES = "seeing_wind_masses"
"""Custom property of a rigid body: its own mass, and the mass it was given so that the common weight suits it [kg]."""


def rigid_body(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    """Calibrate the rigid body of an object; yields a line that says what was set."""
    body, world = obj.rigid_body, scene.rigidbody_world
    if body is None or world is None:
        return
    if body.type != "ACTIVE" or body.kinematic:
        yield "Rigid body: it is passive or animated, so no wind moves it"
        return
    others = _others(world, obj)
    body.linear_damping = 0.0
    if is_wind(what.field):
        yield _in_wind(scene, obj, what, set_mass, others)
        return
    # W for one cubic metre; it is then multiplied by the body's volume
    per_volume = what.scene_fps**2 / (what.clip_fps**2 * world.time_scale**2)
    if set_mass and BODY in scene:
        body.mass = scene[BODY] * what.density
    volume = body.mass / what.density
    what.weigh(world.effector_weights, volume * per_volume, "Give the body a smaller mass.")
    scene[BODY] = volume
    line = f"Rigid body: {in_units(body.mass, 'kg')} at {what.density:g} kg/m³; the wind acts at its origin and does not turn it"
    if others:
        line += f". Blender has one weight for all rigid bodies: {others} move as matter of their mass over {in_units(volume, 'm³')}"
    yield line


def _in_wind(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool, others: str) -> str:
    """Calibrate a body with its own mass and surface as if it tumbled: Blender's push does not depend on the orientation."""
    body, world = obj.rigid_body, scene.rigidbody_world
    surface = surface_of(obj) * metres_per_unit(scene) ** 2
    if not surface > 0.0:
        raise UsageError(f"The rigid body {obj.name} has no faces.", "Wind pushes faces: use a mesh with some.")
    kept = obj.get(MASSES)
    mass = kept[0] if kept is not None and abs(body.mass - kept[1]) <= 1e-5 * kept[1] else body.mass
    shared = scene[SURFACE] if set_mass and SURFACE in scene else surface
    body.mass = mass * shared / surface
    obj[MASSES], scene[SURFACE] = (mass, body.mass), shared
    drag = drag_of_surface(what.field, shared)
    # factor by which the wind is faster in the rigid bodies' time than in the clip's
    faster = what.scene_fps / (what.clip_fps * world.time_scale)
    line = f"Rigid body: {in_units(mass, 'kg')} and {in_units(surface, 'm²')} of surface in the wind, as if it tumbled; "
    line += "the wind does not turn it. "
    line += weigh_wind(what, world.effector_weights, drag * faster**2, drag * faster / FLOW, "Give the bodies less surface.")
    if shared != surface:
        line += f"Its mass is {in_units(body.mass, 'kg')}, so that the one weight of all rigid bodies suits it. "
    line += said_of_drag(what.field, drag / body.mass, what.clip_fps * world.substeps_per_frame)
    if others:
        line += f". Blender has one weight for all rigid bodies: {others} are pushed as bodies of {in_units(shared, 'm²')}"
        line += "; Set Mass suits each"
    return line


def _others(world: bpy.types.RigidBodyWorld, obj: bpy.types.Object) -> str:
    """Names of up to three other bodies that move freely; "" if there are none."""
    names = [
        other.name
        for other in (world.collection.objects if world.collection else ())
        if other != obj and other.rigid_body is not None and other.rigid_body.type == "ACTIVE"
    ]
    return ", ".join(names[:3])
