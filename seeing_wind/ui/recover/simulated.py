"""Import a re-simulation that was made elsewhere: its bodies as objects with their motion, and the Edit list."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...engine.take import Take
from ..bake.motion import bake_shape_keys
from ..bake.plan import stamp_of_bakes
from ..edit.from_file import fill_edit
from ..edit.resimulate.preview import digest_of_preview
from ..edit.resimulate.request import EditRequest
from ..job import status
from ..job.notes import keep
from ..job.take_reading import is_preview, simulated_motion
from .results import LOADED, collection_of


def import_bodies(scene: bpy.types.Scene, folder: Path, frame_start: int) -> dict[str, bpy.types.Object]:
    """Add all bodies of a re-simulation to the scene as new objects with baked motion, and fill the Edit list. Returns them by name."""
    take, made = Take(folder), {}
    preview = is_preview(take)
    for path in sorted(take.file("bodies").glob("*.npz")):
        arrays = simulated_motion(take, path.stem)
        mesh = bpy.data.meshes.new(path.stem)
        mesh.from_pydata(arrays["vertices"][0].tolist(), [], arrays["triangles"].tolist())
        mesh.update()
        obj = bpy.data.objects.new(path.stem, mesh)
        collection_of(scene, scene.seeing_wind.field_object).objects.link(obj)
        bake_shape_keys(obj, arrays["vertices"], frame_start, float(arrays["fps"]), scene, preview=preview)
        made[path.stem] = obj
    settings, kind = scene.seeing_wind, "coarse" if preview else "simulated"
    setattr(settings, f"{kind}_take", str(folder))
    now, left_out = LOADED, fill_edit(scene, take, made)
    keep(settings, status.EDIT_PREVIEW if preview else "resimulate", left_out or [])
    if left_out == []:
        now = EditRequest.of(scene).digest()
        now = digest_of_preview(scene, now) if preview else now
        settings.baked_digest = now + stamp_of_bakes(scene)
    setattr(settings, f"{kind}_digest", now)
    for body in scene.seeing_wind.bodies:
        if body.is_recovered and body.baked_copy is not None and scene.seeing_wind.recovered_object is not None:
            _dress(body.baked_copy.data, scene.seeing_wind.recovered_object.data)
    return made


def _dress(mesh: bpy.types.Mesh, recovered: bpy.types.Mesh) -> None:
    """Copy materials and UV map of the recovered object to its re-simulated mesh, unless the number of face corners differs."""
    if len(mesh.loops) != len(recovered.loops) or not recovered.uv_layers:
        return
    for material in recovered.materials:
        mesh.materials.append(material)
    places = np.empty(2 * len(mesh.loops), dtype=np.float32)
    recovered.uv_layers.active.uv.foreach_get("vector", places)
    mesh.uv_layers.new(name=recovered.uv_layers.active.name).uv.foreach_set("vector", places)
