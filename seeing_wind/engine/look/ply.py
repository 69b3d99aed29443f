"""Gaussians as a PLY file in the standard layout of 3D Gaussian splatting (Kerbl et al. 2023), which other viewers read.

Binary little endian floats: x y z, nx ny nz (zero), f_dc_0..2, f_rest_* (colour channel by colour channel), opacity (logit),
scale_0..2 (logarithm), rot_0..3 (quaternion w x y z).
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..errors import TakeError
from ..records import Gaussians
from .gaussians import self_attached

OPACITY_MARGIN = 1e-6
"""Opacities 0 and 1 have no finite logit."""


def property_names(bands: int) -> list[str]:
    """The vertex properties, in order, for `bands` spherical harmonics (1 for degree 0, 16 for degree 3)."""
    rest = [f"f_rest_{i}" for i in range(3 * (bands - 1))]
    return [*"xyz", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest, "opacity", "scale_0", "scale_1", "scale_2"] + [
        f"rot_{i}" for i in range(4)
    ]


def write_ply(path: str | os.PathLike[str], gaussians: Gaussians) -> None:
    """Write Gaussians. The attachment to particles is no part of the format."""
    count, bands = gaussians.sh.shape[:2]
    opacity = np.clip(gaussians.opacity, OPACITY_MARGIN, 1.0 - OPACITY_MARGIN)
    columns = [
        gaussians.x,
        np.zeros((count, 3)),
        gaussians.sh[:, 0],
        gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(count, -1),
        np.log(opacity / (1.0 - opacity))[:, None],
        np.log(gaussians.scale),
        gaussians.rotation,
    ]
    rows = np.ascontiguousarray(np.concatenate(columns, axis=1), dtype="<f4")
    names = property_names(bands)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}", *(f"property float {name}" for name in names)]
    with open(path, "wb") as handle:
        handle.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii"))
        handle.write(rows.tobytes())


def read_ply(path: str | os.PathLike[str]) -> Gaussians:
    """Read Gaussians; each is attached to itself.

    Raises:
        TakeError: no such file, not this layout, or cut short.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise TakeError(f"{path} cannot be read: {error.strerror or error}.", "Build the object of this take first.") from error
    head, mark, body = content.partition(b"end_header\n")
    lines = head.decode("ascii", errors="replace").splitlines()
    if not mark or lines[:2] != ["ply", "format binary_little_endian 1.0"]:
        raise TakeError(f"{path} is no binary little-endian PLY.", "Export the Gaussians in the standard layout of 3D Gaussian splatting.")
    count, names = _layout(path, lines)
    bands = 1 + sum(name.startswith("f_rest_") for name in names) // 3
    missing = [name for name in property_names(bands) if name not in names and not name.startswith("n")]
    if missing:
        raise TakeError(f"{path} lacks {', '.join(missing)}.", "Export the Gaussians in the standard layout of 3D Gaussian splatting.")
    if len(body) < 4 * count * len(names):
        raise TakeError(f"{path} is cut short.", "Write it again.")
    rows = np.frombuffer(body, dtype="<f4", count=count * len(names)).reshape(count, len(names)).astype(np.float64)

    def pick(wanted: list[str]) -> np.ndarray:
        return rows[:, [names.index(name) for name in wanted]]

    rest = pick([f"f_rest_{i}" for i in range(3 * (bands - 1))]).reshape(count, 3, bands - 1).transpose(0, 2, 1)
    return Gaussians(
        x=pick(["x", "y", "z"]),
        scale=np.exp(pick(["scale_0", "scale_1", "scale_2"])),
        rotation=pick([f"rot_{i}" for i in range(4)]),
        opacity=1.0 / (1.0 + np.exp(-pick(["opacity"])[:, 0])),
        sh=np.concatenate([pick(["f_dc_0", "f_dc_1", "f_dc_2"])[:, None], rest], axis=1),
        attachment=self_attached(count),
    )


def _layout(path: str | os.PathLike[str], lines: list[str]) -> tuple[int, list[str]]:
    """Number of vertices and names of their float properties from the header's lines."""
    count, names = -1, []
    for line in lines[2:]:
        words = line.split()
        if words[:2] == ["element", "vertex"] and len(words) == 3 and words[2].isdigit():
            count = int(words[2])
        elif words[:2] == ["property", "float"] and len(words) == 3:
            names.append(words[2])
        elif words and words[0] not in ("comment", "obj_info"):
            raise TakeError(f"{path} has an unexpected header line '{line}'.", "Only one element, vertex, of floats is read.")
    if count < 0:
        raise TakeError(f"{path} has no vertices.", "Export the Gaussians in the standard layout of 3D Gaussian splatting.")
    return count, names
