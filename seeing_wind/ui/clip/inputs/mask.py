"""Write Blender's masks and plane tracks as the PNG that the engine reads."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import bpy
import numpy as np

from ....engine.errors import ObjectError
from ....engine.take import Take
from ...bake.animation import set_frame
from .clips import clip_of, first_clip_frame, loaded_clip, scene_frame
from .tracks import plane_corners

SEGMENT = 24
"""Number of straight lines that approximate one Bézier segment of a mask."""


def write_mask(scene: bpy.types.Scene, mask: bpy.types.Mask, path: Path, clip_frame: int | None = None) -> None:
    """Write a mask, at a frame of the clip's file (by default the first one used), as a PNG of the clip's size.

    Raises:
        ObjectError: when the mask is empty.
    """
    settings, clip, before = scene.seeing_wind, loaded_clip(scene.seeing_wind), scene.frame_current_final
    clip_frame = first_clip_frame(settings) if clip_frame is None else clip_frame
    scene.frame_set(scene_frame(clip, clip_frame))
    try:
        inside = mask_pixels(mask, *clip.size)
    finally:
        set_frame(scene, before)
    if not inside.any():
        raise ObjectError(
            f"Nothing is inside the mask {mask.name} in frame {clip_frame} of the file.", "Close its splines (Alt C) and show its layers."
        )
    write_png(path, inside)


def write_plane_mask(scene: bpy.types.Scene, path: Path) -> None:
    """Write the inside of the active plane track (or the first one) in the first frame as a PNG.

    Raises:
        ObjectError: when the track has no marker there.
    """
    settings, clip = scene.seeing_wind, loaded_clip(scene.seeing_wind)
    planes = clip.tracking.plane_tracks
    plane, clip_frame = planes.active or planes[0], first_clip_frame(settings)
    corners = plane_corners(clip, plane, clip_frame)
    if corners is None:
        no_marker = f"The plane track {plane.name} has no marker in frame {clip_frame} of the file."
        raise ObjectError(no_marker, "Track it from the first frame on.")
    write_png(path, polygon_pixels(corners, *clip.size))


def mask_pixels(mask: bpy.types.Mask, width: int, height: int) -> np.ndarray:
    """Pixels (H, W) bool whose centres are inside a mask; layers are blended as in Blender, feather is ignored."""
    total, side = np.zeros((height, width)), max(width, height)
    for layer in mask.layers:
        if layer.hide_render:
            continue
        covered = np.zeros((height, width), dtype=bool)
        for spline in layer.splines:
            if spline.use_cyclic and spline.use_fill and len(spline.points) > 1:
                outline = _outline(spline) - 0.5
                # mask coordinates are relative to the frame's middle, in units of its longer side
                x, y = outline[:, 0] * side + 0.5 * width, outline[:, 1] * side + 0.5 * height
                covered ^= polygon_pixels(np.stack([x - 0.5, height - y - 0.5], axis=1), width, height)
        value = layer.alpha * (~covered if layer.invert else covered)
        total = _BLEND[layer.blend](total, value)
    return total > 0.5


_BLEND = {
    "MERGE_ADD": lambda a, b: a + b * (1.0 - a),
    "MERGE_SUBTRACT": lambda a, b: a * (1.0 - b),
    "ADD": lambda a, b: np.minimum(a + b, 1.0),
    "SUBTRACT": lambda a, b: np.maximum(a - b, 0.0),
    "LIGHTEN": np.maximum,
    "DARKEN": np.minimum,
    "MUL": lambda a, b: a * b,
    "REPLACE": lambda a, b: b,
    "DIFFERENCE": lambda a, b: np.abs(a - b),
}


def mask_stamp(scene: bpy.types.Scene, mask: bpy.types.Mask, clip_frame: int) -> tuple:
    """Stamp of a mask at a frame of the clip's file, whichever frame the scene is in: settings of the layers, control points and handles,
    which may be keyed; feather does not count."""
    clip = clip_of(scene.seeing_wind)
    at = scene_frame(clip, clip_frame) if clip is not None else clip_frame + 1  # where Blender will show it
    now = _stamp_now(mask)
    if scene.frame_current_final == at:
        return now
    seen = (mask.session_uid, scene.session_uid, at, scene.frame_current_final, now)
    if _kept.get(mask.session_uid, ())[:1] != (seen,):
        _kept[mask.session_uid] = (seen, _stamp_at(mask, at, scene))
    return _kept[mask.session_uid][1]


_kept: dict[int, tuple] = {}
"""Stamps of masks in another frame than the scene's, with what they were evaluated for: each evaluation is a change to Blender, after which
the stamps are asked for again."""


def _stamp_at(mask: bpy.types.Mask, frame: int, scene: bpy.types.Scene) -> tuple:
    """Stamp of a mask at a scene frame. Its keyed shapes can be read only by evaluating it there, which a scene of its own does without
    touching the user's."""
    aside = bpy.data.scenes.new("Seeing Wind Mask")
    try:
        aside.render.frame_map_old, aside.render.frame_map_new = scene.render.frame_map_old, scene.render.frame_map_new
        aside.frame_set(frame)
        return _stamp_now(mask.evaluated_get(aside.view_layers[0].depsgraph))
    finally:
        bpy.data.scenes.remove(aside)


def _stamp_now(mask: bpy.types.Mask) -> tuple:
    return tuple(
        (
            layer.name, layer.blend, layer.invert, layer.alpha, layer.hide_render, spline.use_cyclic, spline.use_fill,
            *(_stamp_of(point) for point in spline.points),
        )
        for layer in mask.layers
        for spline in layer.splines
    )  # fmt: skip


def _stamp_of(point: bpy.types.MaskSplinePoint) -> tuple:
    """Place and handles of a control point. Where Blender places a handle by itself, its kind alone counts: it may not be placed yet."""
    handles = ((point.handle_left_type, point.handle_left), (point.handle_right_type, point.handle_right))
    return (tuple(point.co), *((kind,) if kind in ("AUTO", "VECTOR") else (kind, *_rounded(place)) for kind, place in handles))


def _rounded(place: Iterable[float]) -> Iterator[float]:
    return (round(value, 5) for value in place)


def polygon_pixels(corners: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels (H, W) bool whose centres (at integers) are inside a polygon with corners (N, 2) [px], by the even-odd rule."""
    inside = np.zeros((height, width), dtype=bool)
    columns, following = np.arange(width), np.roll(corners, -1, axis=0)
    for row in range(max(int(corners[:, 1].min()), 0), min(int(np.ceil(corners[:, 1].max())) + 1, height)):
        crosses = (corners[:, 1] <= row) != (following[:, 1] <= row)
        a, b = corners[crosses], following[crosses]
        at = a[:, 0] + (row - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        inside[row] = (columns[:, None] >= at).sum(axis=1) % 2 == 1
    return inside


def write_png(path: Path, inside: np.ndarray) -> None:
    """Write a mask (H, W) bool as a grey PNG of 0 and 255."""
    with Take(path.parent).writing(path.name) as aside:
        aside.write_bytes(png(255 * inside.astype(np.uint8)))


def png(image: np.ndarray) -> bytes:
    """A grey (H, W) or RGB (H, W, 3) uint8 image as the bytes of a PNG file."""
    height, width = image.shape[:2]
    rows = np.concatenate([np.zeros((height, 1), np.uint8), image.reshape(height, -1)], axis=1).tobytes()

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">2I5B", width, height, 8, 0 if image.ndim == 2 else 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def _outline(spline: bpy.types.MaskSpline) -> np.ndarray:
    """A closed spline sampled as a polygon (N, 2), in Blender's mask coordinates."""
    points, parts = list(spline.points), []
    t = np.linspace(0.0, 1.0, SEGMENT, endpoint=False)[:, None]
    for here, there in zip(points, points[1:] + points[:1]):
        a, b, c, d = (np.array(tuple(each)) for each in (here.co, here.handle_right, there.handle_left, there.co))
        parts.append((1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t**2 * (1 - t) * c + t**3 * d)
    return np.concatenate(parts)
