"""Bake the motion of a simulated mesh in the way that suits it. The file then plays without this extension and the engine.

Absolute shape keys with a keyed evaluation time are the default. A body that stays rigid gets location and rotation keyframes instead; a
motion too large for the .blend file goes into a point cache (PC2) beside it. Alembic and USD files are used on request only.
"""

from __future__ import annotations

import json
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...engine.errors import UsageError
from ..scene_units import metres_per_unit
from . import cache as bake_cache
from . import rigid as bake_rigid
from . import shapes as bake_shapes
from .animation import set_frame, with_parents
from .plan import ALEMBIC, AUTO, MARK, POINT_CACHE, SHAPE_KEYS, TRANSFORM, USD, Baked, Plan, mark_of
from .smooth import smoothed

LARGE = 48_000_000
"""Bytes of coordinates above which a point cache beside the file is better than shape keys in it: 60 frames of 67000 vertices."""


def bake_motion(obj: bpy.types.Object, vertices: np.ndarray, plan: Plan, scene: bpy.types.Scene | None = None) -> Baked:
    """Bake the motion of its vertices onto a mesh object, replacing a former bake.

    The object's modifiers are switched off, since the simulated motion already contains their effect (`clear_bake` switches them on again);
    with location and rotation keyframes, only if they deform the object over time. Subdivision at the end of the stack, and modifiers added
    after a former bake, stay on top of the motion. The mesh itself is unchanged.

    Args:
        obj: a mesh object with V vertices (any number for location and rotation keyframes); if it moves itself, that motion is removed.
        vertices: (T+1, V, 3) in the world [m].
        plan: how to bake.
        scene: for units and frame rate; by default the context's.

    Raises:
        UsageError: for an object that is no mesh or has another vertex count or shape keys of its own; for values that are not finite;
            for a range of fewer than two frames; and for a way that this object or this build of Blender does not support.
    """
    scene = scene or bpy.context.scene
    vertices = np.asarray(vertices, dtype=np.float64)
    chosen, frames, fit, way = allowed(obj, vertices, plan, scene)
    if _has(obj, plan.stamp):
        return Baked(mark_of(obj)["way"], len(chosen), fit.residual, kept=True)
    on_top = awake_on_top(obj)
    record: dict[str, Any] = {"way": way, "stamp": plan.stamp, "preview": plan.preview, "slept": []}
    if way == TRANSFORM:
        clear_bake(obj)
        record["slept"] = _put_to_sleep(obj, on_top) if plan.reshaped else []
        record["former"] = bake_rigid.bake(obj, fit, chosen, frames, metres_per_unit(scene))
    else:
        vertices = smoothed(vertices, _edges(obj), fit, plan.smooth)
        local = _in_object_space(obj, vertices[chosen] / metres_per_unit(scene), frames, scene)
        # written first: if the disk is full, the object keeps its former bake
        written = bake_cache.write_cache(local, plan.cache) if way == POINT_CACHE else None
        clear_bake(obj)
        record["slept"] = _put_to_sleep(obj, on_top)
        try:
            if way == SHAPE_KEYS:
                bake_shapes.bake(obj, local, chosen, frames)
            elif way == POINT_CACHE:
                bake_cache.show_pc2(obj, written, frames)
            else:
                bake_cache.bake_file(obj, local, frames, plan.cache, scene, way)
        except Exception:
            _wake(obj, record["slept"])
            raise
    obj[MARK] = json.dumps(record)
    return Baked(way, len(chosen), fit.residual)


def allowed(
    obj: bpy.types.Object, vertices: np.ndarray, plan: Plan, scene: bpy.types.Scene
) -> tuple[np.ndarray, np.ndarray, bake_rigid.RigidFit, str]:
    """What `bake_motion` would do: clip frames and scene frames of the keys, nearest rigid motion, and way. Raises the same errors."""
    _check_motion(obj, vertices)
    chosen, frames = baked_frames(len(vertices), plan, scene)
    keyed = bake_rigid.fit_for(obj, vertices, plan.reshaped, mark_of(obj) or {}, metres_per_unit(scene))
    way = way_for(obj, keyed, vertices[chosen], plan)
    if way != TRANSFORM and not _has(obj, plan.stamp):
        _check_mesh(obj, vertices.shape[1])
    return chosen, frames, keyed if way == TRANSFORM else bake_rigid.rigid_fit(vertices), way


def bake_shape_keys(
    obj: bpy.types.Object,
    vertices: np.ndarray,
    frame_start: int,
    fps: float,
    scene: bpy.types.Scene | None = None,
    preview: bool = False,
) -> bpy.types.Key:
    """`bake_motion` to absolute shape keys, one per frame. Returns the shape key data of the mesh."""
    bake_motion(obj, vertices, Plan(frame_start, fps, SHAPE_KEYS, preview=preview), scene)
    return obj.data.shape_keys


def clear_bake(obj: bpy.types.Object) -> bool:
    """Remove a bake from an object and switch its modifiers on again. Returns whether there was one; the user's own shape keys stay.

    Keyframes of the bake that the user has changed are removed too. Files of a point cache stay, since undo may need them.
    """
    record = mark_of(obj)
    if record is None:
        return False
    if record["way"] == SHAPE_KEYS:
        bake_shapes.clear(obj)
    elif record["way"] == TRANSFORM:
        bake_rigid.clear(obj, record["former"])
    else:
        bake_cache.clear(obj)
    _wake(obj, record["slept"])
    del obj[MARK]
    return True


def is_intact(obj: bpy.types.Object) -> bool:
    """Whether the bake that the object's mark records still exists: the user may have deleted keys, modifier or file."""
    record = mark_of(obj)
    if record is None:
        return False
    if record["way"] == SHAPE_KEYS:
        return bake_shapes.is_intact(obj)
    if record["way"] == TRANSFORM:
        return bake_rigid.is_intact(obj)
    return bake_cache.is_intact(obj)


def awake_on_top(obj: bpy.types.Object) -> list[str]:
    """Names of the modifiers that act on top of a simulated motion instead of being part of what is simulated.

    These are the subdivision surfaces at the end of the stack; on an object baked to vertices, all modifiers that are switched on.
    """
    if mark_of(obj) is not None and mark_of(obj)["way"] != TRANSFORM:
        return [modifier.name for modifier in obj.modifiers if modifier.show_viewport and modifier.name != bake_cache.MODIFIER]
    last = []
    for modifier in reversed(obj.modifiers):
        if modifier.type != "SUBSURF":
            break
        last.append(modifier.name)
    return last


def baked_copy(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, name: str, collection: bpy.types.Collection
) -> bpy.types.Object:
    """A copy of an object as displayed, with modifiers applied: the target of a bake where modifiers add vertices, or shape keys exist.

    Args:
        obj: a mesh object; the copy has the same world transform.
        depsgraph: evaluated at the frame whose shape is wanted.
        name: of the copy.
        collection: where to link it.
    """
    mesh = bpy.data.meshes.new_from_object(obj.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph)
    copy = bpy.data.objects.new(name, mesh)
    copy.matrix_world = obj.matrix_world.copy()
    collection.objects.link(copy)
    return copy


# -- what can be baked, and how ---------------------------------------------------------------------------------------------------


def _check_motion(obj: bpy.types.Object, vertices: np.ndarray) -> None:
    if obj.type != "MESH":
        raise UsageError(f"{obj.name} is no mesh.", "Convert it to a mesh first (Object > Convert).")
    if obj.mode == "EDIT":
        raise UsageError(f"{obj.name} is in Edit Mode, where it can get no keyframes.", "Leave Edit Mode (Tab) and bake again.")
    if vertices.ndim != 3 or vertices.shape[2] != 3 or vertices.shape[0] < 2:
        raise UsageError(f"Simulated vertices have the shape {vertices.shape}.", "Expected (T + 1, V, 3) with two frames or more.")
    if not np.isfinite(vertices).all():
        raise UsageError(f"The simulation of {obj.name} has vertices that are not finite.", "Simulate it again.")


def _check_mesh(obj: bpy.types.Object, simulated: int) -> None:
    if obj.data.library is not None or obj.data.override_library is not None:
        raise UsageError(f"The mesh of {obj.name} is linked from another file.", "Make it local (Object > Relations), or bake to a copy.")
    if obj.data.shape_keys is not None and MARK not in obj:
        raise UsageError(f"{obj.name} has shape keys of its own.", "Bake to a copy of it, or remove its shape keys.")
    if obj.data.users > 1:
        raise UsageError(
            f"{obj.name} shares its mesh with other objects.", "Make it a single user of its mesh (Object > Relations) and bake again."
        )
    count = len(obj.data.vertices)
    if simulated != count:
        hint = (
            "Its modifiers change the vertices: bake to a copy instead."
            if obj.modifiers
            else "Simulate it again: its mesh has changed since."
        )
        raise UsageError(f"{obj.name} has {count} vertices, the simulation {simulated}.", hint)


def _has(obj: bpy.types.Object, stamp: str) -> bool:
    """Whether an object already has the bake with this stamp, intact."""
    return bool(stamp) and is_intact(obj) and mark_of(obj)["stamp"] == stamp


def _edges(obj: bpy.types.Object) -> np.ndarray:
    """Edges (E, 2) of an object's mesh."""
    found = np.empty(2 * len(obj.data.edges), dtype=np.int32)
    obj.data.edges.foreach_get("vertices", found)
    return found.reshape(-1, 2)


def baked_frames(count: int, plan: Plan, scene: bpy.types.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the clip frames to bake, and their scene frames. Raises UsageError for a range with fewer than two of them."""
    stride = scene.render.fps / scene.render.fps_base / plan.fps if plan.frames_follow_time else 1.0
    frames = plan.frame_start + stride * np.arange(count)
    if plan.frames is None:
        return np.arange(count), frames
    first, last = plan.frames
    chosen = np.flatnonzero((frames >= first - 1e-6) & (frames <= last + 1e-6))
    if len(chosen) < 2:
        raise UsageError(
            f"Frames {first} to {last} hold {len(chosen)} of the simulated frames.",
            f"Choose two or more of the frames {frames[0]:g} to {frames[-1]:g}.",
        )
    return chosen, frames[chosen]


def way_for(obj: bpy.types.Object, fit: bake_rigid.RigidFit | None, vertices: np.ndarray, plan: Plan) -> str:
    """The way to bake: as the plan asks or, for AUTO, as suits the motion. Raises UsageError for an impossible way."""
    obstacle = bake_rigid.obstacle(obj, mark_of(obj) or {}) or ("" if fit is not None else "its shape keys or modifiers move it")
    rigid = fit is not None and fit.residual <= plan.rigid_tolerance * fit.size
    if plan.way == TRANSFORM:
        if obstacle:
            raise UsageError(f"{obj.name} cannot have keys of location and rotation: {obstacle}.", "Bake it to shape keys.")
        if not rigid:
            share = 100.0 * fit.residual / max(fit.size, 1e-12)
            raise UsageError(
                f"{obj.name} does not stay rigid: it bends by {share:.2g} % of its size.", "Bake it to shape keys, or allow more."
            )
        return TRANSFORM
    check_file(plan)
    if plan.way != AUTO:
        return plan.way
    if rigid and not obstacle:
        return TRANSFORM
    return POINT_CACHE if vertices.size * 4 > LARGE and plan.cache is not None else SHAPE_KEYS


def check_file(plan: Plan) -> None:
    """Raise UsageError for a way whose file this build of Blender cannot write, or that has no folder."""
    for kind, here in ((ALEMBIC, bpy.app.build_options.alembic), (USD, bpy.app.build_options.usd)):
        if plan.way == kind and not here:
            raise UsageError(f"This build of Blender has no {kind.title() if kind == ALEMBIC else kind}.", "Bake to a point cache (PC2).")
    if plan.way in (POINT_CACHE, ALEMBIC, USD) and plan.cache is None:
        raise UsageError("There is no place for a point cache.", "Save the file first, or choose a folder for the take.")


def _put_to_sleep(obj: bpy.types.Object, on_top: list[str]) -> list[list[Any]]:
    """Switch off the modifiers whose effect the simulated motion contains. Returns name and former visibility of each."""
    asleep = []
    for modifier in obj.modifiers:
        if modifier.show_viewport and modifier.name not in on_top:
            asleep.append([modifier.name, modifier.show_viewport, modifier.show_render])
            modifier.show_viewport = modifier.show_render = False
    return asleep


def _wake(obj: bpy.types.Object, asleep: list[list[Any]]) -> None:
    for name, viewport, render in asleep:
        modifier = obj.modifiers.get(name)
        if modifier is not None:
            modifier.show_viewport, modifier.show_render = viewport, render


def _in_object_space(obj: bpy.types.Object, vertices: np.ndarray, frames: np.ndarray, scene: bpy.types.Scene) -> np.ndarray:
    """World coordinates (T+1, V, 3) in scene units -> object coordinates, by the unbaked object's transform at each of `frames` (T+1,)."""
    mark = mark_of(obj)
    if mark is not None and mark["way"] == TRANSFORM:
        matrices = [Matrix(mark["former"]["world"])] * len(vertices)
    elif any(each.animation_data or each.constraints or each.rigid_body for each in with_parents(obj)):
        matrices = _matrices_over_time(obj, frames, scene)
    else:
        bpy.context.view_layer.update()
        matrices = [obj.matrix_world.copy()] * len(vertices)
    local = np.empty_like(vertices)
    for index, matrix in enumerate(matrices):
        inverse = np.array(matrix.inverted_safe())
        local[index] = vertices[index] @ inverse[:3, :3].T + inverse[:3, 3]
    return local


def _matrices_over_time(obj: bpy.types.Object, frames: np.ndarray, scene: bpy.types.Scene) -> list[Matrix]:
    before, matrices = scene.frame_current_final, []
    for frame in frames:
        set_frame(scene, frame)
        matrices.append(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world.copy())
    set_frame(scene, before)
    return matrices
