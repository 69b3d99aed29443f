"""Field objects that were duplicated: Blender's copy reads the texture of its original, and turns with it. It gets one of its own.

A wind that was dragged or appended from the library, without an operator of ours, gets its arrows in the same way. What belonged to a copy
or to such a wind goes when it is deleted.
"""

from __future__ import annotations

import contextlib

import bpy
from bpy.app.handlers import persistent

from ..display import CARRIED, KIND, WITH_FIELD, has_lost_field, is_field, lacks_arrows, stride_of


def copies_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Field objects of a scene whose values stand under another one."""
    return [obj for obj in scene.objects if _is_copy(obj)]


def _is_copy(obj: bpy.types.Object) -> bool:
    if not is_field(obj) or obj.library is not None or obj.override_library is not None:
        return False
    carried = obj.get(CARRIED)
    return carried is not None and carried.parent is not None and carried.parent != obj and is_field(carried.parent)


def make_independent(field: bpy.types.Object) -> None:
    """Give a copied field object values and a texture of its own; its place, and its strength relative to the recovered one, stay."""
    from ..conform import set_stride  # needs NumPy, as do these
    from ..field_object import SOLVER_DELAY, make_again
    from ..samples import create_samples, read_samples

    values = read_samples(field[CARRIED])
    field.data = field.data.copy()
    field[CARRIED] = create_samples(field, values, int(field["seeing_wind_frame_start"]), SOLVER_DELAY)
    field[CARRIED][WITH_FIELD] = True
    set_stride(field, stride_of(field))
    make_again(field, field["seeing_wind_reach"], field[KIND])


def _make_all_independent() -> float | None:
    """Of every scene, once Blender is out of the operator that made the copies; seconds to wait where they are still being moved."""
    from ...recover.renew_in_place import discard
    from .arrows import show_arrows  # needs NumPy

    windows = bpy.context.window_manager.windows
    if any(operator.bl_idname.startswith("TRANSFORM_") for window in windows for operator in window.modal_operators):
        return 0.2
    for scene in bpy.data.scenes:
        for field in copies_in(scene) if scene.library is None else ():
            with contextlib.suppress(ReferenceError):
                make_independent(field)
        for field in [obj for obj in scene.objects if lacks_arrows(obj)] if scene.library is None else ():
            show_arrows(scene, field)
        for left in [obj for obj in scene.objects if has_lost_field(obj, scene)] if scene.library is None else ():
            discard(left)
    return None


@persistent
def _after_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None = None, *_: object) -> None:
    updates = depsgraph.updates if depsgraph is not None else ()
    changed = (update.id.original for update in updates if isinstance(update.id, bpy.types.Object))
    due = any(_is_copy(obj) or lacks_arrows(obj) for obj in changed)
    if any(isinstance(update.id, (bpy.types.Scene, bpy.types.Collection)) for update in updates):  # something may have been deleted
        due = due or any(has_lost_field(obj, scene) for obj in scene.objects)
    if due and not bpy.app.timers.is_registered(_make_all_independent):
        # not at once: Blender allows no new data while it evaluates
        bpy.app.timers.register(_make_all_independent, first_interval=0.0)


def register() -> None:
    """Attach the handler, once."""
    unregister()
    bpy.app.handlers.depsgraph_update_post.append(_after_change)


def unregister() -> None:
    """Detach it."""
    for handler in [each for each in bpy.app.handlers.depsgraph_update_post if getattr(each, "__module__", "") == __name__]:
        bpy.app.handlers.depsgraph_update_post.remove(handler)
    if bpy.app.timers.is_registered(_make_all_independent):
        bpy.app.timers.unregister(_make_all_independent)
