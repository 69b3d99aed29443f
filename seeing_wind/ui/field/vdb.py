"""The field as OpenVDB files, one per frame, written by the OpenVDB that comes with Blender (the `bpy` wheels have none)."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import bpy
import numpy as np

from ...engine.errors import UsageError
from ..scene_units import metres_per_unit
from .samples import COUNT, FORCE, SURE, samples_of

GRIDS = ("force", "confidence")
"""Names of the grids: N/m³ as three floats, and 0..1."""


def available() -> bool:
    """Whether this Blender can write VDB files."""
    return importlib.util.find_spec("openvdb") is not None


def write_vdb(scene: bpy.types.Scene, field: bpy.types.Object, folder: Path) -> list[Path]:
    """Write `wind_0001.vdb` and so on, named by the scene frame from which the force acts, as the field object now stands and blows.

    Grids are as Blender's volume objects take them: cells in scene units, values N/m³ with the field object's strength applied.

    Raises:
        UsageError: when this Blender has no OpenVDB, or the field's values are gone.
    """
    if not available():
        raise UsageError(
            "This Blender has no OpenVDB for Python.", "Export FGA, PLY or NPZ, or use Blender's own build, 4.4 or newer, for VDB."
        )
    import openvdb

    samples = samples_of(field)
    if samples is None:
        raise UsageError(f"The values under {field.name} are gone.", "Load the results again (Reload in the Recover panel).")
    points, counts, force, sure = read_samples(samples)
    turn = np.array(field.matrix_world)
    strength = field.field.strength / field.get("seeing_wind_strength", field.field.strength) * metres_per_unit(scene)
    spacing = (points[-1] - points[0]) / (np.array(counts) - 1)
    matrix = turn @ np.diag([*spacing, 1.0])
    matrix[:3, 3] = turn[:3, :3] @ points[0] + turn[:3, 3]
    # OpenVDB multiplies rows from the left
    transform = openvdb.createLinearTransform(matrix.T.tolist())
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for t in range(len(force)):
        vectors = (strength * force[t] @ turn[:3, :3].T).reshape(*counts, 3)
        grids = [openvdb.Vec3SGrid(), openvdb.FloatGrid()]
        for grid, name, values in zip(grids, GRIDS, (vectors, sure[t].reshape(counts)), strict=True):
            grid.copyFromArray(np.ascontiguousarray(values, dtype=np.float32))
            grid.name, grid.transform = name, transform
        path = folder / f"wind_{field['seeing_wind_frame_start'] + t:04}.vdb"
        openvdb.write(str(path), grids=grids)
        written.append(path)
    return written


def read_samples(samples: bpy.types.Object) -> tuple[np.ndarray, tuple[int, int, int], np.ndarray, np.ndarray]:
    """Places (L, 3) [scene units, the field object's own], counts along x y z, forces (T, L, 3) over the unit, confidence (T, L)."""
    mesh = samples.data
    total = len(mesh.vertices)
    flat = {name: np.empty(3 * total, dtype=np.float32) for name in ("co", FORCE)}
    mesh.vertices.foreach_get("co", flat["co"])
    mesh.attributes[FORCE].data.foreach_get("vector", flat[FORCE])
    sure = np.empty(total, dtype=np.float32)
    mesh.attributes[SURE].data.foreach_get("value", sure)
    nx, ny, nz = (round(count) for count in mesh.attributes[COUNT].data[0].vector)
    size = nx * ny * nz
    places = flat["co"].reshape(-1, 3)[:size].astype(np.float64)
    return places, (nx, ny, nz), flat[FORCE].reshape(-1, size, 3).astype(np.float64), sure.reshape(-1, size)
