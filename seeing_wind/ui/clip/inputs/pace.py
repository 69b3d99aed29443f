"""A clip whose frames do not last a scene frame each: every frame of the scene shows the nearest one.

Blender has no speed for movie clips. It has the frame at which a clip begins, which may have a driver: from frame to frame it is moved so
that the right clip frame comes. Tracks and solves count clip frames and stay where they are. An image sequence has an offset, which
may have a driver, too. Both are plain arithmetic, which Blender evaluates in files that it does not trust.
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
"""Custom property of a movie clip whose frames do not last a scene frame each: (first scene frame, first clip frame, scene frames each)."""
JUST = 1e-6
"""Of a frame: rounding must not decide which one comes where two are as near."""
LONG = 300_000
"""Frames, the most that Blender has: an image sequence must not end before its images do."""


@dataclass(frozen=True)
class Pace:
    """Which frame is shown when."""

    at: int
    """Scene frame of the first clip frame."""
    stride: float = 1.0
    """Scene frames that a clip frame lasts."""

    def shown(self, frame: int) -> int:
        """Number of the clip frame, from the first, that a scene frame shows."""
        return math.floor((frame - self.at) / self.stride + 0.5 + JUST)

    def frame_of(self, number: int) -> int:
        """The scene frame nearest to a clip frame."""
        return math.floor(self.at + self.stride * number + 0.5 + JUST)

    @property
    def _shown(self) -> str:
        return f"floor((floor(frame) - {self.at}) / {self.stride!r} + {0.5 + JUST!r})"

    def beginning(self) -> str:
        """Driver: the frame where the first clip frame would be, if every clip frame lasted one frame."""
        return f"floor(frame) - {self._shown}"

    def offset(self, clip_frames: int) -> str:
        """Driver: of an image sequence that begins at `at`; its first and last frame stand still before and after."""
        return f"clamp({self._shown}, 0, {clip_frames - 1}) + 1 - max(floor(frame) - {self.at} + 1, 0)"


def pace_of_scene(scene: bpy.types.Scene) -> Pace:
    """That of a scene's recovered field: all that belongs to its take keeps it."""
    settings = scene.seeing_wind
    return Pace(settings.frame_start, stride_of(settings.field_object) if settings.field_object is not None else 1.0)


def set_pace(clip: bpy.types.MovieClip, clip_frame: int, pace: Pace) -> None:
    """Let a clip go by at a pace, with one frame of its file as the first.

    Raises:
        UsageError: for a clip of another file, whose frames would not last a scene frame each.
    """
    if clip.library is not None:
        if pace.stride != 1.0:
            raise UsageError(f"The clip {clip.name} is linked from another file.", "Make it local, then conform.")
        return
    if PACE in clip:
        clip.driver_remove("frame_start")
        del clip[PACE]
    # the offset stays: the user's tracks and camera solve count from it
    before = clip.frame_offset - clip_frame
    clip.frame_start = pace.at + before
    if pace.stride != 1.0:
        clip[PACE] = [float(pace.at), float(clip_frame), pace.stride]
        _drive(clip, "frame_start", f"{pace.beginning()} + {before}" if before >= 0 else f"{pace.beginning()} - {-before}")


def pace_of(clip: bpy.types.MovieClip) -> tuple[int, Pace]:
    """A frame of the clip's file, and the pace that counts from it."""
    if PACE in clip:
        at, clip_frame, stride = clip[PACE]
        return int(clip_frame), Pace(int(at), stride)
    return 0, Pace(clip.frame_start - clip.frame_offset)


@contextmanager
def frame_by_frame(clip: bpy.types.MovieClip) -> Iterator[None]:
    """Show one clip frame per scene frame meanwhile, for who has to see every one of them."""
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
    """The same for an image sequence whose first file is the first frame.

    Args:
        user: has `frame_start`, `frame_duration` and `frame_offset`: an image user, or an image node of the compositor.
    """
    user.driver_remove("frame_offset")
    user.frame_start, user.frame_duration, user.frame_offset = pace.at, clip_frames, 0
    if pace.stride != 1.0:
        user.frame_duration = LONG
        _drive(user, "frame_offset", pace.offset(clip_frames))


def _drive(owner: bpy.types.bpy_struct, path: str, expression: str) -> None:
    driver = owner.driver_add(path).driver
    driver.type, driver.expression = "SCRIPTED", expression
