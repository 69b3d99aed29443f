"""Which step is done, and which is stale because its settings have changed since. Runs on a change, an undo and a load, never in `draw`."""

from __future__ import annotations

import hashlib
import os

import bpy
from bpy.app.handlers import persistent

from ..engine.errors import SeeingWindError
from . import status, worker_calls


def recover_digest(scene: bpy.types.Scene) -> str:
    """Of everything that `recover` depends on. Raises as `worker_calls.recover_options` does."""
    options = worker_calls.recover_options(scene)
    files = [os.stat(option) for option in options if os.path.isabs(option) and os.path.isfile(option)]
    return _digest(options, [(entry.st_size, entry.st_mtime_ns) for entry in files])


def edit_digest(scene: bpy.types.Scene) -> str:
    """Of everything that `resimulate` depends on: the field, and the bodies as they stand. "" while there are no bodies."""
    settings = scene.seeing_wind
    bodies = [_body(body) for body in settings.bodies if body.is_recovered or body.object is not None]
    if not bodies:
        return ""
    gravity = tuple(settings.edit_gravity) if settings.edit_gravity_mode == "CUSTOM" else settings.edit_gravity_mode
    return _digest(settings.recovered_digest, settings.recovered_take, bodies, settings.field_strength, gravity, settings.contact)


def refresh(scene: bpy.types.Scene) -> None:
    """Bring the status of `scene` up to date with its settings."""
    settings, now = scene.seeing_wind, status.of(scene.session_uid)
    _attempt(now, "clip", lambda: worker_calls.clip_options(settings), bool(settings.clip))
    _attempt(now, "object", lambda: worker_calls.object_options(settings), any(settings.box) or bool(settings.mask))
    try:
        recover = recover_digest(scene)
    except SeeingWindError:
        recover = "incomplete"
    edit = edit_digest(scene)
    status.derive(now, "recover", recover, settings.recovered_digest)
    status.derive(now, "edit", edit, edit, _count(settings))
    status.derive(now, "resimulate", edit, settings.simulated_digest)
    status.derive(now, "bake", edit, settings.baked_digest)


def refresh_all() -> None:
    """All scenes."""
    for scene in bpy.data.scenes:
        refresh(scene)


def _attempt(now: status.SceneStatus, step: str, gather, started: bool) -> None:
    """A step that is done as soon as its settings make sense; nothing is said while the user has not begun with it."""
    try:
        gather()
        now.steps[step] = status.Step(status.State.DONE)
    except SeeingWindError as error:
        state = status.State.FAILED if started else status.State.IDLE
        now.steps[step] = status.Step(state, message=error.message if started else error.hint, hint=error.hint if started else "")


def _count(settings: bpy.types.PropertyGroup) -> str:
    count = len(settings.bodies)
    return "" if not count else "1 body" if count == 1 else f"{count} bodies"


def _body(body: bpy.types.PropertyGroup) -> tuple:
    shape = ()
    if body.object is not None and body.object.type == "MESH":
        rest = [round(value, 5) for row in body.object.matrix_world for value in row]
        shape = (body.object.session_uid, len(body.object.data.vertices), tuple(rest))
    numbers = (body.mass_scale, body.start_frame, body.use_density and body.density, body.use_youngs_modulus and body.youngs_modulus)
    return (body.is_recovered, shape, body.material, *numbers, body.pin_group, tuple(body.velocity) if body.use_velocity else None)


def _digest(*parts: object) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


# -- when Blender changes the data without a property's update --------------------------------------------------------------------


@persistent
def _after_undo(*_: object) -> None:
    refresh_all()


@persistent
def _after_load(*_: object) -> None:
    status.forget_all()
    refresh_all()


@persistent
def _after_edit(scene: bpy.types.Scene, *_: object) -> None:
    # Moving or deleting an inserted object changes no property of ours.
    if len(scene.seeing_wind.bodies):
        refresh(scene)


HANDLERS = (("undo_post", _after_undo), ("redo_post", _after_undo), ("load_post", _after_load), ("depsgraph_update_post", _after_edit))


def register() -> None:
    """Attach the handlers, once."""
    unregister()
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Detach the handlers, also those of a former registration."""
    for name, handler in HANDLERS:
        handlers = getattr(bpy.app.handlers, name)
        for present in [
            h for h in handlers if getattr(h, "__qualname__", "") == handler.__qualname__ and h.__module__ == handler.__module__
        ]:
            handlers.remove(present)
