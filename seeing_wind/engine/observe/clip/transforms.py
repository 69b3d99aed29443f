"""Converting `transforms.json`, the camera file of nerfstudio and instant-ngp, usually made from a COLMAP reconstruction.

Their cameras look along -z with y up; pixel (0, 0) has its centre at (0.5, 0.5). Here z is forward, y down, and centres are at integers.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any

import numpy as np

from ...errors import UsageError

PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "")
"""Camera models whose distortion is OpenCV's five-number model, or none; a fish-eye follows another formula."""

LENS = ("k1", "k2", "p1", "p2", "k3")

SHOWN = 60
"""How many characters of a wrong value a message shows."""


def number_in(path: str, key: str, value: Any) -> float:
    """The number `value` of a camera file, found under `key`. Raises UsageError if it is not a number, or not finite."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise UsageError(f"The camera {path}: {key} is {json.dumps(value)[:SHOWN]}.", "Write a finite number, without quotes.")
    return float(value)


def matrices_in(path: str, key: str, value: Any) -> np.ndarray:
    """Nested lists of numbers of a camera file as an array. Raises UsageError as `number_in` does, and for lists of unequal lengths."""

    def numbers(key: str, value: Any) -> Any:
        nested = isinstance(value, list)
        return [numbers(f"{key}[{place}]", one) for place, one in enumerate(value)] if nested else number_in(path, key, value)

    try:
        return np.array(numbers(key, value))
    except ValueError:
        hint = "Write each matrix as four rows of four numbers."
        raise UsageError(f"The camera {path}: {key} is neither a 4x4 list nor a list of them.", hint) from None


def is_transforms(values: dict[str, Any]) -> bool:
    """Whether the object of a camera file is that of a `transforms.json`."""
    return isinstance(values.get("frames"), list)


def from_transforms(path: str, values: dict[str, Any], width: int, height: int) -> dict[str, Any]:
    """The values of a `transforms.json` under this project's keys: width height fx fy cx cy camera_to_world, and the lens's.

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
    lens |= {key: number_in(path, key, lens[key]) for key in ("fl_x", "fl_y", "cx", "cy", "w", "h", "camera_angle_x") if key in lens}
    size = (int(lens.get("w", width)), int(lens.get("h", height)))
    # The file may have been made from smaller copies of the frames.
    scale = width / size[0]
    if abs(size[1] * scale - height) > 1.0:
        raise UsageError(f"{path} is for {size[0]}x{size[1]} frames, the clip has {width}x{height}.", "Use the camera of this clip.")
    fx = _focal(path, lens, size[0])
    fy = lens.get("fl_y", fx)
    poses = [matrices_in(path, f"transform_matrix of {frame.get('file_path', 'a frame')}", frame["transform_matrix"]) for frame in frames]
    if any(pose.shape != (4, 4) for pose in poses):
        raise UsageError(f"{path} has a transform_matrix that is not 4x4 numbers.", "Export it again.")
    matrices = np.array(poses) @ np.diag([1.0, -1.0, -1.0, 1.0])
    return {
        "width": width,
        "height": height,
        "fx": fx * scale,
        "fy": fy * scale,
        "cx": lens.get("cx", size[0] / 2) * scale - 0.5,
        "cy": lens.get("cy", size[1] / 2) * scale - 0.5,
        "camera_to_world": (matrices if len(matrices) > 1 else matrices[0]).tolist(),
        **{key: lens[key] for key in LENS if key in lens},
    }


def _focal(path: str, lens: dict[str, Any], width: int) -> float:
    if "fl_x" in lens:
        return float(lens["fl_x"])
    if "camera_angle_x" in lens:
        return 0.5 * width / math.tan(0.5 * lens["camera_angle_x"])
    raise UsageError(f"{path} has neither fl_x nor camera_angle_x.", "Export it again with the camera's focal length.")


def _natural(name: str) -> list[Any]:
    """A sort key that puts frame_10 after frame_9."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", name)]
