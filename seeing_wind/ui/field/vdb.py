"""The field as OpenVDB files, one per frame, written by the OpenVDB that comes with Blender (the `bpy` wheels have none).

Also messages and options for any export: in which frames of the scene the field blows, and how it fades.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...engine.conventions import in_units
from ...engine.errors import TakeError, UsageError
from ...engine.take import Take
from ..scene_units import metres_per_unit
from .display import LOOP, blows_from_to, openvdb_available, share, stride_of
from .field_object import SOLVER_DELAY
from .samples import read_samples, rows_at, samples_of
from .texture.reach import FADE, reach_of

UNITS = {"force": "N/m3", "velocity": "m/s", "confidence": "1"}
"""The grids, and their unit in the metadata. Blender uses a grid of the name `velocity` for the motion blur of volumes."""
CLASSES = {"force": "covariant", "velocity": "contravariant relative"}
"""OpenVDB's types of vectors, which state how they transform with the volume."""
FLAT = 1e-6
"""Share of its volume below which a field object counts as scaled to zero."""


def write_vdb(scene: bpy.types.Scene, field: bpy.types.Object, folder: Path) -> list[Path]:
    """Write `wind_0002.vdb` and so on, one per scene frame in `frames_of`, as the field object now stands and blows.

    A volume object that shows file N in scene frame N is then in step with the solvers. The values are the engine's, on its lattice.
    Cells are in scene units, values in N/m³ and, if the field has a wind, m/s, with the field object's strength and reach applied;
    each grid states its unit.

    Raises:
        UsageError: when this Blender has no OpenVDB, or the field's values are gone.
        TakeError: when a file cannot be written; files written before it are kept.
    """
    if not openvdb_available():
        raise UsageError(
            "This Blender has no OpenVDB for Python.", "Export FGA, PLY or NPZ, or use Blender's own build, 4.4 or newer, for VDB."
        )
    import openvdb

    samples = samples_of(field)
    if samples is None:
        raise UsageError(f"The values under {field.name} are gone.", "Load the results again (Reload in the Recover panel).")
    sampled = read_samples(samples)
    points, counts, force = sampled.points, sampled.counts, sampled.force
    left = sampled.left(reach_of(field["seeing_wind_reach"], sampled.box))[..., None]
    wind = None if sampled.velocity is None else sampled.velocity * left
    known = {"force": force * left, "velocity": wind, "confidence": sampled.confidence}
    turn = np.array(field.matrix_world)
    strength = share(field) * metres_per_unit(scene)
    spacing = (points[-1] - points[0]) / (np.array(counts) - 1)
    matrix = turn @ np.diag([*spacing, 1.0])
    matrix[:3, 3] = turn[:3, :3] @ points[0] + turn[:3, 3]
    if abs(np.linalg.det(matrix[:3, :3])) < FLAT * np.prod(spacing):
        raise UsageError(f"{field.name} is scaled to nothing along some axis.", "Set its scale to 1 (Alt S).")
    # OpenVDB uses row vectors, which multiply the matrix from the left
    transform = openvdb.createLinearTransform(matrix.T.tolist())
    folder.mkdir(parents=True, exist_ok=True)
    written, frames = [], frames_of(scene, field)
    for frame, t in zip(frames, rows_at(field, np.array(frames) - 0.5 * SOLVER_DELAY, len(force)), strict=True):
        grids: list[tuple[Any, np.ndarray]] = []
        for name, rows in known.items():
            if rows is None:
                continue
            if name in CLASSES:
                grid, values = openvdb.Vec3SGrid(), (strength * rows[t] @ turn[:3, :3].T).reshape(*counts, 3)
                grid["vector_type"] = CLASSES[name]
            else:
                grid, values = openvdb.FloatGrid(), rows[t].reshape(counts)
            values = np.ascontiguousarray(values, dtype=np.float32)
            grid.copyFromArray(values)
            grid.name, grid.transform, grid.gridClass = name, transform, openvdb.GridClass.FOG_VOLUME
            grid["unit"] = UNITS[name]
            grids.append((grid, values))
        written.append(write_file(folder / f"wind_{frame:04}.vdb", grids, openvdb))
    return written


def frames_of(scene: bpy.types.Scene, field: bpy.types.Object, loops: bool = True) -> range:
    """The scene frames in which solvers feel a field: those of its clip at its present speed; if it loops, up to the scene's end.

    Args:
        loops: if False, the first cycle only, even of a field that loops.
    """
    first, last = blows_from_to(field)
    if loops and field[LOOP] and max(first, scene.frame_start) < scene.frame_end:
        first, last = max(first, scene.frame_start), scene.frame_end
    return range(first + SOLVER_DELAY, last + SOLVER_DELAY)


def said_of_frames(scene: bpy.types.Scene, frames: range) -> str:
    """A message on which scene frames the files are for, and whether the scene plays none of them."""
    none = frames[-1] < scene.frame_start or frames[0] > scene.frame_end
    beside = f", none of which the scene plays: it lasts from {scene.frame_start} to {scene.frame_end}"
    return f"frames {frames[0]} to {frames[-1]}" + beside * none


def said_of_clip_frames(scene: bpy.types.Scene, field: bpy.types.Object, frames: range) -> str:
    """The same for files with one clip frame each, and how long a clip frame lasts."""
    lasts = stride_of(field)
    return said_of_frames(scene, frames) + (f"; each of its own lasts {lasts:.4g} of these" if lasts != 1.0 else "")


def name_beside(take: Path) -> Path:
    """Where an export goes beside its take, ending in `_wind`, or `_field` if the take's name contains "wind" already."""
    return take.with_name(f"{take.stem}_field" if "wind" in take.stem.lower() else f"{take.stem}_wind")


def faded(scene: bpy.types.Scene, field: bpy.types.Object) -> list[str]:
    """The option of `export` for the fade that solvers feel here, as in the VDB files; none for a field that does not fade, which is whole
    in its box."""
    reach = reach_of(field["seeing_wind_reach"], np.array([vertex.co[:] for vertex in field.data.vertices]))
    return ["--fade", f"{reach.width * metres_per_unit(scene):.9g}"] if reach.kind == FADE else []


def write_file(path: Path, grids: Sequence[tuple[Any, np.ndarray]], vdb: Any) -> Path:
    """Write grids into a file and read it back: OpenVDB may leave a truncated or empty file without an error, as on a full disk.

    Args:
        grids: each with its array of values, starting at the cell (0, 0, 0).
        vdb: the module `openvdb`.

    Raises:
        TakeError: when the file cannot be written, or not read back correctly; a former file at `path` is untouched.
    """
    with Take(path.parent).writing(path.name) as aside:
        try:
            vdb.write(str(aside), grids=[grid for grid, _ in grids])
        except Exception as error:  # OpenVDB raises many types, as for a truncated file
            raise TakeError(f"OpenVDB cannot write {path}: {_reason(error, aside, path)}.", _where_room_is(path.parent)) from error
        try:
            read = {grid.name: grid for grid in vdb.readAll(str(aside))[0]}
            wrong = [grid.name for grid, values in grids if grid.name not in read or not _holds(read[grid.name], values)]
        except Exception as error:
            said = f"{path} was written, but OpenVDB cannot read it again: {_reason(error, aside, path)}."
            raise TakeError(said, _where_room_is(path.parent)) from error
        if wrong:
            raise TakeError(f"{path} was written, but does not hold what it should of {', '.join(wrong)}.", _where_room_is(path.parent))
    return path


def _reason(error: Exception, aside: Path, path: Path) -> str:
    """OpenVDB's message on a file, with the path that the user gave."""
    return str(error).replace(str(aside), str(path)).strip().rstrip(".") or type(error).__name__


def _where_room_is(folder: Path) -> str:
    """A hint for a file that was written wrongly. A full disk is one possible cause, so the hint states the free space if it is known."""
    try:
        free = f"{in_units(shutil.disk_usage(folder).free, 'B')} are free on that disk: make room if that is too little"
    except OSError:
        free = "Make room if that disk is full"
    return f"{free}, or choose another folder; the last good files are kept."


def _holds(grid: Any, values: np.ndarray) -> bool:
    found = np.full_like(values, np.nan)
    grid.copyToArray(found)
    return np.array_equal(found, values)
