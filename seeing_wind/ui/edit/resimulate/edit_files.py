"""The files that `resimulate` reads: meshes, lists of pinned vertices, and the edit.toml that names them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ....engine.conventions import EDIT
from ....engine.settings import toml_text
from ....engine.take import Take
from ...scene_mesh import FIRM, pinned_vertices, solid_arrays
from ...scene_units import metres_per_unit


def export_mesh(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, path: str | Path, shift: Sequence[float] = (0.0, 0.0, 0.0)
) -> Path:
    """Write an object as displayed (modifiers applied, world space) as NPZ: `vertices` (V, 3) float64 [m], `triangles` (M, 3) int32.

    Returns the path of the file.

    Args:
        obj: a mesh object or one that Blender can turn into a mesh.
        depsgraph: evaluated at the wanted frame.
        path: of the NPZ; its folder is created.
        shift: (3,) added to the vertices [m].

    Raises:
        UsageError: when the object cannot be simulated, see `solid_arrays`.
    """
    vertices, triangles = solid_arrays(obj, depsgraph)
    vertices = vertices * metres_per_unit(depsgraph.scene) + np.asarray(shift)
    path = Path(path)
    Take(path.parent).write_arrays(path.name, {"vertices": vertices, "triangles": triangles})
    return path


def export_pins(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, group: str, path: str | Path) -> tuple[np.ndarray, Path | None]:
    """Write the vertices of `pinned_vertices` as NPY. Returns their indices (n,), and the path of their weights (None: all firm)."""
    pinned, weights = pinned_vertices(obj, depsgraph, group)
    return pinned, write_pins(path, pinned, weights)


def write_pins(path: str | Path, pinned: np.ndarray, weights: np.ndarray) -> Path | None:
    """Write indices (n,) as NPY. Unless all hold firmly, also write the weights (n,) as NAME.weights.npy beside it and return that path."""
    path = Path(path)
    write_array(path, pinned)
    if (weights >= FIRM).all():
        return None
    beside = path.with_name(f"{path.stem}.weights.npy")
    write_array(beside, np.where(weights >= FIRM, 1.0, weights))
    return beside


def write_array(path: Path, array: np.ndarray) -> None:
    """Write an NPY file under a temporary name, then rename it."""
    with Take(path.parent).writing(path.name) as aside:
        np.save(aside, array)


def write_edit(
    folder: str | Path,
    bodies: list[dict[str, Any]],
    gravity: tuple[float, float, float] | None,
    colliders: Sequence[dict[str, Any]] = (),
    owner: str = "",
    further_fields: Sequence[dict[str, Any]] = (),
    **settings: Any,
) -> Path:
    """Write `edit.toml`, the engine's description of a re-simulation.

    Args:
        folder: where the file is written; paths in `bodies` may be relative to it.
        bodies: one mapping per `[[body]]`: name, mesh, material, and overrides; a value of None leaves its key out.
        gravity: [m/s²], None for no gravity.
        colliders: one mapping per `[[collider]]`.
        owner: the file's first line, see `takes.own`.
        further_fields: one mapping per `[[further_field]]`.
        settings: further keys at the top, such as `field_strength` (a number, or one per frame).
    """
    top = {"gravity": list(gravity) if gravity is not None else [0.0, 0.0, 0.0], **settings}
    tables = {"body": bodies, "collider": colliders, "further_field": further_fields}
    kept = {
        name: [{key: _plain(value) for key, value in each.items() if value is not None} for each in table] for name, table in tables.items()
    }
    with Take(folder).writing(EDIT) as path:
        plain = {key: _plain(value) for key, value in top.items() if value is not None}
        text = toml_text(plain | {name: table for name, table in kept.items() if table or name == "body"})
        path.write_text(f"{owner}\n{text}" if owner else text, encoding="utf-8")
    return Path(folder) / EDIT


def _plain(value: Any) -> Any:
    """Convert paths, NumPy values and Blender's arrays to types that TOML can store."""
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (str, bool, int, float, dict)):
        return value
    return [_plain(item) for item in value]
