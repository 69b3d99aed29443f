"""From the scene to the engine: meshes, pinned vertices and the edit that names them, as files that the worker reads."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...engine.errors import UsageError
from ...engine.settings import toml_text
from ...engine.take import Take
from ..bake.bake import awake_on_top, clear_bake, mark_of
from ..units import metres_per_unit

FIRM = 0.999
"""A vertex of this weight or more is held firmly; of less, drawn back like a spring."""

THINNEST = 1e-6
"""Smallest scale of an object relative to its largest: under it no keyframes in its own space could move it in the world."""

EDIT = "edit.toml"


@dataclass(frozen=True)
class ExportedMesh:
    """What was written of one object."""

    path: Path
    vertices: int
    triangles: int
    applied: bool
    """Modifiers changed the number of vertices: the result fits a copy of the evaluated object, not its own mesh."""


def export_mesh(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, path: str | Path, shift: Sequence[float] = (0.0, 0.0, 0.0)
) -> ExportedMesh:
    """Write an object as displayed (modifiers applied, world space) as NPZ: `vertices` (V, 3) float64 [m], `triangles` (M, 3) int32.

    Args:
        obj: a mesh object or one that Blender can turn into a mesh.
        depsgraph: evaluated at the frame wanted.
        path: of the NPZ; its folder is made.
        shift: (3,) added to the vertices [m].

    Raises:
        UsageError: when the object has no triangles, or vertices that are not finite.
    """
    vertices, triangles = mesh_arrays(obj, depsgraph)
    if not np.isfinite(vertices).all():
        raise UsageError(f"{obj.name} has vertices that are nowhere (not a number).", "Delete them, or the modifier that makes them.")
    vertices = vertices * metres_per_unit(depsgraph.scene) + np.asarray(shift)
    path = Path(path)
    Take(path.parent).write_arrays(path.name, {"vertices": vertices, "triangles": triangles})
    applied = obj.type != "MESH" or len(vertices) != len(obj.data.vertices)
    return ExportedMesh(path, len(vertices), len(triangles), applied)


def mesh_arrays(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[np.ndarray, np.ndarray]:
    """An object as displayed: vertices (V, 3) float64 in the world, in the scene's units, and triangles (M, 3) int32, normals outwards.

    Raises:
        UsageError: when the object has no triangles, or a scale of 0.
    """
    evaluated = obj.evaluated_get(depsgraph)
    try:
        mesh = evaluated.to_mesh()
    except RuntimeError as error:
        raise UsageError(f"{obj.name} has no geometry.", "Choose a mesh object.") from error
    try:
        mesh.calc_loop_triangles()
        local = np.empty((len(mesh.vertices), 3), dtype=np.float32)
        triangles = np.empty((len(mesh.loop_triangles), 3), dtype=np.int32)
        mesh.vertices.foreach_get("co", local.reshape(-1))
        mesh.loop_triangles.foreach_get("vertices", triangles.reshape(-1))
    finally:
        evaluated.to_mesh_clear()
    if len(triangles) == 0:
        raise UsageError(f"{obj.name} has no faces.", "Choose a mesh with a surface.")
    matrix = np.array(evaluated.matrix_world)
    stretch = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    if not stretch[-1] > THINNEST * stretch[0]:
        raise UsageError(f"{obj.name} has a scale of 0.", "Give it another scale, or apply it (Object > Apply > Scale).")
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        # a mirrored object would turn its surface inside out
        triangles = triangles[:, ::-1]
    return local.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3], np.ascontiguousarray(triangles)


def pinned_vertices(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, group: str) -> tuple[np.ndarray, np.ndarray]:
    """Indices (n,) int64 of the evaluated mesh's vertices in a vertex group, and their weights (n,) in 0..1; those of weight 0 left out.

    Raises:
        UsageError: when there is no such group, or no vertex in it.
    """
    vertex_group = obj.vertex_groups.get(group)
    if vertex_group is None:
        raise UsageError(
            f"{obj.name} has no vertex group {group!r}.", "Make one in Properties > Data > Vertex Groups and assign the vertices to hold."
        )
    index, evaluated = vertex_group.index, obj.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    try:
        found = [(vertex.index, g.weight) for vertex in mesh.vertices for g in vertex.groups if g.group == index and g.weight > 0.0]
    finally:
        evaluated.to_mesh_clear()
    if not found:
        raise UsageError(f"No vertex of {obj.name} has a weight in {group!r}.", "Assign the vertices to hold to that group.")
    return np.array([vertex for vertex, _ in found], dtype=np.int64), np.array([weight for _, weight in found], dtype=np.float64)


def export_pins(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, group: str, path: str | Path) -> tuple[int, Path | None]:
    """Write the vertices of `pinned_vertices` as NPY. Returns how many there are, and where their weights are (None: all firm)."""
    pinned, weights = pinned_vertices(obj, depsgraph, group)
    return len(pinned), write_pins(path, pinned, weights)


def write_pins(path: str | Path, pinned: np.ndarray, weights: np.ndarray) -> Path | None:
    """Write indices (n,) as NPY, and weights (n,) beside them as NAME.weights.npy (its path is returned) unless all hold firmly."""
    path = Path(path)
    write_array(path, pinned)
    if (weights >= FIRM).all():
        return None
    beside = path.with_name(f"{path.stem}.weights.npy")
    write_array(beside, np.where(weights >= FIRM, 1.0, weights))
    return beside


def write_array(path: Path, array: np.ndarray) -> None:
    """Write an NPY, aside and renamed."""
    with Take(path.parent).writing(path.name) as aside:
        np.save(aside, array)


@contextlib.contextmanager
def at_rest(obj: bpy.types.Object, scene: bpy.types.Scene, whole: bool = False) -> Iterator[bpy.types.Object]:
    """An object as it is before any bake and, unless it is wanted whole, without the modifiers that act on top of a simulated motion.

    The object itself where it is so already; else a passing copy, so that neither its keyframes nor its visibility are touched. What is
    hidden, or in a collection that is, gets a copy too: Blender evaluates neither modifiers nor place of it.
    """
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    on_top = [] if whole else awake_on_top(obj)
    if mark_of(obj) is None and not on_top and obj.visible_get():
        yield obj
        return
    copy = own_copy(obj)
    for name in on_top:
        copy.modifiers[name].show_viewport = False
    copy.hide_viewport = False
    scene.collection.objects.link(copy)
    try:
        clear_bake(copy)
        yield copy
    finally:
        discard(copy)


def own_copy(obj: bpy.types.Object) -> bpy.types.Object:
    """A copy of a mesh object with mesh and animation of its own, not linked to any collection yet."""
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
    """Remove an object of `own_copy` with its mesh and keyframes."""
    mesh = obj.data
    owners = [obj, mesh.shape_keys] if mesh.shape_keys is not None else [obj]
    actions = [owner.animation_data.action for owner in owners if owner.animation_data is not None]
    bpy.data.objects.remove(obj)
    if mesh.users == 0:
        bpy.data.meshes.remove(mesh)
    for action in actions:
        if action is not None and action.users == 0:
            bpy.data.actions.remove(action)


def write_edit(
    folder: str | Path,
    bodies: list[dict[str, Any]],
    gravity: tuple[float, float, float] | None,
    colliders: Sequence[dict[str, Any]] = (),
    **settings: Any,
) -> Path:
    """Write `edit.toml`, the engine's description of a re-simulation.

    Args:
        folder: of the file; paths in `bodies` may be relative to it.
        bodies: one mapping per `[[body]]`: name, mesh, material, and what is overridden; None leaves a key out.
        gravity: [m/s²], None for none.
        colliders: one mapping per `[[collider]]`.
        settings: further keys at the top, such as `field_strength` (a number, or one per frame).
    """
    top = {"gravity": list(gravity) if gravity is not None else [0.0, 0.0, 0.0], **settings}
    tables = {"body": bodies, "collider": colliders}
    kept = {
        name: [{key: _plain(value) for key, value in each.items() if value is not None} for each in table] for name, table in tables.items()
    }
    with Take(folder).writing(EDIT) as path:
        plain = {key: _plain(value) for key, value in top.items() if value is not None}
        path.write_text(toml_text(plain | {name: table for name, table in kept.items() if table or name == "body"}), encoding="utf-8")
    return Path(folder) / EDIT


def _plain(value: Any) -> Any:
    """Blender's and NumPy's arrays, and paths, as TOML has them."""
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (str, bool, int, float, dict)):
        return value
    return [_plain(item) for item in value]
