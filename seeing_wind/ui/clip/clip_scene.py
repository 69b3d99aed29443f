"""The scene of a clip: its camera, timing, background and recovered object."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...engine.errors import ClipError, UsageError
from ..composite.mattes import narrowed
from ..scene_units import metres_per_unit
from .inputs.clips import found_clip, load_clip, place_clip
from .inputs.pace import Pace
from .match import ALL, OURS, follow

CAMERA = "Seeing Wind Camera"
DRAWN = 0.2
"""Size of the camera's frame in the viewport: at Blender's default size it would hide the objects that it filmed."""
NEAR, FAR = 0.1, 1000.0
"""Clipping distances of the clip's camera [m]: Blender's defaults in a scene in metres."""
UNIT = "seeing_wind_unit"
"""Custom property of a camera's data: the scene's unit length [m] for which these were set."""
SENSOR_WIDTH = 36.0
"""Sensor width [mm] to which the focal length in millimetres that Blender shows refers."""

FRAME_COLOUR = "frame_colour"
"""Color attribute of the recovered object: the clip's pixels at its vertices."""

OPENCV_TO_BLENDER = np.diag([1.0, -1.0, -1.0, 1.0])
"""OpenCV's camera looks along +Z with Y down, Blender's along -Z with Y up."""


def setup_clip_scene(
    scene: bpy.types.Scene,
    clip_path: str | Path,
    camera: Mapping[str, Any],
    fps: float,
    first_frame: int,
    frames: int,
    frame_start: int = 1,
    parts: Collection[str] = ALL,
) -> bpy.types.Object:
    """Set up the clip's camera with the clip as its background, and make parts of the scene follow the clip.

    Args:
        scene: changed in place. A camera that this function made before is reused.
        clip_path: of the video.
        camera: `width height fx fy cx cy` [px] and `camera_to_world` (4, 4) or (T+1, 4, 4) [m]; OpenCV's axes, pixel centres at integers.
        fps: frames per second of the clip.
        first_frame: index in the file of frame 0.
        frames: T, the number of frame intervals; T + 1 clip frames are shown.
        frame_start: scene frame of clip frame 0.
        parts: see `match.PARTS`.

    Returns:
        The camera object.

    Raises:
        ClipError: when Blender cannot read the clip.
        UsageError: when the camera is incomplete or invalid.
    """
    camera = dict(camera)
    _check_camera(camera, frames)
    clip = _load_clip(scene, clip_path, first_frame, frame_start)
    scene.active_clip = clip
    obj, unit = _camera_object(scene), metres_per_unit(scene)
    _set_lens(obj.data, camera)
    _set_reach(obj.data, unit)
    set_poses(obj, np.asarray(camera["camera_to_world"], dtype=np.float64), unit, frame_start)
    set_background(obj.data, clip)
    # non-square pixels: Blender stretches one side by a factor of at least one
    aspect = max(camera["fy"] / camera["fx"], 1.0), max(camera["fx"] / camera["fy"], 1.0)
    size = int(camera["width"]), int(camera["height"])
    follow(scene, parts, fps=fps, first=frame_start, last=frame_start + frames, size=size, aspect=aspect, camera=obj)
    if "RANGE" in parts:
        scene.frame_set(frame_start)
    return obj


def create_recovered_object(
    scene: bpy.types.Scene,
    name: str,
    vertices: np.ndarray,
    triangles: np.ndarray,
    uv: np.ndarray,
    frame: np.ndarray | str | Path,
    collection: bpy.types.Collection | None = None,
    outline: np.ndarray | None = None,
) -> bpy.types.Object:
    """The clip's object as a mesh textured with frame 0.

    Args:
        vertices: (V, 3) in frame 0 [m, world].
        triangles: (M, 3).
        uv: (V, 2) in 0..1, origin bottom left.
        frame: (H, W, 3) uint8 RGB, packed into the .blend file, or the path of an image or of a video, whose first frame is used.
        collection: where to link the object, by default the scene's own collection.
        outline: (H, W) bool, the object in the frame; if given, Solid view shows no pixel from outside the object.
    """
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata((np.asarray(vertices) / metres_per_unit(scene)).tolist(), [], np.asarray(triangles).tolist())
    # drops triangles that Blender cannot represent (a repeated corner, a duplicate triangle); all vertices stay
    mesh.validate()
    layer, corners = mesh.uv_layers.new(name="Frame"), np.empty(len(mesh.loops), dtype=np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    layer.uv.foreach_set("vector", np.asarray(uv, dtype=np.float32)[corners].ravel())
    if isinstance(frame, np.ndarray):
        _wear_in_solid_view(mesh, np.asarray(uv), frame, outline)
    mesh.materials.append(_frame_material(f"{name} Frame", frame_image(f"{name} Frame", frame)))
    mesh.update()
    obj = bpy.data.objects.new(name, mesh)
    (collection or scene.collection).objects.link(obj)
    return obj


def _wear_in_solid_view(mesh: bpy.types.Mesh, uv: np.ndarray, frame: np.ndarray, outline: np.ndarray | None) -> None:
    """Give every vertex the color of its pixel. Solid view then shows vertex colors for the object and the arrows, which have no texture.

    A vertex at the rim, whose pixel is mixed with the background, takes the color of the nearest vertex inside.
    """
    height, width = frame.shape[:2]
    column = np.clip((uv[:, 0] * width).astype(int), 0, width - 1)
    row = np.clip(((1.0 - uv[:, 1]) * height).astype(int), 0, height - 1)
    shown = frame[row, column, :3] / 255.0
    inside = narrowed(outline)[row, column] if outline is not None and outline.shape == frame.shape[:2] else np.ones(len(uv), bool)
    for vertex in np.flatnonzero(~inside) if inside.any() else ():
        away = np.hypot(column[inside] - column[vertex], row[inside] - row[vertex])
        shown[vertex] = shown[np.flatnonzero(inside)[np.argmin(away)]]
    linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    colours = np.concatenate([linear, np.ones((len(uv), 1))], axis=1).astype(np.float32)
    mesh.attributes.new(FRAME_COLOUR, "FLOAT_COLOR", "POINT").data.foreach_set("color", colours.ravel())
    mesh.color_attributes.active_color_name = FRAME_COLOUR


def _check_camera(camera: Mapping[str, Any], frames: int) -> None:
    missing = [key for key in ("width", "height", "fx", "fy", "cx", "cy", "camera_to_world") if key not in camera]
    if missing:
        raise UsageError(f"The camera lacks {', '.join(missing)}.", "Run Recover again, or correct the camera's JSON.")
    shape = np.shape(camera["camera_to_world"])
    if shape != (4, 4) and shape != (frames + 1, 4, 4):
        raise UsageError(f"The camera's poses have the shape {shape}.", f"Expected (4, 4) or ({frames + 1}, 4, 4).")
    if not all(camera[key] > 0 for key in ("width", "height", "fx", "fy")):
        raise UsageError("The camera's size and focal length must be above zero.", "Correct the camera's JSON.")


def _load_clip(scene: bpy.types.Scene, path: str | Path, first_frame: int, frame_start: int) -> bpy.types.MovieClip:
    clip = found_clip(str(path), scene) or load_clip(str(path))
    # a file that is no video loads without an error, as a clip with no frames
    if clip.frame_duration < 1:
        if clip.users == 0:
            bpy.data.movieclips.remove(clip)
        raise ClipError(f"{path} has no frames that Blender can read.", "Convert it to MP4 (H.264).")
    return place_clip(scene, clip, first_frame, Pace(frame_start))


def _camera_object(scene: bpy.types.Scene) -> bpy.types.Object:
    obj = next((each for each in scene.objects if each.get(OURS)), None)
    if obj is None:
        obj = bpy.data.objects.new(CAMERA, bpy.data.cameras.new(CAMERA))
        obj[OURS] = True
        scene.collection.objects.link(obj)
    return obj


def _set_lens(data: bpy.types.Camera, camera: Mapping[str, Any]) -> None:
    """Set the intrinsics. Blender's shift of the principal point is in frame widths from the middle; our pixel centres are at integers."""
    width, height, fx, fy = (float(camera[key]) for key in ("width", "height", "fx", "fy"))
    data.type, data.sensor_fit, data.sensor_width = "PERSP", "HORIZONTAL", SENSOR_WIDTH
    data.lens = fx * SENSOR_WIDTH / width
    data.shift_x = 0.5 - (camera["cx"] + 0.5) / width
    data.shift_y = ((camera["cy"] + 0.5) / height - 0.5) * (height * fx) / (width * fy)


def _set_reach(data: bpy.types.Camera, unit: float) -> None:
    """Set clipping distances and drawn size for scene units of `unit` metres; only when `unit` changes, so that the user's values stay."""
    if data.get(UNIT) != unit:
        data.clip_start, data.clip_end, data.display_size, data[UNIT] = NEAR / unit, FAR / unit, DRAWN / unit, unit


def set_poses(obj: bpy.types.Object, poses: np.ndarray, unit: float, frame_start: int) -> None:
    """Pose the clip's camera, with a keyframe in every frame if it moves.

    Args:
        poses: `camera_to_world` (4, 4), or (F, 4, 4) for a moving camera [m], OpenCV's axes.
        unit: length of a scene unit [m].
        frame_start: scene frame of the first pose.
    """
    obj.animation_data_clear()
    moving = poses.ndim == 3
    obj.rotation_mode = "QUATERNION"
    previous = None
    for number, pose in enumerate(poses if moving else poses[None]):
        pose = pose @ OPENCV_TO_BLENDER
        obj.location = pose[:3, 3] / unit
        rotation = Matrix(pose[:3, :3].tolist()).to_quaternion()
        if previous is not None:
            # q and -q are the same rotation; the nearer one avoids a long turn between frames
            rotation.make_compatible(previous)
        obj.rotation_quaternion = previous = rotation
        if moving:
            obj.keyframe_insert("location", frame=frame_start + number)
            obj.keyframe_insert("rotation_quaternion", frame=frame_start + number)


def set_background(data: bpy.types.Camera, clip: bpy.types.MovieClip) -> None:
    """Make the clip the camera's only background image."""
    data.background_images.clear()
    data.show_background_images = True
    background = data.background_images.new()
    background.source, background.clip = "MOVIE_CLIP", clip
    background.alpha, background.display_depth, background.frame_method = 1.0, "BACK", "STRETCH"


def frame_image(name: str, frame: np.ndarray | str | Path) -> bpy.types.Image:
    """Pixels (H, W, 3) uint8 RGB as an image packed into the .blend file, or the image at a path."""
    if not isinstance(frame, np.ndarray):
        return bpy.data.images.load(str(Path(frame).resolve()), check_existing=True)
    height, width = frame.shape[:2]
    image = bpy.data.images.new(name, width, height)
    pixels = np.ones((height, width, 4), dtype=np.float32)
    # Blender's rows start at the bottom
    pixels[..., :3] = frame[::-1] / 255.0
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def _frame_material(name: str, image: bpy.types.Image) -> bpy.types.Material:
    """A material that emits the image as it is, since its pixels already contain the clip's light."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    texture, emission, output = (nodes.new(kind) for kind in ("ShaderNodeTexImage", "ShaderNodeEmission", "ShaderNodeOutputMaterial"))
    texture.image, texture.extension = image, "EXTEND"
    if image.source == "MOVIE":
        texture.image_user.frame_duration = 1
    links.new(texture.outputs["Color"], emission.inputs["Color"])
    links.new(emission.outputs["Emission"], output.inputs["Surface"])
    for column, node in enumerate((texture, emission, output)):
        node.location = (300 * column, 0)
    return material
