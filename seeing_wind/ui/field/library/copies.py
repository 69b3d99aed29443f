"""Duplicated field objects: Blender's copy reads the texture of its original and turns with that, so it is given a texture of its own.

A wind that was dragged or appended from the library without one of this extension's operators gets its arrows in the same way. Every field
that was appended from a scene of another unit is converted. When a copy or such a wind is deleted, what belonged to it is removed. With a
window, all this happens shortly after the change; under `blender -b`, at the next frame; and in both cases when a file is opened or an
operator needs it.
"""

from __future__ import annotations

import contextlib

import bpy
from bpy.app.handlers import persistent

from ...scene_units import may_convert
from ..display import ARROWS, CARRIED, KIND, SLOWS, WITH_FIELD, has_lost_field, is_field, lacks_arrows, stride_of


def copies_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Field objects of a scene whose values belong to another field object."""
    return [obj for obj in scene.objects if _is_copy(obj)]


def _is_copy(obj: bpy.types.Object) -> bool:
    if not is_field(obj) or obj.library is not None or obj.override_library is not None:
        return False
    carried = obj.get(CARRIED)
    return carried is not None and carried.parent is not None and carried.parent != obj and is_field(carried.parent)


def make_independent(field: bpy.types.Object) -> None:
    """Give a copied field object values and a texture of its own; its place and its strength relative to the recovered one are kept."""
    from ..conform import set_stride  # needs NumPy, as do the next two
    from ..field_object import SOLVER_DELAY, make_again
    from ..samples import create_samples, read_samples

    values = read_samples(field[CARRIED])
    field.data = field.data.copy()
    field[CARRIED] = create_samples(field, values, int(field["seeing_wind_frame_start"]), SOLVER_DELAY)
    field[CARRIED][WITH_FIELD] = True
    set_stride(field, stride_of(field))
    make_again(field, field["seeing_wind_reach"], field[KIND])


def mend(scene: bpy.types.Scene) -> None:
    """Make every copied field independent, convert those of another unit, and remove what deleted fields have left: the still air of a wind
    would slow whatever moves."""
    copied, left = copies_in(scene), [obj for obj in scene.objects if has_lost_field(obj, scene)]
    foreign = [obj for obj in scene.objects if is_field(obj) and may_convert(obj, scene)]
    if scene.library is not None or not (copied or left or foreign):
        return
    from ...recover.renew_in_place import discard
    from ..solvers.apart import keep_apart

    for field in copied:
        with contextlib.suppress(ReferenceError):
            make_independent(field)
    for field in foreign:
        _convert(field, scene)
    for obj in left:
        if SLOWS not in obj:
            discard(obj)
    keep_apart(scene)


def _convert(field: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Convert a field to the scene's unit, with the arrows that it has."""
    from ...recover.renew_in_place import discard
    from ..field_object import convert_unit  # need NumPy
    from .arrows import show_arrows

    convert_unit(field, scene)
    arrows = field.get(ARROWS)
    if arrows is not None and arrows.parent == field:
        discard(arrows)
        show_arrows(scene, field)


def _mend_all() -> float | None:
    """Timer: mend every scene once the operator that made the copies has ended. Returns seconds to wait while a transform still runs."""
    from .arrows import show_arrows  # needs NumPy

    windows = bpy.context.window_manager.windows
    if any(operator.bl_idname.startswith("TRANSFORM_") for window in windows for operator in window.modal_operators):
        return 0.2
    for scene in bpy.data.scenes:
        mend(scene)
        for field in [obj for obj in scene.objects if lacks_arrows(obj)] if scene.library is None else ():
            show_arrows(scene, field)
    return None


@persistent
def _before_frame(scene: bpy.types.Scene, *_: object) -> None:
    if bpy.app.background:  # timers do not run there
        mend(scene)


@persistent
def _after_load(*_: object) -> None:
    from ..solvers.apart import keep_apart

    for scene in bpy.data.scenes:
        mend(scene)
        if scene.library is None:
            keep_apart(scene)


@persistent
def _after_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None = None, *_: object) -> None:
    updates = depsgraph.updates if depsgraph is not None else ()
    changed = (update.id.original for update in updates if isinstance(update.id, bpy.types.Object))
    due = any(_is_copy(obj) or lacks_arrows(obj) or (is_field(obj) and may_convert(obj, scene)) for obj in changed)
    if any(isinstance(update.id, (bpy.types.Scene, bpy.types.Collection)) for update in updates):  # something may have been deleted
        due = due or any(has_lost_field(obj, scene) for obj in scene.objects)
    if due and not bpy.app.timers.is_registered(_mend_all):
        # deferred: Blender allows no new data during an evaluation
        bpy.app.timers.register(_mend_all, first_interval=0.0)


HANDLERS = (("depsgraph_update_post", _after_change), ("frame_change_pre", _before_frame), ("load_post", _after_load))


def register() -> None:
    """Attach the handlers, once."""
    unregister()
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Detach the handlers, including those of an earlier registration."""
    for name, _ in HANDLERS:
        handlers = getattr(bpy.app.handlers, name)
        for present in [each for each in handlers if getattr(each, "__module__", "") == __name__]:
            handlers.remove(present)
    if bpy.app.timers.is_registered(_mend_all):
        bpy.app.timers.unregister(_mend_all)
