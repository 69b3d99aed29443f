"""Position of the clip's frame on the screen: in the Movie Clip Editor, and as the background of a camera view."""

from __future__ import annotations

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d


def frame_corners(context: bpy.types.Context, region: bpy.types.Region) -> np.ndarray | None:
    """Lower left and upper right corner (2, 2) of the frame in a region's pixels; None if the region does not show the frame."""
    space = context.space_data
    if space.type == "CLIP_EDITOR":
        return np.array([region.view2d.view_to_region(u, v, clip=False) for u, v in ((0.0, 0.0), (1.0, 1.0))], dtype=np.float64)
    scene, view = context.scene, space.region_3d
    if space.type != "VIEW_3D" or scene.camera is None or view.view_perspective != "CAMERA":
        return None
    frame = [scene.camera.matrix_world @ corner for corner in scene.camera.data.view_frame(scene=scene)]
    seen = [location_3d_to_region_2d(region, view, corner) for corner in frame]
    if any(corner is None for corner in seen):
        return None
    flat = np.array([tuple(corner) for corner in seen])
    return np.stack([flat.min(axis=0), flat.max(axis=0)])


def box_in_frame(corners: np.ndarray, start: np.ndarray, end: np.ndarray, width: int, height: int) -> tuple[float, float, float, float]:
    """Left, top, right, bottom [px of the clip, origin top left] of a box drawn from `start` to `end` (2,) in the region's pixels.

    Args:
        corners: of `frame_corners`. The box is clipped to the frame.
    """
    points = (np.stack([start, end]) - corners[0]) / (corners[1] - corners[0])
    low, high = np.clip(points.min(axis=0), 0.0, 1.0), np.clip(points.max(axis=0), 0.0, 1.0)
    # the region's y points up; the clip's pixel centres are at integers
    left, right = (np.clip(value * width - 0.5, 0.0, width - 1.0) for value in (low[0], high[0]))
    top, bottom = (np.clip((1.0 - value) * height - 0.5, 0.0, height - 1.0) for value in (high[1], low[1]))
    return round(float(left), 1), round(float(top), 1), round(float(right), 1), round(float(bottom), 1)


def point_in_frame(corners: np.ndarray, at: tuple[float, float], width: int, height: int) -> tuple[float, float]:
    """Pixel of the clip (origin top left) at the position `at` in the region's pixels; not clipped to the frame."""
    share = (np.array(at) - corners[0]) / (corners[1] - corners[0])
    return round(float(share[0] * width - 0.5), 1), round(float((1.0 - share[1]) * height - 0.5), 1)


def box_on_screen(corners: np.ndarray, box: tuple[float, float, float, float], width: int, height: int) -> np.ndarray:
    """The inverse of `box_in_frame`: lower left and upper right corner (2, 2) in the region's pixels."""
    left, top, right, bottom = box
    share = np.array([[(left + 0.5) / width, 1.0 - (bottom + 0.5) / height], [(right + 0.5) / width, 1.0 - (top + 0.5) / height]])
    return corners[0] + share * (corners[1] - corners[0])
