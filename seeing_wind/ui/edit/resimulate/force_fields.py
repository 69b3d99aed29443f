"""Blender's own force fields that act in addition to the recovered one: which objects they are, and a digest of them. No NumPy."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ...bake.animation import drivers_of, keyframes, lineage
from ...field.display import SLOWS, is_field, said_of_mirror
from .geometry import geometry

WITH_SPEED = {"DRAG", "HARMONIC", "MAGNET", "FLUID_FLOW"}
"""Types of force fields whose force depends on the velocity of the body they push; that of any other type does if its *Flow* is set."""

ONE = ({"strength", "linear_drag", "guide_minimum"}, {"harmonic_damping", "quadratic_drag"}, {"flow", "inflow"}, {"size", "rest_length"})
"""Groups of properties of a force field that are several names for the same number."""


def force_fields(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Objects with one of Blender's own force fields that act in the re-simulation, as they would on a solver of the scene.

    They are taken from the edit's effector collection if it names one, else from the scene. Objects disabled in viewports, recovered fields
    and what belongs to these are left out.
    """
    settings = scene.seeing_wind
    if not settings.use_force_fields:
        return []
    chosen = settings.effectors
    found = chosen.all_objects if chosen is not None else _enabled(scene.view_layers[0].layer_collection)
    return sorted({obj for obj in found if not obj.hide_viewport and _pushes(obj)}, key=lambda obj: obj.name)


def feels_speed(fields: list[bpy.types.Object]) -> bool:
    """Whether the force of any of `fields` may depend on the velocity of the body it pushes."""
    return any(obj.field.type in WITH_SPEED or obj.field.flow or "field.flow" in _moving(obj) for obj in fields)


def stamp(scene: bpy.types.Scene) -> list[tuple]:
    """Type, place and settings of every acting force field, with keyframes and drivers in place of the values they change."""
    return [(lineage(obj), geometry(obj)[:2], _settings(obj), keyframes(obj)) for obj in force_fields(scene)]


def left_out(scene: bpy.types.Scene) -> list[str]:
    """Messages on what would push the bodies, or weaken a push, in a solver of the scene, but acts differently or not at all here."""
    settings = scene.seeing_wind
    seen = [obj for obj in scene.objects if not obj.hide_viewport]
    said = [] if settings.use_further_fields else _other_winds(seen, settings.field_object)
    if settings.field_object is not None and said_of_mirror(settings.field_object):
        said.append(f"{settings.field_object.name}: {said_of_mirror(settings.field_object)}")
    if not settings.use_force_fields:
        return said
    pushing = [
        obj.name for obj in seen
        if any(_has_forces(system.settings) for system in obj.particle_systems) and _chosen(obj, settings.effectors)
    ]  # fmt: skip
    walls = [obj.name for obj in seen if obj.collision is not None and obj.collision.use and obj.collision.absorption > 0.0]
    if pushing:
        said.append(f"The particles of {', '.join(pushing)} push with a force field of their own: it is left out")
    if walls and force_fields(scene):
        said.append(f"{', '.join(walls)} should absorb force fields behind it (Field Absorption): they act through it here")
    return said


def _other_winds(seen: list[bpy.types.Object], felt: bpy.types.Object | None) -> list[str]:
    """A message that the bodies move in one wind only, if the scene's solvers feel others as well."""
    others = sorted(obj.name for obj in seen if is_field(obj) and obj != felt)
    if not others:
        return []
    where, left = felt.name if felt is not None else "the recovered wind", "are" if len(others) > 1 else "is"
    return [f"The bodies move in {where} alone: {', '.join(others)} {left} left out. Tick All Fields to let every field of the scene act"]


def _has_forces(settings: bpy.types.ParticleSettings) -> bool:
    return any(each is not None and each.type not in ("NONE", "GUIDE") for each in (settings.force_field_1, settings.force_field_2))


def _chosen(obj: bpy.types.Object, effectors: bpy.types.Collection | None) -> bool:
    return effectors is None or obj in effectors.all_objects.values()


def _enabled(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Object]:
    if layer.exclude or layer.collection.hide_viewport:
        return
    yield from layer.collection.objects
    for child in layer.children:
        yield from _enabled(child)


def _pushes(obj: bpy.types.Object) -> bool:
    return obj.field is not None and obj.field.type not in ("NONE", "GUIDE") and not is_field(obj) and SLOWS not in obj


def _moving(obj: bpy.types.Object) -> set[str]:
    """Paths of an object's properties that keyframes or drivers change."""
    return {path for path, *_ in (*keyframes(obj), *drivers_of(obj))}


def _settings(obj: bpy.types.Object) -> list[tuple]:
    moving, field, found = {path.removeprefix("field.") for path in _moving(obj)}, obj.field, []
    moving = moving.union(*(names for names in ONE if names & moving))
    for prop in field.bl_rna.properties:
        name = prop.identifier
        if name == "rna_type" or name in moving:
            continue
        value = getattr(field, name)
        plain = getattr(value, "name", "") if prop.type == "POINTER" else round(value, 5) if prop.type == "FLOAT" else value
        found.append((name, plain))
    return found + [(path, expression) for path, _, expression in drivers_of(obj)]
