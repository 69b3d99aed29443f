"""Write the scene's camera or a camera solve as the engine's JSON: the inverse of `clip_scene`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ....engine.errors import UsageError
from ....engine.records import Camera
from ....engine.take import Take
from ...bake.animation import keyframes, lineage, set_frame, with_parents
from ...scene_units import metres_per_unit
from .clips import clip_of, first_clip_frame, loaded_clip, marker_frame, scene_frame
from .pace import frame_by_frame

BLENDER_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Blender's camera looks along -Z with Y up, OpenCV's along +Z with Y down."""

LENS = ("k1", "k2", "p1", "p2", "k3")
"""OpenCV's distortion coefficients, in its order."""

LENS_OF_CAMERA = ("lens", "sensor_width", "sensor_height", "shift_x", "shift_y")
"""Numbers of a camera's data on which its intrinsics depend."""

NO_CAMERA = ("The scene has no camera.", "Add one where the clip was filmed from, or use a field of view.")
SPARE = 8
"""Extra rows beyond the clip's length, since two libraries may disagree by one or two about its number of frames."""


def camera_source(scene: bpy.types.Scene) -> tuple:
    """The source of the camera, with a stamp: ("solve", ...), ("scene", ...), or () for a field of view or a file.

    Raises:
        UsageError: when the solve or camera that the settings choose does not exist.
    """
    settings = scene.seeing_wind
    clip = clip_of(settings)
    solved = clip is not None and clip.tracking.reconstruction.is_valid and len(clip.tracking.reconstruction.cameras) > 0
    wanted = settings.camera_mode
    if wanted == "SOLVE" or (wanted == "AUTO" and solved):
        if not solved:
            raise UsageError("The clip has no camera solve.", "Solve it in the Movie Clip Editor, or use a field of view.")
        obj = _solved_object(scene)
        lens, error = _solved_lens(clip), clip.tracking.reconstruction.average_error
        numbers = tuple(round(lens.get(name, 0.0), 6 if name in LENS else 4) for name in ("fx", "fy", "cx", "cy", *LENS))
        return ("solve", lineage(obj) if obj is not None else "", round(error, 6), clip.frame_offset, numbers)
    if wanted == "SCENE" or (wanted == "AUTO" and settings.scale_mode == "PROXY"):
        obj = scene.camera
        if obj is None:
            raise UsageError(*NO_CAMERA)
        keyed = {path for path, _, _ in keyframes(obj.data)}
        lens = [round(getattr(obj.data, name), 5) for name in LENS_OF_CAMERA if name not in keyed]
        pixel = (scene.render.pixel_aspect_x, scene.render.pixel_aspect_y)
        return ("scene", lineage(obj), lens, keyframes(obj.data), obj.data.sensor_fit, pixel)
    return ()


def write_camera(scene: bpy.types.Scene, path: Path) -> None:
    """Write the camera's JSON: intrinsics in pixels of the clip, one pose per frame of the clip's file."""
    Take(path.parent).write_json(path.name, scene_camera(scene))


def scene_camera(scene: bpy.types.Scene) -> dict[str, Any]:
    """`width height fx fy cx cy` [px] and `camera_to_world` (rows, 4, 4) [m], one per frame of the file, OpenCV's axes.

    If the settings take the camera from a field of view or a file, this is the scene's camera.

    Raises:
        UsageError: when there is no such camera, it is not perspective, or its lens model is not supported.
    """
    settings, clip = scene.seeing_wind, loaded_clip(scene.seeing_wind)
    clip_frames = clip.frame_duration + clip.frame_offset + SPARE
    if camera_source(scene)[:1] == ("solve",):
        obj, lens = _solved_object(scene), _solved_lens(clip)
        poses = _evaluated(scene, obj, clip, clip_frames) if obj is not None else _reconstructed(clip, clip_frames, metres_per_unit(scene))
    elif scene.camera is None:
        raise UsageError(*NO_CAMERA)
    else:
        lens, poses = _lens(scene, scene.camera, clip), _evaluated(scene, scene.camera, clip, clip_frames, settings)
    rigid = poses.copy()
    for pose in rigid:
        u, _, vt = np.linalg.svd(pose[:3, :3])  # removes scale, which does not change what a camera sees
        pose[:3, :3] = u @ vt
    return lens | {"camera_to_world": (rigid @ BLENDER_TO_OPENCV).tolist()}


def first_camera(scene: bpy.types.Scene) -> Camera:
    """`scene_camera` in the first frame used of the clip."""
    given = scene_camera(scene)
    numbers = {name: given[name] for name in ("width", "height", "fx", "fy", "cx", "cy")}
    pose = np.array(given["camera_to_world"][first_clip_frame(scene.seeing_wind)])
    return Camera(**numbers, camera_to_world=pose, distortion=tuple(given.get(name, 0.0) for name in LENS))


def _lens(scene: bpy.types.Scene, obj: bpy.types.Object, clip: bpy.types.MovieClip) -> dict[str, Any]:
    """Intrinsics of a camera object that renders the clip's frame."""
    data, (width, height) = obj.data, clip.size
    if data.type != "PERSP":
        raise UsageError(f"{obj.name} is no perspective camera.", "Set its type to Perspective, or use a field of view.")
    # non-square pixels: Blender measures in units of the wider side after stretching
    aspect_x, aspect_y = scene.render.pixel_aspect_x, scene.render.pixel_aspect_y
    fit = data.sensor_fit
    if fit == "AUTO":
        fit = "HORIZONTAL" if width * aspect_x >= height * aspect_y else "VERTICAL"
    if fit == "HORIZONTAL":
        side, sensor = width * aspect_x, data.sensor_width
    else:
        side, sensor = height * aspect_y, data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    focal = data.lens / sensor * side
    return {
        "width": int(width),
        "height": int(height),
        "fx": focal / aspect_x,
        "fy": focal / aspect_y,
        "cx": 0.5 * width - 0.5 - data.shift_x * side / aspect_x,
        "cy": 0.5 * height - 0.5 + data.shift_y * side / aspect_y,
    }


def _solved_lens(clip: bpy.types.MovieClip) -> dict[str, Any]:
    """Intrinsics of the solve, estimated or given, with `_distortion`."""
    camera, (width, height) = clip.tracking.camera, clip.size
    x, y = camera.principal_point_pixels
    focal = camera.focal_length_pixels
    # Blender's principal point is measured from the frame's lower left corner
    lens = {
        "width": int(width),
        "height": int(height),
        "fx": focal,
        "fy": focal * camera.pixel_aspect,
        "cx": x - 0.5,
        "cy": height - y - 0.5,
    }
    return lens | _distortion(camera, 0.5 * float(np.hypot(width, height)) / focal)


def _distortion(camera: bpy.types.MovieTrackingCamera, corner: float) -> dict[str, float]:
    """A solve's lens distortion as OpenCV's `k1 k2 p1 p2 k3`, for radii in focal lengths; empty for no distortion.

    Blender's models Polynomial and Brown are OpenCV's formulas. Its model Division gives the inverse, the undistorted radius
    r / (1 + k1 r² + k2 r⁴), so OpenCV's radial coefficients are fitted to it, over the frame up to its corners.

    Args:
        corner: distance of the frame's corners from its middle [focal lengths].

    Raises:
        UsageError: for a lens model that OpenCV's formula cannot express.
    """
    model = camera.distortion_model
    if model == "POLYNOMIAL":
        numbers = (camera.k1, camera.k2, 0.0, 0.0, camera.k3)
    elif model == "BROWN" and camera.brown_k4 == 0.0:
        numbers = (camera.brown_k1, camera.brown_k2, camera.brown_p1, camera.brown_p2, camera.brown_k3)
    elif model == "DIVISION":
        bent = np.linspace(0.0, corner, 200)[1:]
        straight = bent / (1.0 + camera.division_k1 * bent**2 + camera.division_k2 * bent**4)
        table = np.stack([straight**2, straight**4, straight**6], axis=1)
        k1, k2, k3 = np.linalg.lstsq(table, bent / straight - 1.0, rcond=None)[0]
        numbers = (k1, k2, 0.0, 0.0, k3)
    else:
        raise UsageError(
            f"The solve has the lens model {model.title()}, which the engine does not have.",
            "Choose Polynomial, Division or Brown without K4 under Lens, and solve again.",
        )
    return {name: float(value) for name, value in zip(LENS, numbers, strict=True)} if any(numbers) else {}


def _solved_object(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The camera with a Camera Solver constraint, if any: its own transform is the orientation and scale that the user gave the solve."""
    found = [obj for obj in scene.objects if obj.type == "CAMERA" and any(each.type == "CAMERA_SOLVER" for each in obj.constraints)]
    return scene.camera if scene.camera in found else found[0] if found else None


def _evaluated(
    scene: bpy.types.Scene,
    obj: bpy.types.Object,
    clip: bpy.types.MovieClip,
    clip_frames: int,
    settings: bpy.types.PropertyGroup | None = None,
) -> np.ndarray:
    """Poses (clip_frames, 4, 4) of an object [m], Blender's axes; the scene is played only if the object moves.

    With `settings`, the first frame used is at the settings' first scene frame; without, at the scene frame where Blender shows it.
    """
    unit, before = metres_per_unit(scene), scene.frame_current_final
    moves = any(each.animation_data or each.constraints for each in with_parents(obj))
    poses = np.empty((clip_frames, 4, 4))
    try:
        with frame_by_frame(clip):
            for clip_frame in range(clip_frames if moves else 1):
                at = scene_frame(clip, clip_frame) if settings is None else settings.frame_start + clip_frame - first_clip_frame(settings)
                scene.frame_set(at)
                poses[clip_frame] = np.array(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world)
    finally:
        set_frame(scene, before)
    if not moves:
        poses[:] = poses[0]
    poses[:, :3, 3] *= unit
    return poses


def _reconstructed(clip: bpy.types.MovieClip, clip_frames: int, unit: float) -> np.ndarray:
    """Poses (clip_frames, 4, 4) of the solve itself [m]; a frame without a solved camera takes the nearest frame's."""
    solved = {camera.frame: np.array(camera.matrix) for camera in clip.tracking.reconstruction.cameras}
    frames = np.array(sorted(solved))
    poses = np.empty((clip_frames, 4, 4))
    for clip_frame in range(clip_frames):
        nearest = frames[np.argmin(np.abs(frames - marker_frame(clip, clip_frame)))]
        poses[clip_frame] = solved[int(nearest)]
    poses[:, :3, 3] *= unit
    return poses
