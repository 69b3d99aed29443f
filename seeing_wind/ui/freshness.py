"""Which steps are done, and which are stale as their settings have changed since. Runs after changes, undos and loads, never in `draw`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import bpy
from bpy.app.handlers import persistent

from ..engine.conventions import PANEL_INPUTS
from ..engine.errors import SeeingWindError
from .bake.plan import stamp_of_bakes
from .clip.object.options import object_options
from .clip.object.preview import foreseen_digest, preview_digest
from .clip.options import clip_options
from .edit.resimulate.geometry import forget_geometry
from .edit.resimulate.preview import digest_of_preview, goes_before, shown_as_preview
from .edit.resimulate.request import EditRequest
from .edit.sheet_label import measure
from .job import status
from .job.takes import simulated, stamp_of, take_folder
from .recover.request import RecoverRequest, scene_values
from .scene_units import learn_units

T = TypeVar("T")
OVERTAKEN = "Another version of this file has simulated its own since"


def refresh(scene: bpy.types.Scene) -> None:
    """Bring the status of `scene` up to date with its settings."""
    settings, now = scene.seeing_wind, status.of(scene.session_uid)
    _name_as_objects(settings)
    measure(scene)
    values, take = scene_values(settings), take_folder(settings)
    clip = _attempt(now, "clip", lambda: clip_options(settings, values), bool(settings.clip))
    begun = any(settings.box) or settings.object_mode != "BOX"
    marked = _attempt(now, "object", lambda: object_options(settings, values, take / PANEL_INPUTS), begun)
    lacking = f"{now.steps['clip'].message} {now.steps['object'].message}"  # used in place of a digest
    status.derive(now, "preview", preview_digest(clip, marked) if clip and marked else lacking, settings.previewed_digest)
    now.foreseen = bool(clip and marked) and foreseen_digest(values, clip, marked) == settings.foreseen_digest
    recover = RecoverRequest.from_parts(scene, values, take, clip, marked).digest() if clip and marked else lacking
    edit = EditRequest.of(scene).digest()
    status.derive(now, "recover", recover, settings.recovered_digest)
    status.derive(now, "edit", edit, edit, _count(settings))
    overtaken = now.overtaken != "" and now.overtaken == settings.simulated_stamp
    said = f"{OVERTAKEN}: run it again" if overtaken else ""
    status.derive(now, "resimulate", edit, OVERTAKEN if overtaken else settings.simulated_digest, said)
    preview = digest_of_preview(scene, edit)
    status.derive(now, status.EDIT_PREVIEW, preview, settings.coarse_digest)
    shown = preview if goes_before(scene, edit) else edit
    status.derive(now, "bake", edit and shown + stamp_of_bakes(scene), settings.baked_digest)
    now.previewed = shown_as_preview(scene)


def refresh_all() -> None:
    """Bring the status of all scenes up to date."""
    for scene in bpy.data.scenes:
        refresh(scene)


def _attempt(now: status.SceneStatus, step: str, gather: Callable[[], T], started: bool) -> T | None:
    """Set the status of a step that is done as soon as its settings are valid; before the user has begun with it, it is idle, not failed.

    Returns the result of `gather`, None if it raised an error.
    """
    try:
        gathered = gather()
        now.steps[step] = status.Step(status.State.DONE)
        return gathered
    except SeeingWindError as error:
        state = status.State.FAILED if started else status.State.IDLE
        now.steps[step] = status.Step(state, message=error.message if started else error.hint, hint=error.hint if started else "")
        return None


def _name_as_objects(settings: bpy.types.PropertyGroup) -> None:
    """Store the present names of bodies and colliders, so that the list still shows the last name of an object that is gone."""
    for each in (*settings.bodies, *settings.colliders):
        if each.name != each.called:
            each.name = each.called


def _count(settings: bpy.types.PropertyGroup) -> str:
    count = len(settings.bodies)
    return "" if not count else "1 body" if count == 1 else f"{count} bodies"


# -- when Blender changes the data without a property's update --------------------------------------------------------------------


@persistent
def _after_undo(*_: object) -> None:
    forget_geometry()
    refresh_all()


@persistent
def _after_load(*_: object) -> None:
    status.forget_all()
    forget_geometry()
    for scene in bpy.data.scenes:
        learn_units(scene)
        if len(scene.seeing_wind.bodies):  # their places are known only after Blender has evaluated them
            scene.view_layers[0].update()
        _see_what_was_overtaken(scene)
    refresh_all()
    for scene in bpy.data.scenes:
        _say_what_was_cut_off(scene)


def _see_what_was_overtaken(scene: bpy.types.Scene) -> None:
    """Note if another version of the file, or another Blender, has simulated its own edit into the folder since this file was saved."""
    settings = scene.seeing_wind
    if not settings.simulated_stamp:
        return
    try:
        folder = simulated(settings)
        if folder.is_dir() and stamp_of(folder, "resimulate") != settings.simulated_stamp:
            status.of(scene.session_uid).overtaken = settings.simulated_stamp
    except SeeingWindError:  # damaged or missing: reported where the motion is needed
        return


def _say_what_was_cut_off(scene: bpy.types.Scene) -> None:
    """Set a message if the file was saved while a job ran: its worker ended with that Blender, but its finished stages are in the take."""
    step, now = scene.seeing_wind.unfinished, status.of(scene.session_uid)
    if step in now.steps:
        title = {"resimulate": "Re-simulate", status.EDIT_PREVIEW: "Preview"}.get(step, step.capitalize())
        now.steps[step].message = f"{title} was running when this file was saved. Run it again: it goes on from what was finished"


@persistent
def _after_edit(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None = None, *_: object) -> None:
    # moving an inserted object, or a mask, track or camera that Recover has read, changes none of this extension's properties
    settings = scene.seeing_wind
    if len(settings.bodies) or settings.recovered_digest or settings.previewed_digest:
        if depsgraph is None or any(update.is_updated_geometry for update in depsgraph.updates):
            forget_geometry()
        refresh(scene)


HANDLERS = (("undo_post", _after_undo), ("redo_post", _after_undo), ("load_post", _after_load), ("depsgraph_update_post", _after_edit))


def register() -> None:
    """Attach the handlers, once, and let the features request a refresh."""
    unregister()
    status.refreshers.append(refresh)
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Detach the handlers, including those of an earlier registration."""
    status.refreshers.clear()
    for name, handler in HANDLERS:
        handlers = getattr(bpy.app.handlers, name)
        for present in [
            h for h in handlers if getattr(h, "__qualname__", "") == handler.__qualname__ and h.__module__ == handler.__module__
        ]:
            handlers.remove(present)
