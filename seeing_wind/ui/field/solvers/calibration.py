"""Making Blender's own solvers feel a field object as the engine's bodies do: matter of density rho accelerates by f / rho.

Blender has no force per volume, and every solver applies a texture field's force S in its own way. Accelerations measured in Blender 4.5
and 5.2, with the effector weight W and the solver's mass m:

    particles     W S / m per second², where a frame lasts the particle system's time step
    hair          0.01 W S / m per frame²
    cloth         0.02 W S A / M per frame², with the total area A and the mass M of all vertices
    rigid body    W S / m per second², at the origin, no torque; W belongs to the world, not to the body

W is chosen so that the acceleration is f / rho per second², with one scene frame per clip frame. A field that carries a wind pushes in
another way, see `in_wind`. What a solver cannot do is returned as notes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import bpy

from ....engine.errors import UsageError
from ...scene_units import said_of_units
from ..display import said_of_mirror
from .apart import choose_effectors, said_of_others
from .cloth import cloth
from .matter import SHIRTING, Matter, matter
from .particles import particles
from .physics_nodes import feed, takes_effectors
from .rigid_body import rigid_body


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
    """Set all of an object's solvers so that it accelerates by f / density [m/s²] in a field, or by the air's drag in a wind.

    Args:
        obj: with a particle system, hair, cloth, rigid body, or (Blender 5.2) physics nodes.
        field: made by `create_field_object`.
        density: [kg/m³]; None takes that of the recovered material.
        alone: feel only the effectors in the field object's collection, or only the field if that collection contains other fields.
        set_mass: change a rigid body's mass if the common weight of its world was set for another body.
        areal_density: of cloth in a wind [kg/m²].

    Returns:
        A line for every solver found, saying what was set and what that solver cannot do.

    Raises:
        UsageError: when the object has no solver, or Blender does not allow the weight.
    """
    what = matter(scene, field, density, areal_density)
    said = [line for solver in SOLVERS for line in solver(scene, obj, what, set_mass)]
    if not said:
        raise UsageError(f"{obj.name} has no physics.", "Add a particle system, cloth, a rigid body or physics nodes first.")
    choose_effectors(scene, obj, what.field, alone)
    wrong = filter(None, [said_of_units(what.field, scene), said_of_mirror(what.field)])
    return [*said, *said_of_others(scene, obj, what.field, alone), *wrong]


def has_solver(obj: bpy.types.Object) -> bool:
    """Whether an object has something that a calibration sets."""
    if obj.library is not None:
        return False
    groups = (modifier.node_group for modifier in obj.modifiers if modifier.type == "NODES" and modifier.node_group is not None)
    return bool(
        len(obj.particle_systems) or any(modifier.type == "CLOTH" for modifier in obj.modifiers)
        or (obj.rigid_body is not None and obj.rigid_body.type == "ACTIVE") or any(takes_effectors(group) for group in groups)
    )  # fmt: skip


def _soft_body(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    if any(modifier.type == "SOFT_BODY" for modifier in obj.modifiers):
        yield "Soft body: not set. Blender's soft bodies run against a wind and take no negative weight; use Cloth, or insert the mesh here"


def _physics_nodes(scene: bpy.types.Scene, obj: bpy.types.Object, what: Matter, set_mass: bool) -> Iterator[str]:
    yield from feed(scene, obj, what.field, what.density)


Solver = Callable[[bpy.types.Scene, bpy.types.Object, Matter, bool], Iterator[str]]

SOLVERS: tuple[Solver, ...] = (particles, cloth, rigid_body, _soft_body, _physics_nodes)
