"""The edit of a scene as the files that `resimulate` reads: edit.toml, one mesh and one list of pinned vertices per body."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..engine.conventions import GRAVITY
from ..engine.errors import TakeError, UsageError
from ..engine.records import Attachment
from ..engine.take import Take, from_arrays
from .scene_export import export_mesh, export_pins, pinned_vertices, write_edit


def export_edit(scene: bpy.types.Scene, source: Path, folder: Path) -> Path:
    """Write the edit of `scene` into `folder` and return the path of its edit.toml. Each body notes the name of its result.

    Meshes are written as they stand at the clip's first picture.

    Raises:
        UsageError: no bodies, an object that is gone, an empty vertex group.
        TakeError: when the take `source` has no recovered object but the edit asks for it.
    """
    settings, at = scene.seeing_wind, scene.frame_current
    if not len(settings.bodies):
        raise UsageError("No mesh is inserted.", "Select a mesh and use Insert Mesh first.")
    scene.frame_set(settings.frame_start)
    try:
        depsgraph, names, bodies = bpy.context.evaluated_depsgraph_get(), set(), []
        for body in settings.bodies:
            body.result = _free_name(body.name if body.object is None else body.object.name, names)
            bodies.append(_body(body, settings, source, folder, depsgraph))
    finally:
        scene.frame_set(at)
    return write_edit(folder, bodies, _gravity(settings, source), field_strength=settings.field_strength, contact=settings.contact)


def _body(body, settings, source: Path, folder: Path, depsgraph: bpy.types.Depsgraph) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "name": body.result,
        "mass_scale": body.mass_scale,
        "start_frame": body.start_frame,
        "density": body.density if body.use_density else None,
        "youngs_modulus": body.youngs_modulus if body.use_youngs_modulus else None,
        "velocity": tuple(body.velocity) if body.use_velocity else None,
    }
    pins = folder / "pins" / f"{body.result}.npy"
    if body.is_recovered:
        entry["mesh"] = "recovered"
        if body.pin_group:
            if settings.recovered_object is None:
                raise UsageError("The recovered object is gone.", "Load the results again, or undo its deletion.")
            _write_recovered_pins(settings.recovered_object, depsgraph, body.pin_group, source, pins)
            entry["pin"] = pins.relative_to(folder)
        return entry
    if body.object is None or depsgraph.scene.objects.get(body.object.name) is None:
        raise UsageError(f"The object of {body.name} is gone.", "Take it off the list, or undo its deletion.")
    entry["mesh"] = export_mesh(body.object, depsgraph, folder / "meshes" / f"{body.result}.npz").path.relative_to(folder)
    entry["material"] = body.material
    if body.pin_group:
        export_pins(body.object, depsgraph, body.pin_group, pins)
        entry["pin"] = pins.relative_to(folder)
    return entry


def _write_recovered_pins(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, group: str, source: Path, path: Path) -> None:
    """Vertices of the recovered object ride on particles: those particles are held that carry most of a pinned vertex."""
    attachment = from_arrays(Attachment, Take(source).read_arrays("particles.npz"), "surface.attachment.")
    vertices = pinned_vertices(obj, depsgraph, group)
    index, weight = attachment.index[vertices], attachment.weight[vertices]
    particles = np.unique(index[weight >= 0.5 * weight.max(axis=1, keepdims=True)])
    with Take(path.parent).writing(path.name) as aside:
        np.save(aside, particles.astype(np.int64))


def _gravity(settings, source: Path) -> tuple[float, float, float] | None:
    if settings.edit_gravity_mode == "NONE":
        return None
    if settings.edit_gravity_mode == "CUSTOM":
        return tuple(settings.edit_gravity)
    recovered = Take(source).description().get("stages", {}).get("recover", {}).get("settings", {}).get("gravity", GRAVITY)
    if len(recovered) != 3:
        raise TakeError(f"The gravity in {source} is no vector.", "Run Recover again.")
    return tuple(recovered)


def _free_name(name: str, taken: set[str]) -> str:
    """A name that can be a file's and is not taken, near to the object's."""
    plain = re.sub(r"[^\w .-]", "_", name).lstrip(".").strip() or "body"
    free, count = plain, 1
    while free.lower() in taken:
        count += 1
        free = f"{plain}_{count}"
    taken.add(free.lower())
    return free
