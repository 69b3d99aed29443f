"""Keeping forces and winds apart: one weight of texture force fields cannot suit both, so each moving object feels only one kind.

A force per volume is thousands of N/m³ and a wind a few m/s, so with the weight for a wind a force would throw a body away. And the still
air of a wind would slow what moves in a force, which includes the air's drag already. If a scene has both kinds, each calibrated solver
therefore gets a collection of effectors without the other kind. Blender's own force fields stay in it.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..display import FELT, SLOWS, home_of, is_field, is_wind
from .in_wind import one_still_air

ONLY = "only"
"""Value of `FELT`, in place of a kind, for a collection of one field alone."""


def keep_apart(scene: bpy.types.Scene) -> None:
    """Make every calibrated object feel only the kind of field it was calibrated for, given the scene's present fields."""
    one_still_air(scene)
    for entry in scene.seeing_wind.calibrations:  # in order: the common weight of rigid bodies is that of the last entry
        known = entry.object is not None and entry.object.library is None and entry.field is not None
        if known and scene in entry.field.users_scene:
            choose_effectors(scene, entry.object, entry.field, entry.alone)


def choose_effectors(scene: bpy.types.Scene, obj: bpy.types.Object, field: bpy.types.Object, alone: bool) -> None:
    """Make an object's solvers feel fields of one kind, or this field only (`alone`). Unless `alone`, the user's own collection stays."""
    chosen = _only(scene, field) if alone else _of_kind(scene, field)
    for weights in _weights(scene, obj):
        if alone or weights.collection is None or FELT in weights.collection:
            weights.collection = chosen


def said_of_others(scene: bpy.types.Scene, obj: bpy.types.Object, field: bpy.types.Object, alone: bool) -> Iterator[str]:
    """Messages on which fields of the scene an object does not feel, or should not feel."""
    others = [] if alone else sorted(other.name for other in other_kind(scene, field))
    collections = [weights.collection for weights in _weights(scene, obj)]
    if not others or not collections:
        return
    felt, kind = ("winds", "forces") if is_wind(field) else ("forces", "winds")
    within = [name for each in collections if each is not None and FELT not in each for name in others if name in each.all_objects]
    if within:
        yield f"The effector collection has {', '.join(dict.fromkeys(within))}, too: take {kind} out, as the weight suits {felt} only"
    elif all(each is not None and FELT in each for each in collections):
        names = ", ".join(others[:3])
        yield f"Not felt: {names}, as one weight cannot suit forces and winds; calibrate for {others[0]} to feel {kind} instead"


def _weights(scene: bpy.types.Scene, obj: bpy.types.Object) -> Iterator[bpy.types.EffectorWeights]:
    """Effector weights of all solvers of an object that a calibration sets."""
    yield from (system.settings.effector_weights for system in obj.particle_systems)
    yield from (modifier.settings.effector_weights for modifier in obj.modifiers if modifier.type == "CLOTH")
    body = obj.rigid_body
    if body is not None and body.type == "ACTIVE" and scene.rigidbody_world is not None:
        yield scene.rigidbody_world.effector_weights


def other_kind(scene: bpy.types.Scene, field: bpy.types.Object) -> list[bpy.types.Object]:
    """The winds of a scene if the field is a force, or its forces if the field is a wind."""
    return [obj for obj in scene.objects if is_field(obj) and is_wind(obj) != is_wind(field)]


def _of_kind(scene: bpy.types.Scene, field: bpy.types.Object) -> bpy.types.Collection | None:
    """A collection of all effectors of the scene except the other kind's; None if the scene has no field of the other kind."""
    others = other_kind(scene, field)
    if not others:
        return None
    felt = [obj for obj in scene.objects if _acts(obj) and obj not in others and obj.get(SLOWS) not in others]
    word = "Wind" if is_wind(field) else "Force"
    return _collection(scene, word.lower(), f"Felt as {word}", felt)


def _only(scene: bpy.types.Scene, field: bpy.types.Object) -> bpy.types.Collection:
    """A collection with no other recovered field: the field's own if it has one to itself, else one with the field alone. For a wind it
    includes the companion that slows."""
    slows = [obj for obj in scene.objects if SLOWS in obj] if is_wind(field) else []
    home = home_of(field, scene)
    if home != scene.collection and not any(is_field(obj) and obj != field for obj in home.all_objects):
        if all(obj.name in home.all_objects for obj in slows):
            return home
    found = next((each for each in scene.collection.children if each.get(FELT) == ONLY and field.name in each.objects), None)
    return _filled(found or _made(scene, ONLY, f"Only {field.name}"), [field, *slows])


def _acts(obj: bpy.types.Object) -> bool:
    """Whether an object, or its particles, act as a force field."""
    forces = (force for system in obj.particle_systems for force in (system.settings.force_field_1, system.settings.force_field_2))
    return any(each is not None and each.type != "NONE" for each in (obj.field, *forces))


def _collection(scene: bpy.types.Scene, mark: str, name: str, felt: list[bpy.types.Object]) -> bpy.types.Collection:
    found = next((each for each in scene.collection.children if each.get(FELT) == mark), None)
    return _filled(found or _made(scene, mark, name), felt)


def _made(scene: bpy.types.Scene, mark: str, name: str) -> bpy.types.Collection:
    """A new collection, linked to the scene so that users find it and deleted objects leave it; excluded so as to reveal nothing hidden."""
    made = bpy.data.collections.new(name)
    made[FELT] = mark
    scene.collection.children.link(made)
    for layer in scene.view_layers:
        layer.layer_collection.children[made.name].exclude = True
    return made


def _filled(collection: bpy.types.Collection, felt: list[bpy.types.Object]) -> bpy.types.Collection:
    for obj in [each for each in collection.objects if each not in felt]:
        collection.objects.unlink(obj)
    for obj in felt:
        if obj.name not in collection.objects:
            collection.objects.link(obj)
    return collection
