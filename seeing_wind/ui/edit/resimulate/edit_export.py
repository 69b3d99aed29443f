"""The edit of a scene as the files that `resimulate` reads: edit.toml, one mesh and one list of pinned vertices per body."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ....engine.conventions import GRAVITY
from ....engine.errors import TakeError, UsageError
from ....engine.materials import SHEETS
from ....engine.record_arrays import from_arrays
from ....engine.records import Attachment
from ....engine.take import Take
from ...bake.animation import set_frame, values_over
from ...bake.at_rest import as_shown, at_rest
from ...job.take_reading import FieldSummary, field_summary
from ...job.takes import own
from ...option_properties import single
from ...scene_mesh import has_inside, mesh_arrays, name_of, pinned_vertices, refuse_no_sheet, solid_arrays
from ...scene_units import metres_per_unit
from .edit_files import export_mesh, export_pins, write_array, write_edit, write_pins
from .field_place import present_field, said_of_field, standing
from .force_fields import force_fields, left_out
from .further_fields import export_further_fields
from .further_forces import further_forces
from .geometry import may_move, seen_in_place_of
from .preview import COARSENESS, frames_seen
from .request import Body, EditRequest, Mover

COARSELY = 0.1
"""Interpolation error between the lattice nodes, relative to the size of the forces, above which the user is told."""
STILL = 1e-6
"""Largest displacement [m] of vertices that still count as not moving: single precision."""


def export_edit(
    request: EditRequest, scene: bpy.types.Scene, source: Path, folder: Path, preview: bool
) -> tuple[Path, list[str]]:
    """Write an edit of `scene` into `folder`. Returns the path of its edit.toml, and notes for the user.

    Meshes are written as they are in the clip's first frame, without any bake, in the place where they are simulated (with the edit's
    offset subtracted). For a preview, the edit asks for coarser particles, and only for the frames that are played or baked.

    Raises:
        UsageError: no bodies, an object that is gone, an empty vertex group, an open mesh of cloth that is no sheet.
        TakeError: when the take `source` has no recovered object but the edit asks for it.
    """
    if not request.bodies:
        raise UsageError("No mesh is inserted.", "Select a mesh and use Insert Mesh first.")
    at = scene.frame_current_final
    scene.frame_set(request.frame_start)
    try:
        field = field_summary(Take(source))
        frames = scene_frames(scene, field.frames + 1, field.fps)
        bodies = [_body(body, request, scene, source, folder, frames) for body in request.bodies]
        colliders, notes = _colliders(request, scene, folder, frames)
        stands = standing(present_field(scene), scene, field.box, frames, request.metres)
        others = export_further_fields(scene, folder, frames, field.fps, request.metres)
    finally:
        set_frame(scene, at)
    notes += said_of_field(scene) + left_out(scene)
    forces, said = _forces(request, scene, field, folder, bodies, frames)
    values = request.values | stands.ends | {
        "field_strength": _strengths(scene, field, stands.share), "field_place": _place(stands.place, folder), "forces": forces,
    }  # fmt: skip
    if preview:
        values |= {"coarseness": COARSENESS, "frames": frames_seen(scene, frames[1] - frames[0])}
    written = write_edit(folder, bodies, _gravity(request, source), colliders, own(scene.seeing_wind), others, **values)
    return written, notes + said


def refuse_unfit(objects: Sequence[bpy.types.Object], scene: bpy.types.Scene, collide: bool = False, sheet: bool = False) -> None:
    """Raise UsageError for the first of `objects` that Re-simulate could not write: one without area or with non-finite vertices; with
    `collide`, also a collider without an inside; with `sheet`, for a material that comes as a sheet, also an open mesh that is no sheet.

    Like Re-simulate, it checks the objects in the clip's first frame; the scene is set to that frame only if one of them may move.
    """
    before, first = scene.frame_current_final, scene.seeing_wind.frame_start
    away = before != first and any(may_move(obj) for obj in objects)
    if away:
        scene.frame_set(first)
    try:
        for obj in objects:
            with as_shown(seen_in_place_of(obj, scene), scene) if collide else at_rest(obj, scene) as still:
                arrays = solid_arrays(still, bpy.context.evaluated_depsgraph_get())
                closed = not collide or has_inside(still, bpy.context.evaluated_depsgraph_get())
            if not closed:
                raise UsageError(
                    f"{obj.name} is open, or its faces do not all face the same way, so it has no inside.",
                    "Close its holes, recalculate its normals (Mesh > Normals > Recalculate Outside), or give a sheet a thickness "
                    "(Solidify modifier). For level ground use Floor.",
                )
            if sheet:
                refuse_no_sheet(obj, *arrays)
    finally:
        if away:
            set_frame(scene, before)


def _forces(
    request: EditRequest, scene: bpy.types.Scene, field: FieldSummary, folder: Path, bodies: list[dict[str, Any]], frames: list[float]
) -> tuple[Path | None, list[str]]:
    """Write Blender's own force fields, sampled over the box of the bodies and the field. Returns the file's path, relative to `folder`
    (None without force fields), and notes for the user."""
    fields, path = force_fields(scene), folder / "forces.npz"
    if not fields:
        return None, []
    places = [Take(folder).read_arrays(str(body["mesh"]))["vertices"] for body in bodies if body["mesh"] != "recovered"]
    corners = np.concatenate([field.box, *places])
    found = further_forces(fields, np.stack([corners.min(axis=0), corners.max(axis=0)]), frames, request.metres)
    Take(folder).write_arrays(path.name, found.arrays)
    names = ", ".join(obj.name for obj in fields)
    said = [f"Beside the recovered field, {names} acted, with forces in newtons on each whole body"]
    if found.error > COARSELY:
        error = 100.0 * found.error
        said.append(f"They change faster from place to place than the lattice that they are sampled on: they are about {error:.0f} % off")
    return path.relative_to(folder), said


def _strengths(scene: bpy.types.Scene, field: FieldSummary, share: list[float]) -> float | list[float]:
    """The factor on the field, including the strength of its object: one number, or one per clip frame (T,) if it changes."""
    values = values_over(scene, scene.seeing_wind, "field_strength", scene_frames(scene, field.frames, field.fps))
    both = [one * other for one, other in zip(values * len(share) if len(values) == 1 else values, share, strict=True)]
    wrong = len(both) - int(np.isfinite(both).sum())
    if wrong:
        raise UsageError(
            f"The field's strength is no number in {'all' if wrong == len(both) else wrong} of {len(both)} frames.",
            "Correct Field Strength here and the strength of the field object, with their keyframes and drivers.",
        )
    return single(both[0]) if len(set(both)) == 1 else both


def _place(place: np.ndarray | None, folder: Path) -> Path | None:
    """Write where the field stands. Returns the file's path relative to `folder`; None if the field stands where it was recovered."""
    path = folder / "field_place.npy"
    if place is None:
        return None
    write_array(path, place)
    return path.relative_to(folder)


def scene_frames(scene: bpy.types.Scene, count: int, fps: float) -> list[float]:
    """Scene frames of the clip's first `count` frames."""
    stride = scene.render.fps / scene.render.fps_base / fps if scene.seeing_wind.real_time else 1.0
    return [scene.seeing_wind.frame_start + stride * t for t in range(count)]


def _body(body: Body, request: EditRequest, scene: bpy.types.Scene, source: Path, folder: Path, frames: list[float]) -> dict[str, Any]:
    entry = body.values | {"name": body.result}
    pins = folder / "pins" / f"{body.result}.npy"
    if body.is_recovered:
        return entry | {"mesh": "recovered"} | _holds_of_the_recovered(body, scene, source, folder, pins)
    obj = present(body, scene)
    with at_rest(obj, scene) as still:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        if body.values["material"] in SHEETS:
            refuse_no_sheet(still, *solid_arrays(still, depsgraph))
        mesh = export_mesh(still, depsgraph, folder / "meshes" / f"{body.result}.npz", -np.array(request.offset))
        entry["mesh"] = mesh.relative_to(folder)
        if body.pin_group:
            pinned, weights = export_pins(still, depsgraph, body.pin_group, pins)
            entry["pin"] = pins.relative_to(folder)
            entry["pin_weights"] = weights.relative_to(folder) if weights else None
            way = _way(still, scene, pinned, frames) if may_move(still) else None
            if way is not None:
                path = pins.with_name(f"{body.result}.way.npy")
                write_array(path, way - np.array(request.offset))
                entry["pin_path"] = path.relative_to(folder)
    return entry


def _way(obj: bpy.types.Object, scene: bpy.types.Scene, pinned: np.ndarray, frames: list[float]) -> np.ndarray | None:
    """(T+1, P, 3) positions [m] of pinned vertices in the clip's frames, following what they are tied to; None if they do not move."""
    way = []
    for frame in _visited(scene, frames):
        vertices = mesh_arrays(obj, bpy.context.evaluated_depsgraph_get())[0]
        if len(vertices) <= pinned.max():
            changed = f"{name_of(obj)} has another number of vertices in frame {frame:g}."
            raise UsageError(changed, "Switch off the modifier that changes it.")
        way.append(vertices[pinned] * metres_per_unit(scene))
    return _unless_still(way)


def _visited(scene: bpy.types.Scene, frames: list[float]) -> Iterator[float]:
    """Yield scene frames, each with the scene set to it; afterwards the scene is set to the first again."""
    for frame in frames:
        set_frame(scene, frame)
        yield frame
    set_frame(scene, frames[0])


def _unless_still(way: list[np.ndarray]) -> np.ndarray | None:
    moved = np.stack(way)
    return moved if np.abs(moved - moved[0]).max() > STILL else None


def present(body: Mover, scene: bpy.types.Scene) -> bpy.types.Object:
    """The object of a body or collider. Raises UsageError when the user has deleted it or removed it from the scene."""
    if body.object is None or body.object not in scene.objects.values():
        raise UsageError(f"The object of {body.called} is gone.", "Take it off the list, or undo its deletion.")
    return body.object


def _holds_of_the_recovered(body: Body, scene: bpy.types.Scene, source: Path, folder: Path, pins: Path) -> dict[str, Any]:
    """Entries for the clip's object: which particles are held in addition to those held in the clip, and which are let go."""
    entry: dict[str, Any] = {}
    if body.pin_group:
        particles, weights = _carriers(body.pin_group, scene, source)
        beside = write_pins(pins, particles, weights)
        entry["pin"], entry["pin_weights"] = pins.relative_to(folder), beside.relative_to(folder) if beside else None
    if body.free_mode != "KEEP":
        arrays = Take(source).read_arrays("particles.npz")
        everything = np.arange(len(arrays["particles.x"]), dtype=np.int64)
        free = everything if body.free_mode == "ALL" else _carriers(body.free_group, scene, source)[0]
        path = folder / "pins" / f"{body.result}.free.npy"
        write_array(path, free)
        entry["free"] = path.relative_to(folder)
    return entry


def _carriers(group: str, scene: bpy.types.Scene, source: Path) -> tuple[np.ndarray, np.ndarray]:
    """Indices (n,) of the particles that carry most of the vertices of a group of the recovered object, and their pin weights (n,)."""
    obj = scene.seeing_wind.recovered_object
    if obj is None:
        raise UsageError("The recovered object is gone.", "Load the results again, or undo its deletion.")
    attachment = from_arrays(Attachment, Take(source).read_arrays("particles.npz"), "surface.attachment.")
    vertices, weights = pinned_vertices(obj, bpy.context.evaluated_depsgraph_get(), group)
    index, carries = attachment.index[vertices], attachment.weight[vertices]
    most = carries >= 0.5 * carries.max(axis=1, keepdims=True)
    strongest = np.zeros(int(attachment.index.max()) + 1)
    np.maximum.at(strongest, index[most], np.broadcast_to(weights[:, None], index.shape)[most])
    particles = np.flatnonzero(strongest > 0.0)
    return particles.astype(np.int64), strongest[particles]


def _colliders(
    request: EditRequest, scene: bpy.types.Scene, folder: Path, frames: list[float]
) -> tuple[list[dict[str, Any]], list[str]]:
    """Entries for the colliders, with their motion, and notes on motion that could not be represented."""
    found, notes = [{"name": "floor", **request.floor}] if request.floor is not None else [], []
    for collider in request.colliders:
        obj = present(collider, scene)
        if any(body.object == obj for body in request.bodies):
            raise UsageError(f"{obj.name} is both a body and a collider.", "Take it off one of the two lists.")
        with as_shown(seen_in_place_of(obj, scene), scene) as seen:
            depsgraph = bpy.context.evaluated_depsgraph_get()
            path = export_mesh(seen, depsgraph, folder / "colliders" / f"{collider.result}.npz")
            way, whole = _way_of_mesh(seen, scene, frames) if may_move(seen) else (None, True)
        entry = {"name": collider.result, "mesh": path.relative_to(folder), **collider.values}
        if way is not None:
            beside = path.with_name(f"{collider.result}.way.npy")
            write_array(beside, way)
            entry["mesh_path"] = beside.relative_to(folder)
        if not whole:
            notes.append(f"{obj.name} has another number of vertices in other frames: it moves, but its changes of shape are left out")
        found.append(entry)
    return found, notes


def _way_of_mesh(obj: bpy.types.Object, scene: bpy.types.Scene, frames: list[float]) -> tuple[np.ndarray | None, bool]:
    """Positions (T+1, V, 3) [m] of a mesh's vertices in the clip's frames, None if they do not move; and whether that is all of its motion.

    A mesh whose number of vertices changes keeps its shape of the first frame and follows the motion of the object.
    """
    way, places, whole = [], [], True
    for _ in _visited(scene, frames):
        depsgraph = bpy.context.evaluated_depsgraph_get()
        way.append(mesh_arrays(obj, depsgraph)[0] * metres_per_unit(scene))
        places.append(np.array(obj.evaluated_get(depsgraph).matrix_world))
    if any(len(each) != len(way[0]) for each in way):
        whole = False
        local = np.linalg.inv(places[0]) @ np.column_stack([way[0] / metres_per_unit(scene), np.ones(len(way[0]))]).T
        way = [(place @ local).T[:, :3] * metres_per_unit(scene) for place in places]
    return _unless_still(way), whole


def _gravity(request: EditRequest, source: Path) -> tuple[float, float, float] | None:
    if request.gravity == "NONE":
        return None
    if request.gravity != "SAME":
        return request.gravity
    return recovered_gravity(source)


def recovered_gravity(source: Path) -> tuple[float, float, float]:
    """The gravity [m/s²] that Recover was given in the take `source`. Raises TakeError when it is no vector of three numbers."""
    recovered = Take(source).description().get("stages", {}).get("recover", {}).get("settings", {}).get("gravity", GRAVITY)
    if len(recovered) != 3:
        raise TakeError(f"The gravity in {source} is no vector.", "Run Recover again.")
    return tuple(recovered)
