"""A clip whose frames do not last one scene frame each: every scene frame shows the nearest clip frame.

Blender has no playback speed for movie clips. But the frame at which a clip begins can have a driver, which shifts it at every scene frame
so that the right clip frame is shown. Tracks and solves are stored by clip frame and stay valid. For an image sequence, the offset has
such a driver. Both drivers are plain arithmetic, which Blender also evaluates in files that it does not trust.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy

from ....engine.errors import UsageError
from ...field.display import stride_of

PACE = "seeing_wind_pace"
"""Custom property of a movie clip whose frames do not last one scene frame each: (first scene frame, first clip frame, stride)."""
JUST = 1e-6
"""Fraction of a frame, so that rounding errors do not decide between two equally near frames."""
LONG = 300_000
"""Blender's largest number of frames: an image sequence must not end before its images do."""


@dataclass(frozen=True)
class Pace:
    """Which clip frame is shown at which scene frame."""

    at: int
    """Scene frame of the first clip frame."""
    stride: float = 1.0
    """Scene frames that a clip frame lasts."""

    def shown(self, frame: int) -> int:
        """The clip frame, counted from the first one used, that a scene frame shows."""
        return math.floor((frame - self.at) / self.stride + 0.5 + JUST)

    def frame_of(self, number: int) -> int:
        """The scene frame nearest to clip frame `number`, counted from the first one used."""
        return math.floor(self.at + self.stride * number + 0.5 + JUST)

    @property
    def _shown(self) -> str:
        return f"floor((floor(frame) - {self.at}) / {self.stride!r} + {0.5 + JUST!r})"

    def beginning(self) -> str:
        """Driver expression: where the first clip frame must be for the right one to be shown now, if each lasted one scene frame."""
        return f"floor(frame) - {self._shown}"

    def offset(self, clip_frames: int) -> str:
        """Driver expression for the offset of an image sequence that begins at `at`; it holds its first and last image before and after."""
        return f"clamp({self._shown}, 0, {clip_frames - 1}) + 1 - max(floor(frame) - {self.at} + 1, 0)"


def pace_of_scene(scene: bpy.types.Scene) -> Pace:
    """The pace of a scene's recovered field, which everything from its take shares."""
    settings = scene.seeing_wind
    return Pace(settings.frame_start, stride_of(settings.field_object) if settings.field_object is not None else 1.0)


def set_pace(clip: bpy.types.MovieClip, clip_frame: int, pace: Pace) -> None:
    """Make a clip play at a pace, beginning with frame `clip_frame` of its file. A clip linked from another .blend file is unchanged.

    Raises:
        UsageError: for a linked clip whose frames would not last one scene frame each.
    """
    if clip.library is not None:
        if pace.stride != 1.0:
            raise UsageError(f"The clip {clip.name} is linked from another file.", "Make it local, then conform.")
        return
    if PACE in clip:
        clip.driver_remove("frame_start")
        del clip[PACE]
    # the offset is kept, since the user's tracks and camera solve count from it
    before = clip.frame_offset - clip_frame
    clip.frame_start = pace.at + before
    if pace.stride != 1.0:
        clip[PACE] = [float(pace.at), float(clip_frame), pace.stride]
        _drive(clip, "frame_start", f"{pace.beginning()} + {before}" if before >= 0 else f"{pace.beginning()} - {-before}")


def pace_of(clip: bpy.types.MovieClip) -> tuple[int, Pace]:
    """The first frame used of the clip's file, and the pace, which counts from it."""
    if PACE in clip:
        at, clip_frame, stride = clip[PACE]
        return int(clip_frame), Pace(int(at), stride)
    return 0, Pace(clip.frame_start - clip.frame_offset)


@contextmanager
def frame_by_frame(clip: bpy.types.MovieClip) -> Iterator[None]:
    """Show one clip frame per scene frame within the context, for callers that must visit every clip frame."""
    clip_frame, pace = pace_of(clip)
    if pace.stride == 1.0:
        yield
        return
    set_pace(clip, clip_frame, Pace(pace.at))
    try:
        yield
    finally:
        set_pace(clip, clip_frame, pace)


def set_pace_of_images(user: bpy.types.bpy_struct, clip_frames: int, pace: Pace) -> None:
    """Make an image sequence play at a pace, beginning with its first file.

    Args:
        user: an image user, or an image node of the compositor.
        clip_frames: number of images.
    """
    user.driver_remove("frame_offset")
    user.frame_start, user.frame_duration, user.frame_offset = pace.at, clip_frames, 0
    if pace.stride != 1.0:
        user.frame_duration = LONG
        _drive(user, "frame_offset", pace.offset(clip_frames))


def _drive(owner: bpy.types.bpy_struct, path: str, expression: str) -> None:
    driver = owner.driver_add(path).driver
    driver.type, driver.expression = "SCRIPTED", expression
