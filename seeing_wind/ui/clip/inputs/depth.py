"""Depth map of a proxy mesh at the object's place in the first frame, as seen by the clip's camera."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from ....engine.errors import UsageError
from ....engine.records import Camera
from ....engine.take import Take
from ...bake.animation import set_frame
from ...bake.at_rest import at_rest
from ...scene_mesh import mesh_arrays
from ...scene_units import metres_per_unit
from .camera import first_camera
from .lens import straightened


def write_depth(scene: bpy.types.Scene, path: Path) -> None:
    """Write the proxy's depth map as NPY: (H, W) float32, depth along the view axis [m], infinite beside the proxy.

    Raises:
        UsageError: when the camera does not see the proxy.
    """
    settings, before = scene.seeing_wind, scene.frame_current_final
    camera = first_camera(scene)
    scene.frame_set(settings.frame_start)
    try:
        with at_rest(settings.proxy, scene, whole=True) as still:
            vertices, triangles = mesh_arrays(still, bpy.context.evaluated_depsgraph_get())
    finally:
        set_frame(scene, before)
    depth = depth_of(vertices * metres_per_unit(scene), triangles, camera)
    if not np.isfinite(depth).any():
        raise UsageError(
            f"The camera does not see the proxy {settings.proxy.name} in the first frame.", "Place it where the object is in the clip."
        )
    with Take(path.parent).writing(path.name) as aside:
        np.save(aside, depth)


def depth_of(vertices: np.ndarray, triangles: np.ndarray, camera: Camera) -> np.ndarray:
    """Depth (H, W) float32 [m] at each pixel of a mesh with vertices (V, 3) [m] and triangles (M, 3), by casting rays; inf beside it."""
    pose = camera.pose(0)
    local = (vertices - pose[:3, 3]) @ pose[:3, :3]
    tree = BVHTree.FromPolygons([Vector(vertex) for vertex in local], triangles.tolist())
    depth = np.full((camera.height, camera.width), np.inf, dtype=np.float32)
    columns, rows = _seen(local, camera)
    straight = straightened(camera, np.stack(np.meshgrid(columns, rows), axis=-1))
    for row, line in zip(rows, straight):
        for column, (u, v) in zip(columns, line.tolist()):
            if not math.isfinite(u + v):  # the lens shows nothing here
                continue
            hit = tree.ray_cast(Vector(), Vector(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0)))[0]
            if hit is not None:
                depth[row, column] = hit.z
    return depth


def _seen(local: np.ndarray, camera: Camera) -> tuple[range, range]:
    """Columns and rows of the pixels that the mesh may cover; `local` (V, 3) are its vertices in OpenCV's camera axes [m]."""
    if (local[:, 2] <= 1e-6).any():  # partly behind the camera: its projected bounding box is meaningless
        return range(camera.width), range(camera.height)
    xy = local[:, :2] / local[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    filmed = camera.filmed(xy)
    low, high = np.floor(filmed.min(axis=0)).astype(int), np.ceil(filmed.max(axis=0)).astype(int) + 1
    return range(max(low[0], 0), min(high[0], camera.width)), range(max(low[1], 0), min(high[1], camera.height))
