"""Blender's particles and hair in a field object."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ....engine.conventions import in_units
from ....engine.errors import UsageError
from ...scene_units import metres_per_unit
from ..display import is_wind
from .in_wind import FLOW, rate_of_spheres, rate_of_strands, said_of_drag, still_air, weigh_wind
from .matter import Matter, matter

HAIR_FACTOR = 0.01
"""Blender's constant factor on forces on hair."""


def calibrate_particles(
    settings: bpy.types.ParticleSettings,
    field: bpy.types.Object,
    *,
    mass: float | None = None,
    density: float | None = None,
) -> None:
    """Calibrate a particle system for a field object: every particle accelerates by f / density [m/s²], or by its drag in a wind.

    Args:
        settings: modified: mass, the weight of texture force fields, the time step (one frame = one clip frame), damping.
        field: made by `create_field_object`.
        mass: of a particle [kg]; None keeps the present one. It does not change the acceleration.
        density: [kg/m³]; None takes that of the recovered material.

    Raises:
        UsageError: when `field` is no field object, or the volume mass / density is beyond Blender's weights.
    """
    what = matter(bpy.context.scene, field, density)
    if mass is not None:
        settings.mass = mass
    per_mass = 1.0 / what.density if not is_wind(field) else rate_of_spheres(field, what.density, _radius(settings))
    what.weigh(settings.effector_weights, settings.mass * per_mass, "Give the particles a smaller mass.")
    settings.physics_type = "NEWTON"
    settings.use_multiply_size_mass = False
    settings.timestep = 1.0 / what.clip_fps
    settings.drag_factor = settings.damping = 0.0


def particles(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    """Calibrate the particle systems and hair of an object; yields a line for each."""
    for system in obj.particle_systems:
        if system.settings.type == "HAIR":
            yield _hair(system, what)
            continue
        calibrate_particles(system.settings, what.field, density=what.density)
        if is_wind(what.field):
            yield _in_wind(system, what)
        else:
            yield f"Particles {system.name}: matter of {what.density:g} kg/m³, drag off (it is in the field already)"


def _in_wind(system: bpy.types.ParticleSystem, what: Matter) -> str:
    radius = _radius(system.settings)
    weights = system.settings.effector_weights
    weights.wind = weights.texture / FLOW  # a particle's velocity is per second
    still_air(bpy.context.scene, what.field)
    said = said_of_drag(what.field, rate_of_spheres(what.field, what.density, radius), what.clip_fps * (1 + system.settings.subframes))
    return f"Particles {system.name}: balls of {in_units(2.0 * radius, 'm')} and {what.density:g} kg/m³ in the wind. {said}"


def _radius(settings: bpy.types.ParticleSettings) -> float:
    """Radius of a particle as drawn [m]."""
    return settings.particle_size * metres_per_unit(bpy.context.scene)


def _hair(system: bpy.types.ParticleSystem, what: Matter) -> str:
    if not system.use_hair_dynamics or system.cloth is None:
        return f"Hair {system.name}: does not move until Hair Dynamics is on; switch it on and calibrate again"
    settings, weights = system.cloth.settings, system.settings.effector_weights  # the weights of the cloth settings have no effect here
    if is_wind(what.field):
        return _hair_in_wind(system, settings, weights, what)
    weight = settings.mass / (HAIR_FACTOR * what.density * what.clip_fps**2 * settings.time_scale**2)
    what.weigh(weights, weight, "Give the hair a smaller mass, or name a higher density.")
    what.fall(weights, settings.time_scale)
    settings.air_damping = 0.0
    return f"Hair {system.name}: strands of {what.density:g} kg/m³; the roots are held"


def _hair_in_wind(
    system: bpy.types.ParticleSystem, settings: bpy.types.ClothSettings, weights: bpy.types.EffectorWeights, what: Matter
) -> str:
    """Calibrate round strands, as thick as drawn. Blender pushes equally along a strand, which then resists by its stiffness."""
    if settings.time_scale != 1.0:
        raise UsageError(f"The hair {system.name} runs at a speed of {settings.time_scale:g}.", "Set its Speed Multiplier to 1.")
    drawn = system.settings
    diameter = 0.5 * (drawn.root_radius + drawn.tip_radius) * drawn.radius_scale * metres_per_unit(bpy.context.scene)
    if not diameter > 0.0:
        raise UsageError(f"The hair {system.name} has no thickness.", "Set a diameter under Hair Shape.")
    rate = rate_of_strands(what.field, what.density, diameter)
    push = rate * settings.mass / (HAIR_FACTOR * what.clip_fps**2)
    said = f"Hair {system.name}: strands of {in_units(diameter, 'm')} and {what.density:g} kg/m³ in the wind; the roots are held. "
    # the velocity of hair is per frame
    said += weigh_wind(what, weights, push, push * what.clip_fps / FLOW, "Give the hair a smaller mass.")
    what.fall(weights)
    settings.air_damping = 0.0
    return said + said_of_drag(what.field, rate, what.clip_fps * settings.quality)
