"""Letting Blender's own solvers feel a field object as the engine's bodies do: matter of density rho accelerates by f / rho.

Blender has no force per volume, and every solver counts a field's strength S in its own way. Measured in Blender 4.5 and 5.2, with the
effector weight W, fps frames per second of the scene, m the solver's mass:

    particles     W S / m per second², a frame being the particle system's time step
    hair          0.01 W S / (fps m) per frame²
    cloth         0.02 W S A / (fps M) per frame², A the whole area and M the mass of all vertices
    rigid body    W S / (fps m) per second², at the origin, no torque; W belongs to the world, not to the body
    soft body     -0.01 W S / (fps m) per frame²: against the wind, and a negative weight counts as none. It cannot be set right

So W follows from wanting f / rho per second², one scene frame being one picture of the clip. A field that carries a wind pushes otherwise,
and only cloth and particles, see `in_wind`. What a solver cannot do comes back as notes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ....engine.errors import UsageError
from ...scene_units import metres_per_unit
from ..display import frames_per_second, is_wind, stride_of
from .in_wind import let_flow, rate_of_cloth, rate_of_spheres, said_of_drag
from .physics_nodes import feed, takes_effectors

WEIGHT_LIMIT = 200.0
"""Largest effector weight that Blender takes."""
HAIR_FACTOR, CLOTH_FACTOR = 0.01, 0.02
"""Blender's own constants in what it makes of a force."""
FRAME_GRAVITY = 1.0e-3
"""Hair and cloth fall by this times the scene's gravity per frame², whatever the frame rate."""
STIFF = 4.0
"""Above this stiffness over mass per substep² Blender's cloth solver stops early and loses percents of the force (measured: 7 % at 12)."""
SHIRTING = 0.12
"""Areal density of cotton [kg/m²]."""
BODY = "seeing_wind_volume"
"""Custom property of a rigid body world: the volume [m³] for which its weight was set."""


@dataclass(frozen=True)
class Matter:
    """What a field object is to feel like."""

    field: bpy.types.Object
    density: float
    """kg/m³."""
    clip_fps: float
    """Scene frames in a second of the clip."""
    scene_fps: float
    alone: bool
    """Feel no effector but those of the field object's collection."""
    areal_density: float
    """Of cloth in a wind [kg/m²]."""

    def weigh(self, weights: bpy.types.EffectorWeights, weight: float, mend: str) -> None:
        """Set the weight of WIND effectors.

        Raises:
            UsageError: when Blender takes no such weight.
        """
        if not 0.0 < weight <= WEIGHT_LIMIT:
            raise UsageError(f"The wind's weight would have to be {weight:g}, Blender takes up to {WEIGHT_LIMIT:g}.", mend)
        weights.all, weights.wind = 1.0, weight
        if self.alone:
            weights.collection = self.field.users_collection[0]

    def fall(self, weights: bpy.types.EffectorWeights, speed: float = 1.0) -> None:
        """Make a solver that counts gravity per frame² fall as fast as the clip; gravity that is off stays off."""
        if weights.gravity:
            weights.gravity = min(1.0 / (FRAME_GRAVITY * (self.clip_fps * speed) ** 2), WEIGHT_LIMIT)


def matter(
    scene: bpy.types.Scene, field: bpy.types.Object | None, density: float | None = None, alone: bool = False,
    areal_density: float = SHIRTING,
) -> Matter:  # fmt: skip
    """Gather what a calibration needs.

    Args:
        density: [kg/m³]; None takes that of the recovered material.
        areal_density: [kg/m²].

    Raises:
        UsageError: when `field` is no field object or the density is not above zero.
    """
    if field is None or "seeing_wind_density" not in field:
        name = field.name if field is not None else "This"
        raise UsageError(f"{name} is no recovered force field.", "Choose the object that Recover made.")
    density = field["seeing_wind_density"] if density is None else density
    if not density > 0.0:
        raise UsageError(f"The density {density:g} must be above zero.", "Give kg/m³, or 0 in the panel for the recovered material.")
    if not areal_density > 0.0:
        raise UsageError(f"The areal density {areal_density:g} must be above zero.", "Cotton has 0.12 kg/m².")
    return Matter(field, density, field["seeing_wind_fps"] * stride_of(field), frames_per_second(scene), alone, areal_density)


def calibrate_object(
    scene: bpy.types.Scene,
    obj: bpy.types.Object,
    field: bpy.types.Object | None,
    *,
    density: float | None = None,
    alone: bool = False,
    set_mass: bool = False,
    areal_density: float = SHIRTING,
) -> list[str]:
    """Set all of an object's solvers so that it accelerates by f / density in the field [m/s²], or as the air's drag makes it in a wind.

    Args:
        obj: with a particle system, hair, cloth, rigid body, or (Blender 5.2) physics nodes.
        field: made by `create_field_object`.
        density: [kg/m³]; None takes that of the recovered material.
        alone: feel no effector but those in the field object's collection.
        set_mass: change a rigid body's mass where the one weight of its world was set for another body.
        areal_density: of cloth in a wind [kg/m²].

    Returns:
        A line for every solver found, saying what was set and what that solver cannot do.

    Raises:
        UsageError: when the object has no solver, or Blender takes no such weight.
    """
    what = matter(scene, field, density, alone, areal_density)
    said = [line for solver in SOLVERS for line in solver(scene, obj, what, set_mass)]
    if not said:
        raise UsageError(f"{obj.name} has no physics.", "Add a particle system, cloth, a rigid body or physics nodes first.")
    return said


def has_solver(obj: bpy.types.Object) -> bool:
    """Whether an object has something that a calibration sets."""
    if obj.library is not None:
        return False
    groups = (modifier.node_group for modifier in obj.modifiers if modifier.type == "NODES" and modifier.node_group is not None)
    return bool(
        len(obj.particle_systems) or any(modifier.type == "CLOTH" for modifier in obj.modifiers)
        or (obj.rigid_body is not None and obj.rigid_body.type == "ACTIVE") or any(takes_effectors(group) for group in groups)
    )  # fmt: skip


def calibrate_particles(
    settings: bpy.types.ParticleSettings,
    field: bpy.types.Object,
    *,
    mass: float | None = None,
    density: float | None = None,
    alone: bool = False,
) -> None:
    """Let a particle system feel a field object: every particle accelerates by f / density [m/s²].

    Args:
        settings: changed: mass, the weight of WIND effectors, the time step (one frame = one picture of the clip).
        field: made by `create_field_object`.
        mass: of a particle [kg]; None keeps the present one. It does not change the acceleration.
        density: [kg/m³]; None takes that of the recovered material.
        alone: feel no effector but those in the field object's collection.

    Raises:
        UsageError: when `field` is no field object, or the volume mass / density is beyond Blender's weights.
    """
    what = matter(bpy.context.scene, field, density, alone)
    if mass is not None:
        settings.mass = mass
    per_mass = 1.0 / what.density if not is_wind(field) else rate_of_spheres(field, what.density, _radius(settings))
    what.weigh(settings.effector_weights, settings.mass * per_mass, "Give the particles a smaller mass.")
    settings.physics_type = "NEWTON"
    settings.use_multiply_size_mass = False
    settings.timestep = 1.0 / what.clip_fps
    settings.drag_factor = settings.damping = 0.0


def _particles(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    for system in obj.particle_systems:
        if system.settings.type == "HAIR":
            yield _only_force(f"Hair {system.name}") if is_wind(what.field) else _hair(system, what)
            continue
        calibrate_particles(system.settings, what.field, density=what.density, alone=what.alone)
        if is_wind(what.field):
            yield _in_wind(system, what)
        else:
            yield f"Particles {system.name}: matter of {what.density:g} kg/m³, drag off (it is in the field already)"


def _in_wind(system: bpy.types.ParticleSystem, what: Matter) -> str:
    radius = _radius(system.settings)
    let_flow(what.field, 1.0, 1.0)
    said = said_of_drag(what.field, rate_of_spheres(what.field, what.density, radius), what.clip_fps * (1 + system.settings.subframes))
    return f"Particles {system.name}: balls of {2000.0 * radius:.3g} mm and {what.density:g} kg/m³ in the wind. {said}"


def _radius(settings: bpy.types.ParticleSettings) -> float:
    """Of a particle as it is drawn [m]."""
    return settings.particle_size * metres_per_unit(bpy.context.scene)


def _hair(system: bpy.types.ParticleSystem, what: Matter) -> str:
    if not system.use_hair_dynamics or system.cloth is None:
        return f"Hair {system.name}: does not move until Hair Dynamics is on; switch it on and calibrate again"
    settings, weights = system.cloth.settings, system.settings.effector_weights  # the cloth's own weights count for nothing here
    weight = settings.mass * what.scene_fps / (HAIR_FACTOR * what.density * what.clip_fps**2 * settings.time_scale**2)
    what.weigh(weights, weight, "Give the hair a smaller mass, or name a higher density.")
    what.fall(weights, settings.time_scale)
    settings.air_damping = 0.0
    return f"Hair {system.name}: strands of {what.density:g} kg/m³; the roots are held"


def _cloth(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    modifier = next((modifier for modifier in obj.modifiers if modifier.type == "CLOTH"), None)
    if modifier is None:
        return
    settings = modifier.settings
    area, vertices = _area_before(obj, modifier)
    if is_wind(what.field):
        yield _cloth_in_wind(obj, settings, area, vertices, what)
        return
    mass = settings.mass * vertices
    weight = mass * what.scene_fps / (CLOTH_FACTOR * area * what.density * what.clip_fps**2 * settings.time_scale**2)
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
    """A sheet of the areal density, whatever its vertices weigh in Blender: only what pushes over what is pushed counts."""
    if settings.time_scale != 1.0:
        raise UsageError(f"The cloth {obj.name} runs at a speed of {settings.time_scale:g}.", "Set its Speed Multiplier to 1.")
    rate = rate_of_cloth(what.field, what.areal_density)
    weight = rate * settings.mass * vertices * what.scene_fps / (CLOTH_FACTOR * area * what.clip_fps**2)
    said = f"Cloth: {what.areal_density:g} kg/m² in the wind. "
    what.weigh(settings.effector_weights, min(weight, WEIGHT_LIMIT), "Give the cloth a smaller vertex mass.")
    if weight > WEIGHT_LIMIT:
        # a smaller vertex mass would make the cloth so stiff for it that Blender's solver stops early and loses half of the push
        settings.effector_weights.all = weight / WEIGHT_LIMIT
        times = f"{settings.effector_weights.all:.3g} times"
        said += f"Its weights All and Wind multiply, as one ends at {WEIGHT_LIMIT:g}: other force fields push {times}. "
    what.fall(settings.effector_weights)
    let_flow(what.field, what.clip_fps, what.scene_fps)
    settings.air_damping = 0.0
    return said + said_of_drag(what.field, rate, what.clip_fps * settings.quality) + _said_of_stiffness(settings)


def _only_force(solver: str) -> str:
    return f"{solver}: not set. Of a wind Blender lets only cloth and particles feel the speed: let solvers feel the Force, then Fit Field"


def _area_before(obj: bpy.types.Object, cloth: bpy.types.Modifier) -> tuple[float, int]:
    """Area [scene units²] and vertices of the mesh that a cloth modifier gets, in the world.

    Raises:
        UsageError: when it has no faces.
    """
    behind = list(obj.modifiers)[obj.modifiers.find(cloth.name) :]
    shown = [modifier.show_viewport for modifier in behind]
    for modifier in behind:
        modifier.show_viewport = False
    try:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        evaluated = obj.evaluated_get(depsgraph)
        mesh = evaluated.to_mesh()
        mesh.calc_loop_triangles()
        places = np.empty((len(mesh.vertices), 3), dtype=np.float32)
        corners = np.empty((len(mesh.loop_triangles), 3), dtype=np.int32)
        mesh.vertices.foreach_get("co", places.reshape(-1))
        mesh.loop_triangles.foreach_get("vertices", corners.reshape(-1))
        matrix = np.array(evaluated.matrix_world)[:3, :3]
        evaluated.to_mesh_clear()
    finally:
        for modifier, was in zip(behind, shown, strict=True):
            modifier.show_viewport = was
    a, b, c = (places[corners[:, k]] @ matrix.T for k in range(3))
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    if not area > 0.0:
        raise UsageError(f"The cloth {obj.name} has no faces.", "Wind pushes faces: use a mesh with some.")
    return area, len(places)


def _rigid_body(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    body, world = obj.rigid_body, scene.rigidbody_world
    if body is None or world is None:
        return
    if body.type != "ACTIVE" or body.kinematic:
        yield "Rigid body: it is passive or animated, so no wind moves it"
        return
    if is_wind(what.field):
        yield _only_force("Rigid body")
        return
    # W of one cubic metre: what remains is the body's volume
    per_volume = what.scene_fps**3 / (what.clip_fps**2 * world.time_scale**2)
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


def _soft_body(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    if any(modifier.type == "SOFT_BODY" for modifier in obj.modifiers):
        yield "Soft body: not set. Blender's soft bodies run against a wind and take no negative weight; use Cloth, or insert the mesh here"


def _physics_nodes(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:

    yield from feed(scene, obj, what.field, what.density)


Solver = Callable[[bpy.types.Scene, bpy.types.Object, Matter, bool], Iterator[str]]

SOLVERS: tuple[Solver, ...] = (_particles, _cloth, _rigid_body, _soft_body, _physics_nodes)
