"""Sampling a field at many points, and exporting it for other programs: NPZ, PLY and FGA."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from ..errors import UsageError
from ..progress import NoProgress, Progress
from ..reading import read_array
from ..take import Take
from .force_field import ForceField

POINTS = "Save them with numpy.save in metres: (N, 3) with a frame, or (T, N, 3), one row per frame."
FORMATS = ("npz", "ply", "fga", "vdb")
NODES = 24
"""Default number of lattice nodes along the box's longest side."""


def sample_points(
    field: ForceField, points: np.ndarray, frame: int | None = None, progress: Progress = NoProgress()
) -> tuple[np.ndarray, np.ndarray]:
    """Force density and confidence at points of one frame, or at points of every frame.

    Args:
        points: (N, 3) [m] with `frame`, or (T, N, 3), one row per frame, without.

    Returns:
        Force density (N, 3) or (T, N, 3) [N/m³] and confidence (N,) or (T, N).

    Raises:
        UsageError: for a shape that does not fit, or as `ForceField.sample`.
    """
    points = _checked(field, points, frame)
    if frame is not None:
        return field.sample(points, frame)
    forces, confidences = np.zeros(points.shape), np.zeros(points.shape[:2])
    for t in range(field.frames):
        forces[t], confidences[t] = field.sample(points[t], t)
        progress.update((t + 1) / field.frames, "sampling")
    return forces, confidences


def distances(field: ForceField, points: np.ndarray, frame: int | None = None) -> np.ndarray:
    """Distance of points from the filmed object, (N,) or (T, N) [m]; arguments and errors as in `sample_points`."""
    points = _checked(field, points, frame)
    if frame is not None:
        return field.away(points, frame)[0]
    return np.stack([field.away(row, t)[0] for t, row in enumerate(points)])


def _checked(field: ForceField, points: np.ndarray, frame: int | None) -> np.ndarray:
    points = np.asarray(points)
    if not np.issubdtype(points.dtype, np.number) or np.iscomplexobj(points):
        raise UsageError(f"Points must be real numbers in metres, not {points.dtype}.", POINTS)
    if frame is not None and points.ndim != 2:
        raise UsageError(f"With a frame, points must have shape (N, 3), not {points.shape}.", POINTS)
    if frame is None and (points.ndim != 3 or len(points) != field.frames):
        raise UsageError(f"Points of every frame must have shape ({field.frames}, N, 3), not {points.shape}.", "Or name one frame.")
    return points


def read_points(path: str | PathLike[str]) -> np.ndarray:
    """Points from an NPY file.

    Raises:
        UsageError: when the file cannot be read as plain numbers.
    """
    try:
        return read_array(path)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read as points: {error}.", POINTS) from error


def lattice(box: np.ndarray, nodes: int = NODES) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Points (M, 3) [m] of a regular lattice over the box, x fastest, and its node counts along x, y, z (at least 2 each)."""
    side = box[1] - box[0]
    x, y, z = (max(2, round(float(length / side.max()) * (nodes - 1)) + 1) for length in side)
    axes = [np.linspace(box[0][axis], box[1][axis], count) for axis, count in enumerate((x, y, z))]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return grid.transpose(2, 1, 0, 3).reshape(-1, 3), (x, y, z)


def export_field(
    field: ForceField,
    kind: str,
    out: str | PathLike[str],
    progress: Progress = NoProgress(),
    nodes: int = NODES,
    wind: ForceField | None = None,
) -> list[Path]:
    """Sample the field on a lattice over its box and write it.

    Args:
        kind: npz: one file with points (M, 3) [m], shape (3,), force_density (T, M, 3), confidence (T, M), fps, box.
            ply: a folder with one point cloud per frame, frame_0000.ply: x y z [m], fx fy fz [N/m³], confidence.
            fga: a folder with one vector field per frame for Unreal and its kin, in their centimetres and with Y turned (left-handed).
        out: the file (npz) or the folder (ply, fga), which is made.
        nodes: lattice nodes along the longest side.
        wind: the same take's wind on the same lattice: in npz as wind_velocity and wind_confidence, in ply as ux uy uz and
            wind_confidence, in fga as wind_0000.fga and so on, each vector in m/s.

    Returns:
        The files written.

    Raises:
        UsageError: for an unknown format, a path without a name, a file where the folder should be, and for VDB, whose library is not
            available here.
        TakeError: when `out` cannot be written.
    """
    if kind not in FORMATS:
        raise UsageError(f"There is no export format {kind}.", f"Use one of {', '.join(FORMATS)}.")
    if kind == "vdb":
        raise UsageError(
            "Writing VDB needs OpenVDB's Python module, which the engine's environment lacks and PyPI does not offer.",
            "Export npz or ply, or read field.safetensors in Blender, whose own Python has OpenVDB.",
        )
    out, (points, shape) = Path(out), lattice(field.box, nodes)
    if kind == "npz":
        if not out.name:
            raise UsageError(f"'{out}' is not a file's name.", "--out must be a path such as field.npz.")
        values = sample_points(field, np.broadcast_to(points, (field.frames, *points.shape)), None, progress)
        name = out.name if out.suffix == ".npz" else out.name + ".npz"
        arrays = {"points": points, "shape": np.array(shape), "force_density": values[0], "confidence": values[1]}
        if wind is not None:
            at = np.broadcast_to(points, (wind.frames, *points.shape))
            arrays["wind_velocity"], arrays["wind_confidence"] = sample_points(wind, at, None, progress)
        Take(out.parent).write_arrays(name, {**arrays, "fps": np.array(field.fps), "box": field.box})
        return [out.with_name(name)]
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out} is there already and is not a folder, and {kind} is one file per frame.", "--out must be a folder's path.")
    folder, files = Take(out), []
    for frame in range(field.frames):
        contents = {f"frame_{frame:04d}.{kind}": _ply(field, points, frame, wind) if kind == "ply" else _fga(field, points, shape, frame)}
        if wind is not None and kind == "fga":
            contents[f"wind_{frame:04d}.{kind}"] = _fga(wind, points, shape, frame)
        for name, content in contents.items():
            with folder.writing(name) as path:
                path.write_bytes(content)
            files.append(folder.file(name))
        progress.update((frame + 1) / field.frames, files[-1].name)
    return files


def _ply(field: ForceField, points: np.ndarray, frame: int, wind: ForceField | None) -> bytes:
    force, confidence = field.sample(points, frame)
    names, columns = ["x", "y", "z", "fx", "fy", "fz", "confidence"], [points, force, confidence[:, None]]
    header = ["ply", "format binary_little_endian 1.0", f"comment force density in N/m3, frame {frame} at {field.fps:g} per second"]
    if wind is not None:
        velocity, sure = wind.sample(points, frame)
        names += ["ux", "uy", "uz", "wind_confidence"]
        columns += [velocity, sure[:, None]]
        header.append("comment ux uy uz: velocity of the air in m/s")
    header += [f"element vertex {len(points)}", *(f"property float {name}" for name in names), "end_header"]
    table = np.concatenate(columns, axis=1).astype("<f4")
    return ("\n".join(header) + "\n").encode("ascii") + table.tobytes()


def _fga(field: ForceField, points: np.ndarray, shape: tuple[int, int, int], frame: int) -> bytes:
    # FGA: counts, lower corner, upper corner, then vectors with x fastest. As Y is mirrored, its rows are reversed.
    force, _ = field.sample(points, frame)
    mirror = np.array([1.0, -1.0, 1.0])
    force = force.reshape(shape[2], shape[1], shape[0], 3)[:, ::-1].reshape(-1, 3) * mirror
    low, high = 100 * field.box[0], 100 * field.box[1]
    corners = [[low[0], -high[1], low[2]], [high[0], -low[1], high[2]]]
    lines = [",".join(str(count) for count in shape) + ","]
    lines += [",".join(f"{value:.6g}" for value in row) + "," for row in [*corners, *force.tolist()]]
    return ("\n".join(lines) + "\n").encode("ascii")
