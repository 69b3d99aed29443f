"""From the scene to the engine: meshes, pinned vertices and the edit that names them, as files that the worker reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..engine.errors import UsageError
from ..engine.take import Take, toml_text
from .units import metres_per_unit

PINNED_ABOVE = 0.5
"""A vertex is pinned when its weight in the group is above this, as a brush stroke half as strong is meant to."""

EDIT = "edit.toml"


@dataclass(frozen=True)
class ExportedMesh:
    """What was written of one object."""

    path: Path
    vertices: int
    triangles: int
    applied: bool
    """Modifiers changed the number of vertices: the result fits a copy of the evaluated object, not its own mesh."""


def export_mesh(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, path: str | Path) -> ExportedMesh:
    """Write an object as displayed (modifiers applied, world space) as NPZ: `vertices` (V, 3) float64 [m], `triangles` (M, 3) int32.

    Args:
        obj: a mesh object or one that Blender can turn into a mesh.
        depsgraph: evaluated at the frame wanted.
        path: of the NPZ; its folder is made.

    Raises:
        UsageError: when the object has no triangles.
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
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        # a mirrored object would turn its surface inside out
        triangles = triangles[:, ::-1]
    vertices = (local.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]) * metres_per_unit(depsgraph.scene)
    path = Path(path)
    Take(path.parent).write_arrays(path.name, {"vertices": vertices, "triangles": np.ascontiguousarray(triangles)})
    applied = obj.type != "MESH" or len(vertices) != len(obj.data.vertices)
    return ExportedMesh(path, len(vertices), len(triangles), applied)


def pinned_vertices(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, group: str, above: float = PINNED_ABOVE) -> np.ndarray:
    """Indices (n,) int64 of the evaluated mesh's vertices whose weight in a vertex group is above `above`.

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
        pinned = [vertex.index for vertex in mesh.vertices if any(g.group == index and g.weight > above for g in vertex.groups)]
    finally:
        evaluated.to_mesh_clear()
    if not pinned:
        raise UsageError(
            f"No vertex of {obj.name} has a weight above {above:g} in {group!r}.", "Assign the vertices to hold to that group."
        )
    return np.array(pinned, dtype=np.int64)


def export_pins(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, group: str, path: str | Path) -> int:
    """Write `pinned_vertices` as NPY. Returns how many there are."""
    pinned = pinned_vertices(obj, depsgraph, group)
    path = Path(path)
    with Take(path.parent).writing(path.name) as aside:
        np.save(aside, pinned)
    return len(pinned)


def write_edit(folder: str | Path, bodies: list[dict[str, Any]], gravity: tuple[float, float, float] | None, **settings: Any) -> Path:
    """Write `edit.toml`, the engine's description of a re-simulation.

    Args:
        folder: of the file; paths in `bodies` may be relative to it.
        bodies: one mapping per `[[body]]`: name, mesh, material, and what is overridden; None leaves a key out.
        gravity: [m/s²], None for none.
        settings: further keys at the top, such as `field_strength` (a number, or one per frame).
    """
    top = {"gravity": list(gravity) if gravity is not None else [0.0, 0.0, 0.0], **settings}
    kept = [{key: _plain(value) for key, value in body.items() if value is not None} for body in bodies]
    with Take(folder).writing(EDIT) as path:
        path.write_text(
            toml_text({**{key: _plain(value) for key, value in top.items() if value is not None}, "body": kept}), encoding="utf-8"
        )
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
