"""Absolute shape keys with a keyframed evaluation time: the motion is stored in the .blend file and plays anywhere."""

from __future__ import annotations

import bpy
import numpy as np

from .animation import curves_of, make_linear


def bake(obj: bpy.types.Object, local: np.ndarray, clip_frames: np.ndarray, frames: np.ndarray) -> None:
    """Add one absolute shape key per frame, and two linear keyframes of the evaluation time from the first shape to the last.

    Args:
        obj: a mesh object without shape keys.
        local: vertices (P, V, 3) in object coordinates.
        clip_frames: (P,) frame numbers, for the keys' names.
        frames: (P,) scene frames, evenly spaced.
    """
    for clip_frame, coordinates in zip(clip_frames, local):
        block = obj.shape_key_add(name=f"Frame {clip_frame}", from_mix=False)
        block.interpolation = "KEY_LINEAR"
        block.data.foreach_set("co", coordinates.astype(np.float32).ravel())
    key_time(obj.data.shape_keys, frames)
    obj.active_shape_key_index = 0
    obj.data.update()


def key_time(key: bpy.types.Key, frames: np.ndarray) -> None:
    """Make shape keys absolute and play them in order over scene frames (P,)."""
    key.use_relative = False
    for frame, block in ((frames[0], key.key_blocks[0]), (frames[-1], key.key_blocks[-1])):
        key.eval_time = block.frame
        key.keyframe_insert("eval_time", frame=float(frame))
    make_linear(key, ["eval_time"])


def clear(obj: bpy.types.Object) -> None:
    """Remove all shape keys with their keyframes; the mesh itself is unchanged."""
    key = obj.data.shape_keys
    if key is None:
        return
    action, uid = key.animation_data.action if key.animation_data else None, key.session_uid
    obj.shape_key_clear()
    # Blender counts one user too many for the keys of a copied mesh and would keep them ownerless; a file with such keys cannot be saved
    bpy.data.batch_remove([each for each in bpy.data.shape_keys if each.session_uid == uid])
    if action is not None and action.users == 0:
        bpy.data.actions.remove(action)


def is_intact(obj: bpy.types.Object) -> bool:
    """Whether the shape keys exist and their evaluation time is keyframed."""
    key = obj.data.shape_keys
    return key is not None and bool(evaluation_time_curves(key))


def evaluation_time_curves(key: bpy.types.Key) -> list[bpy.types.FCurve]:
    """The animation curves of a key's evaluation time."""
    return [curve for curve in curves_of(key) if curve.data_path == "eval_time"]
