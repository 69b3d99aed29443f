"""Asking a field at many points, and writing it for other programs: NPZ, PLY and FGA."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from ..errors import MissingPackage, TakeError, UsageError
from .force_field import ForceField

FORMATS = ("npz", "ply", "fga", "vdb")
NODES = 24
"""Lattice nodes along the box's longest side."""


def sample_points(field: ForceField, points: np.ndarray, frame: int | None = None) -> dict[str, np.ndarray]:
    """Force density and confidence at points of one frame, or at points of every frame.

    Args:
        points: (N, 3) [m] with `frame`, or (T, N, 3), one row per frame, without.

    Returns:
        force_density (N, 3) or (T, N, 3) [N/m³] and confidence (N,) or (T, N).

    Raises:
        UsageError: for a shape that does not fit, or as `ForceField.sample`.
    """
    points = np.asarray(points)
    if not np.issubdtype(points.dtype, np.number):
        raise UsageError(f"Points must be numbers in metres, not {points.dtype}.")
    if frame is not None:
        if points.ndim != 2:
            raise UsageError(f"With a frame, points must have shape (N, 3), not {points.shape}.")
        force, confidence = field.sample(points, frame)
        return {"force_density": force, "confidence": confidence}
    if points.ndim != 3 or len(points) != field.frames:
        raise UsageError(f"Points of every frame must have shape ({field.frames}, N, 3), not {points.shape}.", "Or name one frame.")
    rows = [field.sample(points[t], t) for t in range(field.frames)]
    return {"force_density": np.stack([row[0] for row in rows]), "confidence": np.stack([row[1] for row in rows])}


def sample_file(field: ForceField, points_file: str | PathLike[str], frame: int | None = None) -> dict[str, np.ndarray]:
    """`sample_points` for points in an NPY file.

    Raises:
        UsageError: when the file cannot be read as plain numbers.
    """
    try:
        points = np.load(points_file, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise UsageError(f"{points_file} cannot be read as points: {error}.", "Save them with numpy.save, shape (N, 3) or (T, N, 3).") from error
    if not isinstance(points, np.ndarray):
        raise UsageError(f"{points_file} is no NPY file.", "Save the points with numpy.save.")
    return sample_points(field, points, frame)


def lattice(box: np.ndarray, nodes: int = NODES) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Points (M, 3) [m] of a regular lattice over the box, x fastest, and its node counts along x, y, z (at least 2 each)."""
    side = box[1] - box[0]
    x, y, z = (max(2, round(float(length / side.max()) * (nodes - 1)) + 1) for length in side)
    axes = [np.linspace(box[0][axis], box[1][axis], count) for axis, count in enumerate((x, y, z))]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return grid.transpose(2, 1, 0, 3).reshape(-1, 3), (x, y, z)


def export(field: ForceField, kind: str, out: str | PathLike[str], nodes: int = NODES) -> list[Path]:
    """Sample the field on a lattice over its box and write it.

    Args:
        kind: npz: one file with points (M, 3), shape (3,), force_density (T, M, 3), confidence (T, M), fps, box.
            ply: a folder with one point cloud per frame, frame_0000.ply: x y z, fx fy fz [N/m³], confidence.
            fga: a folder with one vector field per frame for Unreal and its kin; its centimetres, and its Y turned (left-handed).
        out: the file (npz) or the folder (ply, fga), which is made.
        nodes: lattice nodes along the longest side.

    Returns:
        The files written.

    Raises:
        UsageError: for an unknown format. MissingPackage: for VDB without its library. TakeError: when `out` cannot be written.
    """
    if kind not in FORMATS:
        raise UsageError(f"There is no export format {kind}.", f"Use one of {', '.join(FORMATS)}.")
    if kind == "vdb":
        raise MissingPackage(
            "Writing VDB needs OpenVDB's Python module, which the engine's environment lacks and PyPI does not offer.",
            "Export npz or ply, or read field.safetensors in Blender, whose own Python has OpenVDB.",
        )
    out, (points, shape) = Path(out), lattice(field.box, nodes)
    try:
        if kind == "npz":
            return [_write_npz(field, points, shape, out)]
        out.mkdir(parents=True, exist_ok=True)
        write = _write_ply if kind == "ply" else _write_fga
        return [write(field, points, shape, frame, out / f"frame_{frame:04d}.{kind}") for frame in range(field.frames)]
    except OSError as error:
        raise TakeError(f"Cannot write {out}: {error.strerror or error}.", "Free some space or choose another place.") from error


def _write_npz(field: ForceField, points: np.ndarray, shape: tuple[int, int, int], path: Path) -> Path:
    path = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
    path.parent.mkdir(parents=True, exist_ok=True)
    values = sample_points(field, np.broadcast_to(points, (field.frames, *points.shape)))
    np.savez_compressed(path, points=points, shape=np.array(shape), fps=np.array(field.fps), box=field.box, **values)
    return path


def _write_ply(field: ForceField, points: np.ndarray, shape: tuple[int, int, int], frame: int, path: Path) -> Path:
    force, confidence = field.sample(points, frame)
    names = ("x", "y", "z", "fx", "fy", "fz", "confidence")
    header = ["ply", "format binary_little_endian 1.0", f"comment force density in N/m3, frame {frame} at {field.fps:g} per second"]
    header += [f"element vertex {len(points)}", *(f"property float {name}" for name in names), "end_header"]
    table = np.concatenate([points, force, confidence[:, None]], axis=1).astype("<f4")
    path.write_bytes(("\n".join(header) + "\n").encode("ascii") + table.tobytes())
    return path


def _write_fga(field: ForceField, points: np.ndarray, shape: tuple[int, int, int], frame: int, path: Path) -> Path:
    # FGA: counts, lower corner, upper corner, then vectors with x fastest. A mirrored Y runs its rows backwards.
    force, _ = field.sample(points, frame)
    mirror = np.array([1.0, -1.0, 1.0])
    force = force.reshape(shape[2], shape[1], shape[0], 3)[:, ::-1].reshape(-1, 3) * mirror
    low, high = 100 * field.box[0], 100 * field.box[1]
    corners = [[low[0], -high[1], low[2]], [high[0], -low[1], high[2]]]
    lines = [",".join(str(count) for count in shape) + ","]
    lines += [",".join(f"{value:.6g}" for value in row) + "," for row in [*corners, *force.tolist()]]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path
