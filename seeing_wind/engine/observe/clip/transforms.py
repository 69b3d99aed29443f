"""`transforms.json`, the camera file of nerfstudio and instant-ngp, mostly made from a COLMAP reconstruction, as a camera of this house.

Their cameras look along -z with y up; pixel (0, 0) has its centre at (0.5, 0.5). Here z is forward, y down, and centres are at integers.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from ...errors import UsageError

PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "")
"""Camera models whose distortion is OpenCV's five-number model, or none; a fish-eye is another formula."""

LENS = ("k1", "k2", "p1", "p2", "k3")


def is_transforms(values: dict[str, Any]) -> bool:
    """Whether a camera file's object is a `transforms.json`."""
    return isinstance(values.get("frames"), list)


def from_transforms(path: str, values: dict[str, Any], width: int, height: int) -> dict[str, Any]:
    """The keys of this house's camera file (width height fx fy cx cy camera_to_world and the lens's) from a `transforms.json`.

    Raises:
        UsageError: a fish-eye, focal lengths that are missing or differ between frames, or frames without a matrix.
    """
    model = str(values.get("camera_model", "")).upper()
    if model not in PINHOLES:
        raise UsageError(f"{path} has the camera model {model}.", "Undistort the frames to OPENCV or PINHOLE first.")
    frames = sorted(values["frames"], key=lambda frame: _natural(str(frame.get("file_path", "")) if isinstance(frame, dict) else ""))
    if not frames:
        raise UsageError(f"{path} has no frames.", "Export it again from nerfstudio or COLMAP.")
    if not all(isinstance(frame, dict) and "transform_matrix" in frame for frame in frames):
        raise UsageError(f"{path} has a frame without transform_matrix.", "Export it again from nerfstudio or COLMAP.")
    own = [{key: frame[key] for key in ("fl_x", "fl_y", "cx", "cy", "w", "h", *LENS) if key in frame} for frame in frames]
    if any(one != own[0] for one in own):
        raise UsageError(f"{path} has another lens in some frames.", "Give a clip that was filmed without zooming.")
    lens = {**values, **own[0]}
    size = (int(lens.get("w", width)), int(lens.get("h", height)))
    # A file made from smaller copies of the frames is still theirs.
    scale = width / size[0]
    if abs(size[1] * scale - height) > 1.0:
        raise UsageError(f"{path} is for {size[0]}x{size[1]} frames, the clip has {width}x{height}.", "Use the camera of this clip.")
    fx = _focal(path, lens, size[0])
    fy = float(lens.get("fl_y", fx))
    poses = [frame["transform_matrix"] for frame in frames]
    try:
        matrices = np.array(poses, dtype=np.float64) @ np.diag([1.0, -1.0, -1.0, 1.0])
    except (TypeError, ValueError) as error:
        raise UsageError(f"{path} has a transform_matrix that is not 4x4 numbers ({error}).", "Export it again.") from error
    return {
        "width": width,
        "height": height,
        "fx": fx * scale,
        "fy": fy * scale,
        "cx": float(lens.get("cx", size[0] / 2)) * scale - 0.5,
        "cy": float(lens.get("cy", size[1] / 2)) * scale - 0.5,
        "camera_to_world": matrices if len(matrices) > 1 else matrices[0],
        **{key: lens[key] for key in LENS if key in lens},
    }


def _focal(path: str, lens: dict[str, Any], width: int) -> float:
    if "fl_x" in lens:
        return float(lens["fl_x"])
    if "camera_angle_x" in lens:
        return 0.5 * width / math.tan(0.5 * float(lens["camera_angle_x"]))
    raise UsageError(f"{path} has neither fl_x nor camera_angle_x.", "Export it again with the camera's focal length.")


def _natural(name: str) -> list[Any]:
    """Sorts frame_10 after frame_9."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", name)]
