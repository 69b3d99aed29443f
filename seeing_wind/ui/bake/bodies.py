"""Bake the motion of re-simulated bodies: onto their own object where possible, else onto a copy that replaces it in the scene."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

from ...engine.errors import TakeError
from ...engine.take import Take
from ..edit.resimulate.preview import goes_before
from ..edit.resimulate.request import EditRequest
from ..job import takes
from ..job.take_reading import simulated_motion
from ..scene_units import metres_per_unit
from . import rigid as bake_rigid
from .animation import set_frame
from .at_rest import at_rest, reshaped
from .motion import allowed, awake_on_top, bake_motion, baked_copy, baked_frames, check_file, clear_bake
from .plan import AUTO, LEFT, STANDS_FOR, TRANSFORM, Baked, Plan, left_in, mark_of, plan_of, stamp_of_bakes

HIDDEN = "seeing_wind_replaced"
"""Custom property of an object that a baked copy stands in for: its own visibility, viewport and render."""


def bake_body(
    scene: bpy.types.Scene, body: bpy.types.PropertyGroup, folder: Path, plan: Plan, force: bool
) -> tuple[bpy.types.Object, Baked]:
    """Bake the simulated motion of one body of the edit. Returns the object that carries it, and how it was baked.

    A copy carries the motion, and the object is hidden, where modifiers change the number of vertices, the user made shape keys, or the
    mesh is shared or linked. The recovered object gets a copy too, since its own motion is that of the clip.

    Args:
        folder: of the re-simulation's take; a point cache goes there too.
        plan: how to bake; its rate, cache and stamp are filled in here.
        force: bake again even if nothing has changed.

    Raises:
        TakeError: when the re-simulation has no such body, or the object is gone.
        UsageError: as `bake_motion`.
    """
    source, vertices, plan = _asked(scene, body, folder, plan, force)
    obj = _carrier(scene, body, source, vertices, plan)
    return obj, bake_motion(obj, vertices, plan, scene)


def _asked(
    scene: bpy.types.Scene, body: bpy.types.PropertyGroup, folder: Path, plan: Plan, force: bool
) -> tuple[bpy.types.Object, np.ndarray, Plan]:
    """The body's source object, its vertices (T+1, V, 3) in the world [m], and the complete plan. Arguments and errors as `bake_body`."""
    take, settings = Take(folder), scene.seeing_wind
    arrays = simulated_motion(take, body.result)
    vertices, fps = arrays["vertices"] + np.asarray(settings.offset), float(arrays["fps"])
    source = settings.recovered_object if body.is_recovered else body.object
    if source is None or scene not in source.users_scene:
        raise TakeError(f"The object of {body.called} is gone.", "Take it off the list, or undo its deletion.")
    smooth = 0 if arrays.get("shell", False) else plan.smooth  # a shell is simulated at its own vertices: its ripples are real
    plan = dataclasses.replace(plan, fps=fps, cache=take.file(f"bodies/{body.result}"), smooth=smooth)
    plan = dataclasses.replace(plan, reshaped=not body.is_recovered and _reshaped(source, vertices, plan, scene))
    if not force:
        plan = dataclasses.replace(plan, stamp=_stamp(vertices, plan, metres_per_unit(scene), stamp_of_bakes(scene)))
    return source, vertices, plan


def _reshaped(source: bpy.types.Object, vertices: np.ndarray, plan: Plan, scene: bpy.types.Scene) -> bool:
    """`reshaped`, called only where location and rotation keyframes are possible, since it plays through the scene."""
    asked = plan.way in (AUTO, TRANSFORM) and not bake_rigid.obstacle(source, mark_of(source) or {})
    return asked and reshaped(source, scene, baked_frames(len(vertices), plan, scene)[1])


def _refuse_what_fails(scene: bpy.types.Scene, body: bpy.types.PropertyGroup, folder: Path, plan: Plan) -> None:
    """Raise what `bake_body` would raise before any body is changed, so that an error in one body leaves all others untouched."""
    source, vertices, plan = _asked(scene, body, folder, plan, force=True)
    if not body.is_recovered and _fits(scene, source, vertices, plan):
        allowed(source, vertices, plan, scene)
    else:  # it will be baked onto a copy
        baked_frames(len(vertices), plan, scene)
        check_file(plan)


def clear_body(body: bpy.types.PropertyGroup) -> bool:
    """Remove the baked motion of one body: restore its object, and remove the copy that replaced it. Returns whether there was any."""
    copied = body.baked_copy is not None
    _remove_copy(body)
    source = None if body.is_recovered else body.object
    return (source is not None and clear_bake(source)) or copied


def _stamp(vertices: np.ndarray, plan: Plan, unit: float, rate: str) -> str:
    return hashlib.sha256(vertices.tobytes() + repr((plan, unit)).encode() + rate.encode()).hexdigest()[:16]


def _carrier(
    scene: bpy.types.Scene, body: bpy.types.PropertyGroup, source: bpy.types.Object, vertices: np.ndarray, plan: Plan
) -> bpy.types.Object:
    """The object to bake onto: `source`, or a copy made now or by a former bake."""
    if not body.is_recovered and _fits(scene, source, vertices, plan):
        _remove_copy(body)
        return source
    copy = body.baked_copy
    if copy is not None and copy.name in scene.objects and len(copy.data.vertices) == vertices.shape[1]:
        return copy
    _remove_copy(body)
    at = scene.frame_current_final
    scene.frame_set(scene.seeing_wind.frame_start)
    try:
        if body.is_recovered:
            copy = baked_copy(source, bpy.context.evaluated_depsgraph_get(), f"{source.name} Simulated", _home(scene, source))
        else:
            with at_rest(source, scene) as still:
                copy = baked_copy(still, bpy.context.evaluated_depsgraph_get(), f"{source.name} Simulated", _home(scene, source))
            _repeat_subdivision(source, copy)
            _hide(source)
    finally:
        set_frame(scene, at)
    body.baked_copy = copy
    return copy


def _fits(scene: bpy.types.Scene, obj: bpy.types.Object, vertices: np.ndarray, plan: Plan) -> bool:
    """Whether the motion can be baked onto the object itself."""
    if obj.library is not None:
        return False
    if plan.way == TRANSFORM:
        return True
    mark = mark_of(obj) or {}
    if plan.way == AUTO and not bake_rigid.obstacle(obj, mark):
        fit = bake_rigid.fit_for(obj, vertices, plan.reshaped, mark, metres_per_unit(scene))
        if fit is not None and fit.residual <= plan.rigid_tolerance * fit.size:
            return True
    keyed = obj.data.shape_keys is not None and mark_of(obj) is None
    shared = obj.data.users > 1 or obj.data.library is not None
    return not keyed and not shared and len(obj.data.vertices) == vertices.shape[1]


def _home(scene: bpy.types.Scene, obj: bpy.types.Object) -> bpy.types.Collection:
    """A local collection of this scene that holds the object, else the scene's own collection."""
    ours = {scene.collection, *scene.collection.children_recursive}
    return next((each for each in obj.users_collection if each in ours and each.library is None), scene.collection)


def _repeat_subdivision(source: bpy.types.Object, copy: bpy.types.Object) -> None:
    """Add to the copy the subdivision modifiers that stay on top of the motion."""
    if mark_of(source) is not None:
        return
    for name in reversed(awake_on_top(source)):
        former, new = source.modifiers[name], copy.modifiers.new(name, "SUBSURF")
        for setting in ("subdivision_type", "levels", "render_levels", "quality", "show_viewport", "show_render"):
            setattr(new, setting, getattr(former, setting))


def _hide(obj: bpy.types.Object) -> None:
    if obj.library is None and HIDDEN not in obj:
        obj[HIDDEN] = [int(obj.hide_viewport), int(obj.hide_render)]
        obj.hide_viewport = obj.hide_render = True


def _remove_copy(body: bpy.types.PropertyGroup) -> None:
    """Remove the copy that replaced a body's object, and show that object again."""
    copy, body.baked_copy = body.baked_copy, None
    _remove_stand_in(copy, body.object)


def _remove_stand_in(copy: bpy.types.Object | None, source: bpy.types.Object | None) -> None:
    if source is not None and HIDDEN in source:
        source.hide_viewport, source.hide_render = (bool(value) for value in source[HIDDEN])
        del source[HIDDEN]
    if copy is None:
        return
    clear_bake(copy)
    mesh = copy.data
    bpy.data.objects.remove(copy)
    if mesh.users == 0:
        bpy.data.meshes.remove(mesh)


def bake_bodies(
    scene: bpy.types.Scene, name: str = "", force: bool = False, preview: bool | None = None
) -> list[tuple[bpy.types.Object, Baked]]:
    """Bake all bodies of the last re-simulation, or only the body called `name`, or whose object is.

    Args:
        force: bake again even if nothing has changed.
        preview: whether to bake the preview's motion or the full result's; None bakes the preview's where `goes_before` prefers it.

    Raises:
        TakeError: when nothing is simulated yet, the re-simulation has been replaced or is incomplete, or the object of a body is gone.
        UsageError: as `bake_motion`.
    """
    settings = scene.seeing_wind
    bodies = [body for body in settings.bodies if body.result]
    if not bodies:
        raise TakeError("Nothing is simulated yet.", "Run Re-simulate first.")
    if preview is None:
        preview = goes_before(scene, EditRequest.of(scene).digest())
    folder = takes.simulated(settings, preview)
    if not folder.is_dir():
        raise TakeError(f"There is no folder {folder}.", "Put it back, or run Re-simulate again.")
    noted = settings.coarse_stamp if preview else settings.simulated_stamp
    if noted and takes.stamp_of(folder, "resimulate") != noted:
        raise TakeError(f"{folder} has another motion by now: another version of this file simulated its own.", "Run Re-simulate again.")
    chosen = _named(bodies, name)
    missing = [body.called for body in chosen if not (folder / "bodies" / f"{body.result}.npz").is_file()]
    if missing:
        raise TakeError(f"{folder} holds no motion of {', '.join(missing)}.", "Run Re-simulate again.")
    plan = dataclasses.replace(plan_of(scene), preview=preview)
    for body in chosen:
        _refuse_what_fails(scene, body, folder, plan)
    done = [bake_body(scene, body, folder, plan, force) for body in chosen]
    if len(chosen) == len(bodies):
        settings.baked_digest = (settings.coarse_digest if preview else settings.simulated_digest) + stamp_of_bakes(scene)
    return done


def clear_bodies(scene: bpy.types.Scene, name: str) -> int:
    """Remove the baked motion of all bodies, or of the one called `name`; if no body has any, of objects whose bodies have left the list.
    Returns the number of bodies cleared."""
    settings, left = scene.seeing_wind, [obj for obj in left_in(scene) if name in ("", obj.name, _stands_for(obj))]
    cleared = 0 if name and left else sum(clear_body(body) for body in _named(list(settings.bodies), name))
    settings.baked_digest = ""
    if cleared:
        return cleared
    for obj in left:
        if STANDS_FOR in obj:
            _remove_stand_in(obj, obj[STANDS_FOR])
        else:
            clear_bake(obj)
            del obj[LEFT]
    return len(left)


def _stands_for(copy: bpy.types.Object) -> str:
    source = copy.get(STANDS_FOR)
    return source.name if source is not None else ""


def _named(bodies: Sequence[bpy.types.PropertyGroup], name: str) -> list[bpy.types.PropertyGroup]:
    if not name:
        return list(bodies)
    found = [body for body in bodies if name == body.name or (body.object is not None and body.object.name == name)]
    if not found:
        raise TakeError(f"{name!r} is not simulated.", "Insert it and run Re-simulate first.")
    return found
