"""Import of meshes from files."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...engine.errors import UsageError
from ..job.worker import said_by

IMPORTERS = {".obj": "obj_import", ".ply": "ply_import", ".stl": "stl_import"}


def import_meshes(path: str) -> list[bpy.types.Object]:
    """Import an OBJ, PLY or STL file into the scene and return its mesh objects. Raises UsageError for a file that cannot be imported."""
    importer = IMPORTERS.get(Path(path).suffix.lower())
    if importer is None:
        raise UsageError(f"{path} is no OBJ, PLY or STL file.", "Import it by File > Import and insert the selected object.")
    if not Path(path).is_file():
        raise UsageError(f"There is no file {path}.", "Choose another one.")
    before = set(bpy.data.objects)
    try:
        getattr(bpy.ops.wm, importer)(filepath=path)
    except RuntimeError as error:
        raise UsageError(f"Blender cannot import {path}: {said_by(error)}.", "Choose another file.") from error
    return [obj for obj in bpy.data.objects if obj not in before and obj.type == "MESH"]
