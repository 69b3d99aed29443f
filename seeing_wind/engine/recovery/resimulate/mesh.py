"""Triangle meshes from OBJ, PLY and NPZ files. Vertices keep the file's order, as pins are vertex indices."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ...conventions import FARTHEST, in_units
from ...errors import MissingPackage, UsageError
from ...reading import LARGEST_ARRAYS, read_arrays, read_text, regular
from ...settings.edit import MESHES

_HINT = "Give an OBJ, a PLY, or an NPZ with vertices (V,3) in metres and triangles (M,3)."


def load_mesh(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """Read a mesh: vertices (V, 3) [m] and triangles (M, 3) int32; larger polygons are cut into fans.

    Nothing in the file is executed: OBJ is read as text, materials are ignored, NPZ is read without pickle.

    Raises:
        UsageError: for a missing file, another format, no triangles, an index out of range, or a vertex that is not finite or beyond
            `FARTHEST`.
        MissingPackage: for a PLY file without the package trimesh.
    """
    path = Path(path)
    if not path.is_file():
        raise UsageError(f"There is no mesh {path}.", _HINT)
    readers = dict(zip(MESHES, (_read_obj, _read_ply, _read_npz), strict=True))
    if path.suffix.lower() not in readers:
        raise UsageError(f"{path.name} has a format that cannot be read.", _HINT)
    vertices, triangles = readers[path.suffix.lower()](path)
    vertices = np.asarray(vertices, dtype=np.float64)
    triangles = np.asarray(triangles)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0:
        raise UsageError(f"{path.name} holds no triangles: vertices {vertices.shape}, triangles {triangles.shape}.", _HINT)
    if not np.issubdtype(triangles.dtype, np.integer):
        raise UsageError(f"{path.name}: triangles are {triangles.dtype}, not whole numbers.", _HINT)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        wrong = int(triangles.min()) if triangles.min() < 0 else int(triangles.max())
        named = f"a triangle names vertex {wrong + 1} of {len(vertices)}, counted from 1" if path.suffix.lower() == ".obj" else ""
        named = named or f"a triangle names vertex {wrong} of {len(vertices)}, counted from 0"
        raise UsageError(f"{path.name}: {named}.", "Export the mesh again.")
    if not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        raise UsageError(f"{path.name}: the position of vertex {bad} is not finite.", "Mend the mesh and export it again.")
    far = float(np.abs(vertices).max())
    if far > FARTHEST:
        raise UsageError(f"{path.name}: a vertex lies {in_units(far, 'm')} from the origin.", "Check the unit and the scale: metres.")
    return vertices, triangles.astype(np.int32)


def _read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The `v` and `f` lines of a Wavefront OBJ. (Libraries split vertices at seams and repeat them per object, which would shift pins.)"""
    vertices: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    at = 0
    try:
        lines = read_text(path).splitlines()
        for at, line in enumerate(lines, 1):  # noqa: B007, the message names the line
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                vertices.append([float(word) for word in words[1:4]])
            elif words[0] == "f":
                corners = [int(word.split("/")[0]) for word in words[1:]]
                corners = [corner - 1 if corner > 0 else len(vertices) + corner for corner in corners]
                triangles += [(corners[0], b, c) for b, c in zip(corners[1:], corners[2:])]
    except (OSError, ValueError) as error:
        where = f"{path.name}, line {at}" if at else path.name
        raise UsageError(f"{where}: {error}.", "Export the mesh again.") from error
    if any(len(vertex) != 3 for vertex in vertices):
        raise UsageError(f"{path.name}: a vertex has fewer than three coordinates.", "Export the mesh again.")
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        import trimesh
    except ModuleNotFoundError as error:
        raise MissingPackage("PLY meshes need the package trimesh.", "Install the engine, or give an OBJ or NPZ.") from error
    try:
        if regular(path) > LARGEST_ARRAYS:
            raise ValueError("it is larger than any mesh that can be simulated")
        # Unprocessed: merged or reordered vertices would move the pins.
        mesh = trimesh.load_mesh(path, file_type="ply", process=False)
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except Exception as error:  # trimesh raises whatever its parser stumbles over
        raise UsageError(f"{path.name} cannot be read as a PLY mesh: {error}.", "Export the mesh again.") from error


def _read_npz(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        data = read_arrays(path, ("vertices", "triangles"))
        missing = [key for key in ("vertices", "triangles") if key not in data]
        if missing:
            raise UsageError(f"{path.name} lacks {' and '.join(missing)}.", _HINT)
        return np.asarray(data["vertices"], dtype=np.float64), data["triangles"]
    except (OSError, ValueError) as error:
        raise UsageError(f"{path.name} cannot be read as an NPZ: {error}.", _HINT) from error
