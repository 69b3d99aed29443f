"""Write the held place, as marked in the scene, as the PNG of the first frame that the engine reads."""

from __future__ import annotations

import hashlib
from pathlib import Path

import bpy
import numpy as np

from ....engine.errors import UsageError
from ....engine.records import Camera
from ....engine.take import Take
from ...bake.animation import set_frame
from ...bake.at_rest import at_rest
from ...job.take_reading import field_summary, read_seen
from ...job.takes import shown
from ...scene_mesh import mesh_arrays, pinned_vertices
from ...scene_units import metres_per_unit
from .camera import first_camera
from .clips import loaded_clip
from .mask import write_png

HALF = 0.5
"""Least weight of a held vertex."""
TINIEST = 1e-9
"""Twice the area [px²] below which a triangle counts as seen edge-on."""


def write_held_box(scene: bpy.types.Scene, path: Path) -> None:
    """Write the held box of the settings as a PNG of the clip's size."""
    settings = scene.seeing_wind
    width, height = loaded_clip(settings).size
    x0, y0, x1, y1 = settings.held_box
    columns, rows = np.arange(width), np.arange(height)[:, None]
    write_png(path, (columns >= x0) & (columns <= x1) & (rows >= y0) & (rows <= y1))


def write_painted(scene: bpy.types.Scene, obj: bpy.types.Object, group: str, folder: Path) -> Path:
    """Write the painted part of a mesh in the clip's first frame as a PNG. Returns its path, whose name depends on the content.

    The recovered object is seen through its take's camera, any other mesh through the scene's camera of the clip. Painted parts on the far
    side count too, since the object is held there all the same.

    Raises:
        UsageError: when no vertex has a weight of `HALF` or more, or the camera sees none of these.
    """
    settings, before = scene.seeing_wind, scene.frame_current_final
    camera = _camera(scene, obj)
    scene.frame_set(settings.frame_start)
    try:
        with at_rest(obj, scene, whole=True) as still:
            depsgraph = bpy.context.evaluated_depsgraph_get()
            vertices, triangles = mesh_arrays(still, depsgraph)
            index, found = pinned_vertices(still, depsgraph, group)
    finally:
        set_frame(scene, before)
    weight = np.zeros(len(vertices))
    weight[index] = found
    size = tuple(loaded_clip(settings).size)
    xy, depth = camera.project(vertices * metres_per_unit(scene))
    # a take may have been observed at a lower resolution than the clip's
    xy = (camera.filmed(xy) + 0.5) * np.divide(size, (camera.width, camera.height)) - 0.5
    weight[depth <= 0.0] = 0.0
    inside = painted_pixels(xy, weight, triangles[(depth[triangles] > 0.0).all(axis=1)], *size)
    if not inside.any():
        raise UsageError(
            f"The camera sees nothing of {obj.name} that has a weight of {HALF:g} or more in {group!r}.",
            "Paint the held part with full weight, on a mesh that stands where the object is in the first frame.",
        )
    digest = hashlib.sha256(np.packbits(inside).tobytes()).hexdigest()[:8]
    path = folder / f"painted-{digest}.png"
    if not path.is_file():
        write_png(path, inside)
    return path


def painted_pixels(xy: np.ndarray, weight: np.ndarray, triangles: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels (H, W) bool at which a mesh's weight is `HALF` or more, from vertices xy (V, 2) [px], weight (V,) and triangles (M, 3)."""
    inside = np.zeros((height, width), dtype=bool)
    at = np.round(xy[(weight >= HALF) & np.isfinite(xy).all(axis=1)]).astype(np.int64)
    seen = at[((at >= 0) & (at < (width, height))).all(axis=1)]
    inside[seen[:, 1], seen[:, 0]] = True  # for parts seen edge-on or smaller than a pixel
    for corners in triangles[(weight[triangles] >= HALF).any(axis=1)]:
        a, b, c = xy[corners]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if not abs(area) > TINIEST:
            continue
        low = np.maximum(np.ceil(xy[corners].min(axis=0)), 0).astype(int)
        high = np.minimum(np.floor(xy[corners].max(axis=0)) + 1, (width, height)).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        second = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
        third = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
        shares = np.stack([1.0 - second - third, second, third], axis=-1)
        inside[low[1] : high[1], low[0] : high[0]] |= (shares >= 0.0).all(axis=-1) & (shares @ weight[corners] >= HALF)
    return inside


def _camera(scene: bpy.types.Scene, obj: bpy.types.Object) -> Camera:
    """The camera of the clip's first frame through which to see a mesh."""
    settings = scene.seeing_wind
    if obj == settings.recovered_object and settings.recovered_take:
        take = Take(shown(settings))
        seen = read_seen(take, field_summary(take))
        if seen is not None:
            return seen.camera
    return first_camera(scene)
