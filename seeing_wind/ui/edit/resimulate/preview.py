"""A preview of the edit: a coarser re-simulation of the frames that are played or baked, stored apart from the full one. No NumPy."""

from __future__ import annotations

import math

import bpy

from ...bake.plan import mark_of
from ...field.display import frames_per_second
from ...job.status import digest_of

COARSENESS = 2.0
"""Factor on the spacing of particles: it leaves an eighth of them, and half the substeps."""


def last_seen(scene: bpy.types.Scene) -> int:
    """The last scene frame that is played, or baked."""
    settings, end = scene.seeing_wind, scene.frame_preview_end if scene.use_preview_range else scene.frame_end
    return min(end, settings.bake_frames[1]) if settings.bake_use_frames else end


def frames_seen(scene: bpy.types.Scene, stride: float) -> int | None:
    """Number of clip frames needed for the frames that are seen; None if the clip begins after these: then all are simulated.

    Args:
        stride: scene frames from one clip frame to the next.
    """
    frames = math.ceil((last_seen(scene) - scene.seeing_wind.frame_start) / stride - 1e-6)
    return frames if frames > 0 else None


def digest_of_preview(scene: bpy.types.Scene, edit: str) -> str:
    """Digest of all that the preview depends on; "" without bodies. `edit` is the digest of the full re-simulation."""
    return digest_of("preview", edit, frames_of_clip_seen(scene)) if edit else ""


def frames_of_clip_seen(scene: bpy.types.Scene) -> int:
    """Number of clip frames in a preview."""
    settings, field = scene.seeing_wind, scene.seeing_wind.field_object
    if field is None:
        return 0
    stride = frames_per_second(scene) / field["seeing_wind_fps"] if settings.real_time else 1.0
    every = int(field["seeing_wind_frames"])
    return min(frames_seen(scene, stride) or every, every)


def goes_before(scene: bpy.types.Scene, edit: str) -> bool:
    """Whether the preview takes precedence for the scene's edit: it is up to date and the full result is not, or there is none."""
    settings = scene.seeing_wind
    if not settings.coarse_take or (edit and settings.simulated_digest == edit):
        return False
    return not settings.simulated_take or settings.coarse_digest == digest_of_preview(scene, edit)


def shown_as_preview(scene: bpy.types.Scene) -> list[str]:
    """Names of the bodies that carry the motion of a preview."""
    carriers = {body.name: body.baked_copy or body.object for body in scene.seeing_wind.bodies}
    marks = {name: mark_of(obj) for name, obj in carriers.items() if obj is not None}
    return [name for name, mark in marks.items() if mark is not None and mark.get("preview")]
