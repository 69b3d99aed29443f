"""A simulated mesh as keyframes: absolute shape keys with a keyed evaluation time. The file then plays without this add-on."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from ..engine.errors import UsageError
from .units import metres_per_unit

MARK = "seeing_wind_bake"
"""Custom property of an object that carries a bake: the names of the modifiers that the bake put to sleep, one per line."""


def bake_shape_keys(
    obj: bpy.types.Object,
    vertices: np.ndarray,
    frame_start: int,
    fps: float,
    scene: bpy.types.Scene | None = None,
    frames_follow_time: bool = False,
) -> bpy.types.Key:
    """Give a mesh object the motion of its vertices as absolute shape keys, one per picture; a former bake is replaced.

    The object's modifiers are put to sleep, since the simulation has seen their effect already (`clear_bake` wakes them). The mesh itself
    stays what it was.

    Args:
        obj: a mesh object with V vertices; it may be moving itself, its motion is taken out of the keys.
        vertices: (T+1, V, 3) in the world [m].
        frame_start: scene frame of picture 0.
        fps: of `vertices`.
        scene: for units and frame rate; by default the context's.
        frames_follow_time: keep the speed where the scene's frame rate is another than `fps`; otherwise one scene frame is one picture,
            as everywhere in a take.

    Returns:
        The shape key data of the mesh.

    Raises:
        UsageError: for anything but a mesh, for other vertex counts, for values that are not finite, or where the object has shape keys
            of the user's.
    """
    scene = scene or bpy.context.scene
    _check(obj, vertices)
    clear_bake(obj)
    stride = scene.render.fps / scene.render.fps_base / fps if frames_follow_time else 1.0
    frames = frame_start + stride * np.arange(len(vertices))
    awake = [modifier for modifier in obj.modifiers if modifier.show_viewport]
    obj[MARK] = "\n".join(modifier.name for modifier in awake)
    for modifier in awake:
        modifier.show_viewport = modifier.show_render = False
    local = _in_object_space(obj, np.asarray(vertices, dtype=np.float64) / metres_per_unit(scene), frames, scene)
    for picture, coordinates in enumerate(local):
        block = obj.shape_key_add(name=f"Picture {picture}", from_mix=False)
        block.interpolation = "KEY_LINEAR"
        block.data.foreach_set("co", coordinates.astype(np.float32).ravel())
    key = obj.data.shape_keys
    key.use_relative = False
    _key_evaluation_time(key, float(frames[0]), float(frames[-1]))
    obj.active_shape_key_index = 0
    obj.data.update()
    return key


def clear_bake(obj: bpy.types.Object) -> bool:
    """Take a former bake from an object and wake its modifiers. Returns whether there was one; shape keys of the user's stay."""
    if MARK not in obj:
        return False
    key = obj.data.shape_keys
    if key is not None:
        action = key.animation_data.action if key.animation_data else None
        obj.shape_key_clear()
        if action is not None and action.users == 0:
            bpy.data.actions.remove(action)
    for name in obj[MARK].splitlines():
        modifier = obj.modifiers.get(name)
        if modifier is not None:
            modifier.show_viewport = modifier.show_render = True
    del obj[MARK]
    return True


def baked_copy(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, name: str = "", collection: bpy.types.Collection | None = None
) -> bpy.types.Object:
    """A copy of an object as it is displayed, its modifiers applied: what to bake to where modifiers make vertices, or keys are in use.

    Args:
        obj: a mesh object; its transform stays the copy's.
        depsgraph: evaluated at the frame whose shape is wanted.
        name: of the copy.
        collection: where to link it, by default where `obj` is.
    """
    mesh = bpy.data.meshes.new_from_object(obj.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph)
    copy = bpy.data.objects.new(name or f"{obj.name} Simulated", mesh)
    copy.matrix_world = obj.matrix_world.copy()
    (collection or obj.users_collection[0]).objects.link(copy)
    return copy


def evaluation_time_curves(key: bpy.types.Key) -> list[bpy.types.FCurve]:
    """The animation curves of a key's evaluation time, through layers, strips and channel bags (Blender 5 has no other way)."""
    data = key.animation_data
    if data is None or data.action is None:
        return []
    bags = [bag for layer in data.action.layers for strip in layer.strips for bag in strip.channelbags if bag.slot == data.action_slot]
    return [curve for bag in bags for curve in bag.fcurves if curve.data_path == "eval_time"]


def _check(obj: bpy.types.Object, vertices: np.ndarray) -> None:
    if obj.type != "MESH":
        raise UsageError(f"{obj.name} is no mesh.", "Convert it to a mesh first (Object > Convert).")
    if obj.data.shape_keys is not None and MARK not in obj:
        raise UsageError(f"{obj.name} has shape keys of its own.", "Bake to a copy of it, or remove its shape keys.")
    if obj.data.users > 1:
        raise UsageError(
            f"{obj.name} shares its mesh with other objects.", "Make it a single user of its mesh (Object > Relations) and bake again."
        )
    shape = np.shape(vertices)
    if len(shape) != 3 or shape[2] != 3 or shape[0] < 2:
        raise UsageError(f"Simulated vertices have the shape {shape}.", "Expected (T + 1, V, 3) with two pictures or more.")
    count = len(obj.data.vertices)
    if shape[1] != count:
        hint = (
            "Its modifiers change the vertices: bake to a copy instead."
            if obj.modifiers
            else "Simulate it again: its mesh has changed since."
        )
        raise UsageError(f"{obj.name} has {count} vertices, the simulation {shape[1]}.", hint)
    if not np.isfinite(vertices).all():
        raise UsageError(f"The simulation of {obj.name} has vertices that are not finite.", "Simulate it again.")


def _in_object_space(obj: bpy.types.Object, vertices: np.ndarray, frames: np.ndarray, scene: bpy.types.Scene) -> np.ndarray:
    """World coordinates (T+1, V, 3) in scene units -> the object's own, at each picture's frame where the object moves."""
    lineage = [obj]
    while lineage[-1].parent is not None:
        lineage.append(lineage[-1].parent)
    if any(each.animation_data or each.constraints or each.rigid_body for each in lineage):
        matrices = _matrices_over_time(obj, frames, scene)
    else:
        bpy.context.view_layer.update()
        matrices = [obj.matrix_world.copy()] * len(vertices)
    local = np.empty_like(vertices)
    for picture, matrix in enumerate(matrices):
        inverse = np.array(matrix.inverted())
        local[picture] = vertices[picture] @ inverse[:3, :3].T + inverse[:3, 3]
    return local


def _matrices_over_time(obj: bpy.types.Object, frames: np.ndarray, scene: bpy.types.Scene) -> list[Matrix]:
    before, matrices = scene.frame_current_final, []
    for frame in frames:
        scene.frame_set(int(frame), subframe=float(frame % 1.0))
        matrices.append(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world.copy())
    scene.frame_set(int(before), subframe=float(before % 1.0))
    return matrices


def _key_evaluation_time(key: bpy.types.Key, first: float, last: float) -> None:
    """Two linear keyframes from the first shape to the last."""
    for frame, block in ((first, key.key_blocks[0]), (last, key.key_blocks[-1])):
        key.eval_time = block.frame
        key.keyframe_insert("eval_time", frame=frame)
    for curve in evaluation_time_curves(key):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
