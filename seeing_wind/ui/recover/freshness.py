"""Which step is done, and which is stale because its settings have changed since. Runs on a change, an undo and a load, never in `draw`."""

from __future__ import annotations

import hashlib
import os
from array import array

import bpy
from bpy.app.handlers import persistent

from ...engine.errors import SeeingWindError
from ..bake import animation, bake
from ..clip import inputs as native
from ..edit import bodies
from ..job import status, worker_calls
from ..units import metres_per_unit


def recover_digest(scene: bpy.types.Scene) -> str:
    """Of everything that `recover` depends on. Raises as `worker_calls.recover_options` does."""
    options = worker_calls.recover_options(scene)
    # files that are made from the scene count by what they are made of
    given = [option for option in options[1:] if os.path.isabs(option) and native.INPUTS not in option and os.path.isfile(option)]
    files = [os.stat(path) for path in (*native.clips.files_of(options[0]), *given)]
    # by name only, so that a project can be moved
    named = [os.path.basename(option) if os.path.isabs(option) else option for option in options]
    return _digest(named, [(entry.st_size, entry.st_mtime_ns) for entry in files], native.stamp(scene))


def edit_digest(scene: bpy.types.Scene) -> str:
    """Of everything that `resimulate` depends on: the field, and the bodies as they stand. "" while there are no bodies."""
    settings = scene.seeing_wind
    moved = [_body(body) for body in settings.bodies if body.is_recovered or body.object is not None]
    if not moved:
        return ""
    gravity = tuple(settings.edit_gravity) if settings.edit_gravity_mode == "CUSTOM" else settings.edit_gravity_mode
    path = settings.path_from_id("field_strength")
    strength = [curve for curve in animation.keyframes(scene) if curve[0] == path] or settings.field_strength
    colliders = [(each.kind, each.friction, _geometry(each.object)) for each in settings.colliders if each.object is not None]
    floor = (settings.floor_height, settings.floor_friction) if settings.use_floor else None
    scene_wide = (strength, gravity, settings.contact, colliders, floor, tuple(settings.offset), metres_per_unit(scene))
    return _digest(settings.recovered_digest, settings.recovered_stamp or settings.recovered_take, moved, *scene_wide)


def refresh(scene: bpy.types.Scene) -> None:
    """Bring the status of `scene` up to date with its settings."""
    settings, now = scene.seeing_wind, status.of(scene.session_uid)
    _attempt(now, "clip", lambda: worker_calls.clip_options(settings), bool(settings.clip))
    _attempt(now, "object", lambda: worker_calls.object_options(settings), any(settings.box) or settings.object_mode != "BOX")
    try:
        recover = recover_digest(scene)
    except SeeingWindError:
        recover = "incomplete"
    edit = edit_digest(scene)
    status.derive(now, "recover", recover, settings.recovered_digest)
    status.derive(now, "edit", edit, edit, _count(settings))
    status.derive(now, "resimulate", edit, settings.simulated_digest)
    status.derive(now, "bake", edit and edit + bodies.stamp_of_bakes(scene), settings.baked_digest)


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
    overrides = [getattr(body, f"use_{name}") and getattr(body, name) for name in ("density", "mass", "youngs_modulus")]
    numbers = (body.mass_scale, body.stiffness_scale, body.start_frame, *overrides)
    velocity = tuple(body.velocity) if body.use_velocity else None
    held = (body.pin_group, body.is_recovered and body.free_mode, body.free_group)
    weights = _weights(body.object, body.pin_group) if body.object is not None and body.pin_group else ""
    return (body.is_recovered, _geometry(body.object), body.material, numbers, held, weights, velocity)


def _geometry(obj: bpy.types.Object | None) -> tuple:
    """Shape and place of a mesh object before any bake: neither playing a bake nor scrubbing changes it."""
    if obj is None or obj.type != "MESH":
        return ()
    # neither name nor session id: the one changes at a renaming, the other whenever the file is opened
    return (len(obj.data.vertices), _once(obj, "", lambda: _coordinates(obj.data)), _place(obj))


def _place(obj: bpy.types.Object) -> list:
    """Where an object stands, the same at every frame; its keyframes where it moves by itself. Those of a bake do not count."""
    mark = bake.mark_of(obj)
    if mark is not None and mark["way"] == "TRANSFORM":
        return _rounded(mark["former"]["world"])
    lineage, moves = [obj], [_keys_of_place(obj)]
    while lineage[-1].parent is not None:
        lineage.append(lineage[-1].parent)
        moves.append(_keys_of_place(lineage[-1]))
    if not any(moves) and not any(each.constraints or each.rigid_body for each in lineage):
        return _rounded(obj.matrix_world)
    return [(keys or _rounded(each.matrix_basis), _rounded(each.matrix_parent_inverse)) for each, keys in zip(lineage, moves)]


def _keys_of_place(obj: bpy.types.Object) -> list:
    return [curve for curve in animation.keyframes(obj) if curve[0].startswith(("location", "rotation", "scale", "delta_"))]


def _rounded(matrix) -> list[float]:
    return [round(value, 5) for row in matrix for value in row]


def _weights(obj: bpy.types.Object, group: str) -> str:
    """Of the weights of a vertex group."""
    found = obj.vertex_groups.get(group)
    if found is None:
        return ""
    return _once(obj, group, lambda: _digest([(v.index, g.weight) for v in obj.data.vertices for g in v.groups if g.group == found.index]))


def _coordinates(mesh: bpy.types.Mesh) -> str:
    flat = array("f", bytes(12 * len(mesh.vertices)))
    mesh.vertices.foreach_get("co", flat)
    return hashlib.sha256(flat.tobytes()).hexdigest()[:16]


_known: dict[tuple[int, str], str] = {}
"""Digests of meshes and weights, by session id: computed once, and again after Blender said that the mesh has changed."""


def _once(obj: bpy.types.Object, what: str, compute) -> str:
    key = (obj.data.session_uid, what)
    if key not in _known:
        _known[key] = compute()
    return _known[key]


def _digest(*parts: object) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


# -- when Blender changes the data without a property's update --------------------------------------------------------------------


@persistent
def _after_undo(*_: object) -> None:
    _known.clear()
    refresh_all()


@persistent
def _after_load(*_: object) -> None:
    status.forget_all()
    _known.clear()
    refresh_all()
    for scene in bpy.data.scenes:
        _say_what_was_cut_off(scene)


def _say_what_was_cut_off(scene: bpy.types.Scene) -> None:
    """The file was saved while a job ran: its worker has ended with that Blender, its finished stages lie in the take."""
    step, now = scene.seeing_wind.unfinished, status.of(scene.session_uid)
    if step in now.steps:
        title = step.replace("resimulate", "re-simulate").capitalize()
        now.steps[step].message = f"{title} was running when this file was saved. Run it again: it goes on from what was finished"


@persistent
def _after_edit(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None = None, *_: object) -> None:
    # Moving or deleting an inserted object changes no property of ours.
    if len(scene.seeing_wind.bodies):
        if depsgraph is None or any(update.is_updated_geometry for update in depsgraph.updates):
            _known.clear()
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
