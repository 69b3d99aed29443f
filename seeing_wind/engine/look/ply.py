"""Gaussians as a PLY file in the standard layout of 3D Gaussian splatting (Kerbl et al. 2023), which other viewers can read.

Binary little endian floats: x y z, nx ny nz (zero), f_dc_0..2, f_rest_* (colour channel by colour channel), opacity (logit),
scale_0..2 (logarithm), rot_0..3 (quaternion w x y z).
"""

from __future__ import annotations

import os

import numpy as np

from ..records import Gaussians

OPACITY_MARGIN = 1e-6
"""Opacities are kept this far from 0 and 1, whose logits are not finite."""


def _property_names(bands: int) -> list[str]:
    """The vertex properties, in order, for `bands` spherical harmonics (1 for degree 0, 16 for degree 3)."""
    rest = [f"f_rest_{i}" for i in range(3 * (bands - 1))]
    return [*"xyz", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest, "opacity", "scale_0", "scale_1", "scale_2"] + [
        f"rot_{i}" for i in range(4)
    ]


def write_ply(path: str | os.PathLike[str], gaussians: Gaussians) -> None:
    """Write Gaussians. Their attachment to particles is not part of the format."""
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
    names = _property_names(bands)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}", *(f"property float {name}" for name in names)]
    with open(path, "wb") as handle:
        handle.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii"))
        handle.write(rows.tobytes())
