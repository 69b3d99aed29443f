"""The edit of a scene as the files that `resimulate` reads: edit.toml, one mesh and one list of pinned vertices per body."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ....engine.conventions import GRAVITY
from ....engine.errors import TakeError, UsageError
from ....engine.records import Attachment
from ....engine.settings import ColliderEdit, Edit, options_of
from ....engine.take import Take, from_arrays
from ...bake.animation import values_over
from ...bake.at_rest import at_rest
from ...job.take_reading import field_summary
from ...option_properties import value_of, values_of
from ...scene_mesh import pinned_vertices
from .digest import body_values
from .edit_files import export_mesh, export_pins, write_array, write_edit, write_pins

LONGEST = 50
"""Characters of an object's name that become a file's: Blender allows 255 bytes, as most file systems do, endings not counted."""


def export_edit(scene: bpy.types.Scene, source: Path, folder: Path) -> Path:
    """Write the edit of `scene` into `folder` and return the path of its edit.toml. Each body notes the name of its result.

    Meshes are written as they stand at the clip's first picture, before any bake, in the place where they are simulated (the edit's
    offset taken off).

    Raises:
        UsageError: no bodies, an object that is gone, an empty vertex group.
        TakeError: when the take `source` has no recovered object but the edit asks for it.
    """
    settings, at = scene.seeing_wind, scene.frame_current
    if not len(settings.bodies):
        raise UsageError("No mesh is inserted.", "Select a mesh and use Insert Mesh first.")
    scene.frame_set(settings.frame_start)
    try:
        names: set[str] = set()
        bodies: list[dict[str, Any]] = []
        for body in settings.bodies:
            body.result = _free_name(body.name if body.object is None else body.object.name, names)
            bodies.append(_body(body, scene, source, folder))
        colliders = _colliders(scene, folder)
    finally:
        scene.frame_set(at)
    strength = field_strengths(scene, field_summary(Take(source)).frames)
    return write_edit(folder, bodies, _gravity(settings, source), colliders, field_strength=strength, **values_of(settings, Edit))


def field_strengths(scene: bpy.types.Scene, frames: int) -> float | list[float]:
    """The factor on the field: one number, or one per frame (T,) where it has keyframes."""
    settings = scene.seeing_wind
    values = values_over(scene, settings, "field_strength", range(settings.frame_start, settings.frame_start + frames))
    return values[0] if len(set(values)) == 1 else values


def _body(body: bpy.types.PropertyGroup, scene: bpy.types.Scene, source: Path, folder: Path) -> dict[str, Any]:
    entry = body_values(body) | {"name": body.result}
    pins = folder / "pins" / f"{body.result}.npy"
    if body.is_recovered:
        return entry | {"mesh": "recovered"} | _holds_of_the_recovered(body, scene, source, folder, pins)
    obj = present(body, scene)
    with at_rest(obj, scene) as still:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        exported = export_mesh(still, depsgraph, folder / "meshes" / f"{body.result}.npz", -np.array(scene.seeing_wind.offset))
        entry["mesh"] = exported.path.relative_to(folder)
        if body.pin_group:
            _, weights = export_pins(still, depsgraph, body.pin_group, pins)
            entry["pin"] = pins.relative_to(folder)
            entry["pin_weights"] = weights.relative_to(folder) if weights else None
    return entry


def present(body: bpy.types.PropertyGroup, scene: bpy.types.Scene) -> bpy.types.Object:
    """The object of a body. Raises UsageError when the user has deleted it, or taken it out of the scene."""
    if body.object is None or body.object not in scene.objects.values():
        raise UsageError(f"The object of {body.name} is gone.", "Take it off the list, or undo its deletion.")
    return body.object


def _holds_of_the_recovered(body, scene: bpy.types.Scene, source: Path, folder: Path, pins: Path) -> dict[str, Any]:
    """Which particles of the clip's object are held besides those of the clip, and which are let go."""
    entry: dict[str, Any] = {}
    if body.pin_group:
        particles, weights = _carriers(body.pin_group, scene, source)
        beside = write_pins(pins, particles, weights)
        entry["pin"], entry["pin_weights"] = pins.relative_to(folder), beside.relative_to(folder) if beside else None
    if body.free_mode != "KEEP":
        arrays = Take(source).read_arrays("particles.npz")
        everything = np.arange(len(arrays["particles.x"]), dtype=np.int64)
        free = everything if body.free_mode == "ALL" else _carriers(body.free_group, scene, source)[0]
        path = folder / "pins" / f"{body.result}.free.npy"
        write_array(path, free)
        entry["free"] = path.relative_to(folder)
    return entry


def _carriers(group: str, scene: bpy.types.Scene, source: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of the recovered object ride on particles: the particles that carry most of a group's vertices, with their weights."""
    obj = scene.seeing_wind.recovered_object
    if obj is None:
        raise UsageError("The recovered object is gone.", "Load the results again, or undo its deletion.")
    attachment = from_arrays(Attachment, Take(source).read_arrays("particles.npz"), "surface.attachment.")
    vertices, weights = pinned_vertices(obj, bpy.context.evaluated_depsgraph_get(), group)
    index, carries = attachment.index[vertices], attachment.weight[vertices]
    most = carries >= 0.5 * carries.max(axis=1, keepdims=True)
    strongest = np.zeros(int(attachment.index.max()) + 1)
    np.maximum.at(strongest, index[most], np.broadcast_to(weights[:, None], index.shape)[most])
    particles = np.flatnonzero(strongest > 0.0)
    return particles.astype(np.int64), strongest[particles]


def _colliders(scene: bpy.types.Scene, folder: Path) -> list[dict[str, Any]]:
    settings, names, found = scene.seeing_wind, set[str](), []
    if settings.use_floor:
        found.append({"name": "floor", "plane": [0.0, 0.0, settings.floor_height, 0.0, 0.0, 1.0], "friction": settings.floor_friction})
    for collider in settings.colliders:
        obj = collider.object
        if obj is None or obj not in scene.objects.values():
            raise UsageError(f"The object of the collider {collider.name} is gone.", "Take it off the list, or undo its deletion.")
        if any(body.object == obj for body in settings.bodies):
            raise UsageError(f"{obj.name} is both a body and a collider.", "Take it off one of the two lists.")
        name = _free_name(obj.name, names)
        with at_rest(obj, scene, whole=True) as still:
            depsgraph = bpy.context.evaluated_depsgraph_get()
            path = export_mesh(still, depsgraph, folder / "colliders" / f"{name}.npz").path
        found.append({"name": name, "mesh": path.relative_to(folder), **values_of(collider, ColliderEdit)})
    return found


def _gravity(settings, source: Path) -> tuple[float, float, float] | None:
    if settings.edit_gravity_mode == "NONE":
        return None
    if settings.edit_gravity_mode == "CUSTOM":
        return value_of(settings, options_of(Edit)["gravity"])
    recovered = Take(source).description().get("stages", {}).get("recover", {}).get("settings", {}).get("gravity", GRAVITY)
    if len(recovered) != 3:
        raise TakeError(f"The gravity in {source} is no vector.", "Run Recover again.")
    return tuple(recovered)


def _free_name(name: str, taken: set[str]) -> str:
    """A name that can be a file's and is not taken, near to the object's."""
    plain = re.sub(r"[^\w .-]", "_", name)[:LONGEST].strip(" .") or "body"
    free, count = plain, 1
    while free.lower() in taken:
        count += 1
        free = f"{plain}_{count}"
    taken.add(free.lower())
    return free
