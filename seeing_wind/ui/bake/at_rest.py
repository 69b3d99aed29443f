"""An object without its bake, or with it, as a temporary copy where the object itself will not do."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy
import numpy as np

from ..scene_mesh import COPY_OF
from .animation import set_frame
from .motion import awake_on_top, clear_bake
from .plan import mark_of


@contextlib.contextmanager
def at_rest(obj: bpy.types.Object, scene: bpy.types.Scene, whole: bool = False) -> Iterator[bpy.types.Object]:
    """An object without any bake and, unless `whole`, without the modifiers that act on top of a simulated motion.

    Yields the object itself where that is the case already; else a temporary copy, so that the object keeps its keyframes and visibility.
    A hidden object, or one in a hidden collection, is copied too, since Blender evaluates neither its modifiers nor its transform.
    """
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    on_top = [] if whole else awake_on_top(obj)
    if mark_of(obj) is None and not on_top and obj.visible_get():
        yield obj
        return
    with _passing_copy(obj, scene) as copy:
        for name in on_top:
            copy.modifiers[name].show_viewport = False
        clear_bake(copy)
        yield copy


@contextlib.contextmanager
def as_shown(obj: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """An object with everything that moves it, including a bake; a temporary copy of a hidden one, which Blender does not evaluate."""
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    if obj.visible_get():
        yield obj
        return
    with _passing_copy(obj, scene) as copy:
        yield copy


def reshaped(obj: bpy.types.Object, scene: bpy.types.Scene, frames: np.ndarray) -> bool:
    """Whether an object's own modifiers or shape keys, not those of a bake, change its shape in object space over these scene frames."""
    before = scene.frame_current_final
    try:
        with at_rest(obj, scene) as still:
            if not any(modifier.show_viewport for modifier in still.modifiers) and still.data.shape_keys is None:
                return False
            first = _shape(still, scene, frames[0])
            near = 1e-5 * float(np.ptp(first, axis=0).max(initial=0.0))
            shapes = (_shape(still, scene, frame) for frame in frames[1:])
            return any(shape.shape != first.shape or np.abs(shape - first).max(initial=0.0) > near for shape in shapes)
    finally:
        set_frame(scene, before)


def _shape(obj: bpy.types.Object, scene: bpy.types.Scene, frame: float) -> np.ndarray:
    """Evaluated vertices (V, 3) in object space at a scene frame."""
    set_frame(scene, frame)
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    found = np.empty((len(mesh.vertices), 3), dtype=np.float32)
    mesh.vertices.foreach_get("co", found.reshape(-1))
    return found


@contextlib.contextmanager
def _passing_copy(obj: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    copy = own_copy(obj)
    copy.hide_viewport, copy[COPY_OF] = False, obj.name
    scene.collection.objects.link(copy)
    try:
        yield copy
    finally:
        discard(copy)


def own_copy(obj: bpy.types.Object) -> bpy.types.Object:
    """A copy of a mesh object with its own mesh and animation, not yet linked to a collection."""
    copy = obj.copy()
    copy.data = obj.data.copy()
    for owner in (copy, copy.data.shape_keys):
        data = owner.animation_data if owner is not None else None
        if data is not None and data.action is not None:
            # a copy shares its original's keyframes; clearing a bake on it must not clear theirs
            slot = data.action_slot.identifier if data.action_slot is not None else ""
            data.action = data.action.copy()
            if slot:
                data.action_slot = next(each for each in data.action.slots if each.identifier == slot)
    return copy


def discard(obj: bpy.types.Object) -> None:
    """Remove a copy made by `own_copy` with its mesh and keyframes."""
    mesh = obj.data
    owners = [obj, mesh.shape_keys] if mesh.shape_keys is not None else [obj]
    actions = [owner.animation_data.action for owner in owners if owner.animation_data is not None]
    bpy.data.objects.remove(obj)
    if mesh.users == 0:
        bpy.data.meshes.remove(mesh)
    for action in actions:
        if action is not None and action.users == 0:
            bpy.data.actions.remove(action)
