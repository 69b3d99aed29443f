"""The speed at which a field's clip frames are played: one per scene frame, or the clip's own speed whatever the scene's frame rate.

A field, its values and its arrows count frames by their modifiers' inputs, so they are retimed without the take. Clip frames that fall
between two scene frames are handled correctly, too: a solver's step to a frame gets the force of the clip frame in the middle of that step.
Motion in the scene is interpolated between clip frames; the clip, its mattes and its camera show the nearest clip frame in each scene
frame, as these three must match each other.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

from ...engine.errors import UsageError
from ...engine.take import Take
from ..bake.animation import curves_of, retime
from ..bake.bodies import bake_bodies
from ..bake.plan import mark_of
from ..bake.shapes import evaluation_time_curves
from ..clip.clip_scene import set_poses
from ..clip.inputs.clips import clip_of, first_clip_frame, place_clip
from ..clip.inputs.pace import Pace
from ..composite.film import keep_focus
from ..composite.mattes import keep_pace
from ..edit.resimulate.preview import digest_of_preview, frames_of_clip_seen, shown_as_preview
from ..edit.resimulate.request import EditRequest
from ..job import takes
from ..job.take_reading import field_summary, read_seen
from ..scene_units import metres_per_unit
from .display import LOOP, STRIDE, blows_from_to, frames_per_second, is_field
from .node_groups import FIRST_FRAME, FRAMES_PER_CLIP_FRAME, modifier_input, set_input
from .samples import samples_of


def conform(scene: bpy.types.Scene, field: bpy.types.Object, real_time: bool) -> float:
    """Play a field in real time or frame by frame; for the scene's own field, also the clip, the camera and the recovered object.

    Baked bodies are baked again, in the same way.

    Returns:
        The number of scene frames that a clip frame lasts.

    Raises:
        TakeError: when a re-simulation that was baked, or the take of a camera that moves, is gone.
        UsageError: when the field or the clip is linked, or the field was made by an earlier version.
    """
    settings, stride = scene.seeing_wind, 1.0
    if real_time:
        stride = frames_per_second(scene) / field["seeing_wind_fps"]
    if field != settings.field_object:
        set_stride(field, stride)
        return stride
    poses = _poses(scene)  # before anything is changed: the take may be gone
    previewed = _frames_of_preview(scene)
    _conform_clip(scene, stride, poses)
    set_stride(field, stride)
    settings.real_time = real_time
    if real_time:
        settings.follows -= {"FPS"}  # or the next Reload would take the scene's rate from the clip again
    _conform_own(scene, stride)
    if 0 < frames_of_clip_seen(scene) <= previewed:
        settings.coarse_digest = digest_of_preview(scene, EditRequest.of(scene).digest())
    baked = [body for body in settings.bodies if _carries_bake(body)]
    preview = len(shown_as_preview(scene)) == len(baked)
    if baked and (settings.coarse_take if preview else settings.simulated_take) and takes.simulated(settings, preview).is_dir():
        bake_bodies(scene, preview=preview)
    return stride


def set_stride(field: bpy.types.Object, stride: float) -> None:
    """Set the scene frames per clip frame of a field object, its values and its arrows.

    Raises:
        UsageError: when the field cannot be retimed.
    """
    if field.library is not None:
        raise UsageError(f"{field.name} is linked from another file.", "Conform it there, or append it here.")
    if STRIDE not in field:
        raise UsageError(f"{field.name} was made by an earlier version.", "Press Reload in the Recover panel first.")
    field[STRIDE] = stride
    _tell(field, FRAMES_PER_CLIP_FRAME, stride)


def begin_at(field: bpy.types.Object, frame: int) -> None:
    """Let a field object, its values and its arrows begin at a scene frame. Raises UsageError for one of another file."""
    if field.library is not None or field.override_library is not None:
        raise UsageError(f"{field.name} is linked from another file.", "Let it begin at another frame there, or append it here.")
    field["seeing_wind_frame_start"] = frame
    _tell(field, FIRST_FRAME, frame)


def begin_with_scene(scene: bpy.types.Scene, field: bpy.types.Object) -> str:
    """Let a wind from another file begin with the scene, if it would be over before the scene begins, or begin after the scene ends.

    A wind that loops is never over. Returns a message on what was changed; "" if nothing was.

    Raises:
        UsageError: when the wind needs moving but is linked.
    """
    first, last = blows_from_to(field)
    over = not field[LOOP] and last <= scene.frame_start
    if not over and first < scene.frame_end:
        return ""
    when = f"It blew from frame {first} to {last}, and the scene lasts from {scene.frame_start} to {scene.frame_end}"
    try:
        begin_at(field, scene.frame_start)
    except UsageError as error:
        raise UsageError(f"{error.message} {when}.", error.hint) from error
    return f"{field.name} begins with the scene now, at frame {scene.frame_start}. {when}"


def _tell(field: bpy.types.Object, name: str, value: float) -> None:
    """Set the input `name` of the modifiers of a field object's values and of its children, such as arrows."""
    field.update_tag()
    for obj in (samples_of(field), *field.children):
        for modifier in obj.modifiers if obj is not None and obj.library is None else ():
            if modifier.type == "NODES" and modifier_input(modifier, name) is not None:
                set_input(modifier, name, value)


def _poses(scene: bpy.types.Scene) -> np.ndarray | None:
    """`camera_to_world` (T+1, 4, 4) of the clip's camera, from the take; None if the camera stands still."""
    settings = scene.seeing_wind
    camera = settings.camera_object
    if camera is None or not curves_of(camera):
        return None
    take = Take(takes.shown(settings))
    seen = read_seen(take, field_summary(take))
    poses = None if seen is None else np.asarray(seen.camera.camera_to_world, dtype=np.float64)
    return poses if poses is not None and poses.ndim == 3 else None


def _conform_clip(scene: bpy.types.Scene, stride: float, poses: np.ndarray | None) -> None:
    """Retime the clip behind the scene, its mattes, and the clip's camera."""
    settings = scene.seeing_wind
    pace, clip = Pace(settings.frame_start, stride), clip_of(settings)
    if clip is not None:
        place_clip(scene, clip, first_clip_frame(settings), pace)
    if poses is not None:
        frames = range(pace.at, pace.frame_of(len(poses) - 1) + 1)
        shown = [min(pace.shown(frame), len(poses) - 1) for frame in frames]
        set_poses(settings.camera_object, poses[shown], metres_per_unit(scene), pace.at)
    keep_pace(scene, pace)
    keep_focus(scene, pace)
    scene.frame_set(scene.frame_current)


def said_of_own_camera(scene: bpy.types.Scene) -> str:
    """A message that the scene's active camera is not retimed; "" if it is the clip's camera or has no keyframes."""
    camera = scene.camera
    if camera is None or camera == scene.seeing_wind.camera_object or not curves_of(camera):
        return ""
    return f"{camera.name} has keyframes of your own, which keep their frames: move them where they must fit the clip"


def _frames_of_preview(scene: bpy.types.Scene) -> int:
    """Number of clip frames in the preview of the edit; 0 if there is no preview that is up to date."""
    settings = scene.seeing_wind
    if not settings.coarse_digest or settings.coarse_digest != digest_of_preview(scene, EditRequest.of(scene).digest()):
        return 0
    return frames_of_clip_seen(scene)


def _conform_own(scene: bpy.types.Scene, stride: float) -> None:
    """Retime the recovered object of a scene with its field; if the frame range follows the clip, also adapt its end."""
    settings = scene.seeing_wind
    start, field = settings.frame_start, settings.field_object
    obj = settings.recovered_object
    if obj is not None and obj.data.shape_keys is not None:
        retime(evaluation_time_curves(obj.data.shape_keys), start, start + stride * field["seeing_wind_frames"])
    if "RANGE" in settings.follows and is_field(field):
        scene.frame_end = start + math.ceil(stride * field["seeing_wind_frames"] - 1e-6)


def _carries_bake(body: bpy.types.PropertyGroup) -> bool:
    carrier = body.baked_copy or body.object
    return carrier is not None and mark_of(carrier) is not None
