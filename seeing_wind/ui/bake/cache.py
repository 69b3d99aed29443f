"""Point caches beside the .blend file: PC2 through the Mesh Cache modifier, Alembic through the Mesh Sequence Cache modifier."""

from __future__ import annotations

import hashlib
import struct
from pathlib import Path

import bpy
import numpy as np

from ...engine.errors import UsageError
from ...engine.take import Take
from ..job.worker import said_by
from .animation import make_linear, remove_curves

MODIFIER = "Seeing Wind Cache"


def write_pc2(path: Path, vertices: np.ndarray) -> None:
    """Vertices (T+1, V, 3) as a PC2 file: 32 bytes of header (little endian), then float32 coordinates."""
    pictures, count = vertices.shape[:2]
    with Take(path.parent).writing(path.name) as aside, open(aside, "wb") as handle:
        handle.write(struct.pack("<12siiffi", b"POINTCACHE2\0", 1, count, 0.0, 1.0, pictures))
        handle.write(np.ascontiguousarray(vertices, dtype="<f4").tobytes())


def write_cache(local: np.ndarray, cache: Path) -> Path:
    """Write vertices (T+1, V, 3) in the object's own coordinates as a PC2 file. Returns its path.

    Args:
        cache: path of the file without suffix. Its content becomes part of the name, so that an undo finds the former file as it was.

    Raises:
        TakeError: when it cannot be written.
    """
    digest = hashlib.sha256(np.ascontiguousarray(local, dtype="<f4").tobytes()).hexdigest()[:8]
    path = cache.with_name(f"{cache.name}-{digest}.pc2")
    write_pc2(path, local)
    return path


def show_pc2(obj: bpy.types.Object, path: Path, frames: np.ndarray) -> None:
    """Give a mesh the motion of a PC2 file, with two keyframes of the picture that is shown: its pictures stand at `frames` (T+1,)."""
    modifier = obj.modifiers.new(MODIFIER, "MESH_CACHE")
    modifier.name = MODIFIER
    modifier.cache_format, modifier.filepath = "PC2", shown_path(path)
    modifier.forward_axis, modifier.up_axis = "POS_Y", "POS_Z"
    modifier.time_mode, modifier.play_mode, modifier.interpolation = "FRAME", "CUSTOM", "LINEAR"
    obj.modifiers.move(len(obj.modifiers) - 1, 0)
    data_path = modifier.path_from_id("eval_frame")
    for frame, picture in ((frames[0], 0.0), (frames[-1], len(frames) - 1.0)):
        modifier.eval_frame = picture
        obj.keyframe_insert(data_path, frame=float(frame))
    make_linear(obj, [data_path])


def bake_alembic(obj: bpy.types.Object, local: np.ndarray, frames: np.ndarray, cache: Path, scene: bpy.types.Scene) -> None:
    """Give a mesh the motion of an Alembic file, which other programs read too.

    Args:
        local: (T+1, V, 3) in the object's own coordinates, shown at `frames`, which must be whole.
        cache: path of the file without suffix.

    Raises:
        UsageError: when Blender could not write the file.
    """
    path = cache.with_suffix(".abc") if cache.suffix else cache.with_name(f"{cache.name}.abc")
    path.parent.mkdir(parents=True, exist_ok=True)
    actor = _actor(obj, local, frames, scene)
    selected, active = list(bpy.context.selected_objects), bpy.context.view_layer.objects.active
    try:
        for each in selected:
            each.select_set(False)
        actor.select_set(True)
        # as_background_job would return before the file is there
        bpy.ops.wm.alembic_export(
            filepath=str(path), selected=True, start=int(frames[0]), end=int(frames[-1]), as_background_job=False, uvs=False,
            normals=False, evaluation_mode="VIEWPORT",
        )  # fmt: skip
    except RuntimeError as error:
        raise UsageError(f"Blender could not write {path}: {said_by(error)}.", "Bake to a point cache (PC2) instead.") from error
    finally:
        key, mesh, action = actor.data.shape_keys, actor.data, actor.data.shape_keys.animation_data.action
        bpy.data.objects.remove(actor)
        bpy.data.meshes.remove(mesh)
        if action.users == 0:
            bpy.data.actions.remove(action)
        del key
        for each in selected:
            each.select_set(True)
        bpy.context.view_layer.objects.active = active
    if not path.is_file():
        raise UsageError(f"Blender wrote no Alembic file {path}.", "Bake to a point cache (PC2) instead.")
    _show_alembic(obj, path)


def clear(obj: bpy.types.Object) -> None:
    """Remove the modifier and its keyframes; the file stays."""
    modifier = obj.modifiers.get(MODIFIER)
    if modifier is None:
        return
    remove_curves(obj, [modifier.path_from_id("eval_frame") if modifier.type == "MESH_CACHE" else ""])
    cache = getattr(modifier, "cache_file", None)
    obj.modifiers.remove(modifier)
    # the operator that opens a cache file counts as a user for ever
    if cache is not None and not bpy.data.user_map(subset={cache})[cache]:
        bpy.data.batch_remove([cache])


def is_intact(obj: bpy.types.Object) -> bool:
    """Whether the modifier is there and its file too."""
    modifier = obj.modifiers.get(MODIFIER)
    if modifier is None:
        return False
    path = modifier.filepath if modifier.type == "MESH_CACHE" else modifier.cache_file.filepath if modifier.cache_file else ""
    return bool(path) and Path(bpy.path.abspath(path)).is_file()


def shown_path(path: Path) -> str:
    """A path relative to the .blend file where there is one, so that both can be moved together."""
    if not bpy.data.filepath:
        return str(path)
    try:
        return bpy.path.relpath(str(path))
    except ValueError:  # on another drive
        return str(path)


def _actor(obj: bpy.types.Object, local: np.ndarray, frames: np.ndarray, scene: bpy.types.Scene) -> bpy.types.Object:
    """A passing object at the origin that moves by shape keys: Blender writes Alembic from what it displays."""
    mesh = obj.data.copy()
    mesh.name = "SeeingWind"
    actor = bpy.data.objects.new("SeeingWind", mesh)
    scene.collection.objects.link(actor)
    for coordinates in local:
        actor.shape_key_add(from_mix=False).data.foreach_set("co", coordinates.astype(np.float32).ravel())
    key = mesh.shape_keys
    key.use_relative = False
    for frame, block in ((frames[0], key.key_blocks[0]), (frames[-1], key.key_blocks[-1])):
        key.eval_time = block.frame
        key.keyframe_insert("eval_time", frame=float(frame))
    make_linear(key, ["eval_time"])
    return actor


def _show_alembic(obj: bpy.types.Object, path: Path) -> None:
    before = set(bpy.data.cache_files)
    bpy.ops.cachefile.open(filepath=str(path))
    cache = next(each for each in bpy.data.cache_files if each not in before)
    cache.filepath = shown_path(path)
    modifier = obj.modifiers.new(MODIFIER, "MESH_SEQUENCE_CACHE")
    modifier.name, modifier.cache_file = MODIFIER, cache
    modifier.read_data = {"VERT"}
    modifier.object_path = next((each.path for each in cache.object_paths if "SeeingWind" in each.path), "/SeeingWind/SeeingWind")
    obj.modifiers.move(len(obj.modifiers) - 1, 0)
