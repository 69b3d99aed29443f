"""Caches beside the .blend file: PC2 by the Mesh Cache modifier, Alembic and USD by the Mesh Sequence Cache modifier."""

from __future__ import annotations

import contextlib
import hashlib
import struct
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from ...engine.errors import UsageError
from ...engine.take import Take
from ..job.worker import said_by
from .animation import make_linear, remove_curves
from .plan import ALEMBIC, USD
from .shapes import key_time

MODIFIER = "Seeing Wind Cache"
ACTOR = "SeeingWindCache"
"""Name, in the written file, of the object and its mesh."""


def write_pc2(path: Path, vertices: np.ndarray) -> None:
    """Write vertices (T+1, V, 3) as a PC2 file: a 32-byte header (little endian), then float32 coordinates."""
    frames, count = vertices.shape[:2]
    with Take(path.parent).writing(path.name) as aside, open(aside, "wb") as handle:
        handle.write(struct.pack("<12siiffi", b"POINTCACHE2\0", 1, count, 0.0, 1.0, frames))
        handle.write(np.ascontiguousarray(vertices, dtype="<f4").tobytes())


def write_cache(local: np.ndarray, cache: Path) -> Path:
    """Write vertices (T+1, V, 3) in the object's own coordinates as a PC2 file. Returns its path.

    Args:
        cache: path without suffix. A digest of the content is added to the name, so that undo finds the former file unchanged.

    Raises:
        TakeError: when the file cannot be written.
    """
    path = cache.with_name(f"{cache.name}-{_digest(local)}.pc2")
    write_pc2(path, local)
    return path


def show_pc2(obj: bpy.types.Object, path: Path, frames: np.ndarray) -> None:
    """Play a PC2 file on a mesh, through two keyframes of the cache frame; its frames are shown at scene frames `frames` (T+1,)."""
    modifier = obj.modifiers.new(MODIFIER, "MESH_CACHE")
    modifier.name = MODIFIER
    modifier.cache_format, modifier.filepath = "PC2", shown_path(path)
    modifier.forward_axis, modifier.up_axis = "POS_Y", "POS_Z"
    modifier.time_mode, modifier.play_mode, modifier.interpolation = "FRAME", "CUSTOM", "LINEAR"
    obj.modifiers.move(len(obj.modifiers) - 1, 0)
    data_path = modifier.path_from_id("eval_frame")
    for frame, index in ((frames[0], 0.0), (frames[-1], len(frames) - 1.0)):
        modifier.eval_frame = index
        obj.keyframe_insert(data_path, frame=float(frame))
    make_linear(obj, [data_path])


def bake_file(obj: bpy.types.Object, local: np.ndarray, frames: np.ndarray, cache: Path, scene: bpy.types.Scene, way: str) -> None:
    """Write a motion to an Alembic or USD file, which other programs can read too, and play it on the mesh.

    Args:
        local: (T+1, V, 3) in object coordinates.
        frames: (T+1,) scene frames, which must be integers.
        cache: path without suffix. A digest of the content is added to the name, as in `write_cache`.
        way: ALEMBIC or USD.

    Raises:
        UsageError: when Blender could not write the file.
        TakeError: when the folder cannot be written to.
    """
    suffix, top, export = EXPORTS[way]
    path = cache.with_name(f"{cache.name}-{_digest(local, frames)}{suffix}")
    if not path.is_file():
        try:
            with _acting(obj, local, frames, scene), Take(path.parent).writing(path.name) as aside:
                export(aside, frames, scene)
        except RuntimeError as error:
            raise UsageError(f"Blender could not write {path}: {said_by(error)}.", "Bake to a point cache (PC2) instead.") from error
    _show_file(obj, path, f"{top}/{ACTOR}/{ACTOR}")


def clear(obj: bpy.types.Object) -> None:
    """Remove the modifier and its keyframes; the file stays."""
    modifier = obj.modifiers.get(MODIFIER)
    if modifier is None:
        return
    remove_curves(obj, [modifier.path_from_id("eval_frame") if modifier.type == "MESH_CACHE" else ""])
    cache = getattr(modifier, "cache_file", None)
    obj.modifiers.remove(modifier)
    # the operator that opened the cache file remains counted as a user
    if cache is not None and not bpy.data.user_map(subset={cache})[cache]:
        bpy.data.batch_remove([cache])


def is_intact(obj: bpy.types.Object) -> bool:
    """Whether the modifier and its file still exist."""
    modifier = obj.modifiers.get(MODIFIER)
    if modifier is None:
        return False
    path = modifier.filepath if modifier.type == "MESH_CACHE" else modifier.cache_file.filepath if modifier.cache_file else ""
    return bool(path) and Path(bpy.path.abspath(path)).is_file()


def shown_path(path: Path) -> str:
    """`path` relative to the .blend file if that is saved, so that both can be moved together."""
    if not bpy.data.filepath:
        return str(path)
    try:
        return bpy.path.relpath(str(path))
    except ValueError:  # on another drive
        return str(path)


def _digest(*arrays: np.ndarray) -> str:
    return hashlib.sha256(b"".join(np.ascontiguousarray(array, dtype="<f4").tobytes() for array in arrays)).hexdigest()[:8]


def _alembic(path: Path, frames: np.ndarray, scene: bpy.types.Scene) -> None:
    # a background job would return before the file is written
    bpy.ops.wm.alembic_export(
        filepath=str(path), selected=True, start=int(frames[0]), end=int(frames[-1]), as_background_job=False, uvs=False,
        normals=False, evaluation_mode="VIEWPORT",
    )  # fmt: skip


def _usd(path: Path, frames: np.ndarray, scene: bpy.types.Scene) -> None:
    before = scene.frame_start, scene.frame_end  # the exporter takes the file's range from the scene
    scene.frame_start, scene.frame_end = int(frames[0]), int(frames[-1])
    try:
        if scene.frame_start != int(frames[0]):
            raise UsageError(f"A USD file cannot begin at frame {int(frames[0])}.", "Set First Frame to 1, or bake to Alembic.")
        bpy.ops.wm.usd_export(
            filepath=str(path), selected_objects_only=True, export_animation=True, export_shapekeys=False, export_materials=False,
            export_uvmaps=False, export_normals=False, evaluation_mode="VIEWPORT", root_prim_path="/root",
        )  # fmt: skip
    finally:
        scene.frame_end = before[1]
        scene.frame_start = before[0]


EXPORTS = {ALEMBIC: (".abc", "", _alembic), USD: (".usdc", "/root", _usd)}
"""For each way: the file's suffix, the path above the object in it, and the function that exports the selected object; its arguments are
the file's path, the scene frames (T+1,) and the scene."""


@contextlib.contextmanager
def _acting(obj: bpy.types.Object, local: np.ndarray, frames: np.ndarray, scene: bpy.types.Scene) -> Iterator[None]:
    """Add a temporary object at the origin that moves by shape keys, and select only it, since Blender exports what it displays."""
    mesh = obj.data.copy()
    mesh.name = ACTOR
    actor = bpy.data.objects.new(ACTOR, mesh)
    scene.collection.objects.link(actor)
    selected, active = list(bpy.context.selected_objects), bpy.context.view_layer.objects.active
    try:
        for coordinates in local:
            actor.shape_key_add(from_mix=False).data.foreach_set("co", coordinates.astype(np.float32).ravel())
        key_time(mesh.shape_keys, frames)
        for each in selected:
            each.select_set(False)
        actor.select_set(True)
        yield
    finally:
        data = mesh.shape_keys.animation_data if mesh.shape_keys is not None else None
        action = data.action if data is not None else None
        bpy.data.objects.remove(actor)
        bpy.data.meshes.remove(mesh)
        if action is not None and action.users == 0:
            bpy.data.actions.remove(action)
        for each in selected:
            each.select_set(True)
        bpy.context.view_layer.objects.active = active


def _show_file(obj: bpy.types.Object, path: Path, inside: str) -> None:
    """Play on a mesh the motion of the object at the path `inside` an Alembic or USD file."""
    before = set(bpy.data.cache_files)
    bpy.ops.cachefile.open(filepath=str(path))
    cache = next(each for each in bpy.data.cache_files if each not in before)
    cache.filepath = shown_path(path)
    modifier = obj.modifiers.new(MODIFIER, "MESH_SEQUENCE_CACHE")
    modifier.name, modifier.cache_file = MODIFIER, cache
    modifier.read_data = {"VERT"}
    modifier.object_path = inside
    obj.modifiers.move(len(obj.modifiers) - 1, 0)
