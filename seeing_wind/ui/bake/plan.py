"""How a motion is to be baked, what an object says of how it was, and motion that is left when its body goes off the list.

Without NumPy: the status of a scene asks at every change.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

MARK = "seeing_wind_bake"
"""Custom property of an object that carries a bake: JSON of how it was made, and of what to restore."""

LEFT = "seeing_wind_left"
"""Custom property of an object that keeps the motion of a body which is no longer in the list."""

STANDS_FOR = "seeing_wind_stands_for"
"""Custom property of a copy that stands in for another object: that object, None where it is gone."""

SHAPE_KEYS, POINT_CACHE, TRANSFORM, ALEMBIC, USD, AUTO = "SHAPE_KEYS", "POINT_CACHE", "TRANSFORM", "ALEMBIC", "USD", "AUTO"

RIGID_TOLERANCE = 0.002
"""Of the body's size: a fifth of a percent is not seen. Elastic bodies that bend more are no rigid ones."""


@dataclass(frozen=True)
class Plan:
    """How a motion is to be baked."""

    frame_start: int
    """Scene frame of clip frame 0."""
    fps: float
    """Of the frames [1/s]."""
    way: str = AUTO
    frames: tuple[int, int] | None = None
    """First and last scene frame to bake, inclusive; None bakes all. Before and after them the body stands still."""
    cache: Path | None = None
    """Where a point cache goes, without its suffix; None where there is no place for one."""
    rigid_tolerance: float = RIGID_TOLERANCE
    """A body counts as rigid while no vertex is farther from a rigid motion than this part of the body's size."""
    stamp: str = ""
    """Of what the motion depends on: an object whose bake has this stamp is left alone. "" always bakes."""
    preview: bool = False
    """The motion is that of a preview."""
    smooth: int = 0
    """Passes that take ripples of an edge's length out of the motion, see `smooth`."""
    reshaped: bool = False
    """Modifiers or shape keys of the object's own change its shape as the scene plays, see `at_rest.reshaped`."""
    frames_follow_time: bool = False
    """Keep the speed where the scene's frame rate is another than `fps`; otherwise one scene frame is one clip frame, as in a take."""


@dataclass(frozen=True)
class Baked:
    """What `bake_motion` did."""

    way: str
    frames: int
    residual: float
    """Largest distance of a vertex from the best rigid motion [m]."""
    kept: bool = False
    """The object had this very bake already."""


def plan_of(scene: bpy.types.Scene) -> Plan:
    """How the scene's settings want motions to be baked; rate and cache are those of the motion."""
    settings = scene.seeing_wind
    frames = tuple(settings.bake_frames) if settings.bake_use_frames else None
    return Plan(
        settings.frame_start, 1.0, settings.bake_way, frames, rigid_tolerance=0.01 * settings.bake_tolerance,
        smooth=settings.bake_smooth, frames_follow_time=settings.real_time,
    )  # fmt: skip


def stamp_of_bakes(scene: bpy.types.Scene) -> str:
    """Of the settings of a bake, without the motion."""
    return repr(plan_of(scene)) + (f"{scene.render.fps / scene.render.fps_base:g}" if scene.seeing_wind.real_time else "")


def mark_of(obj: bpy.types.Object) -> dict[str, Any] | None:
    """How the bake that an object carries was made; None for no bake."""
    text = obj.get(MARK)
    if text is None:
        return None
    if text.startswith("{"):
        return json.loads(text)
    # before 0.2: the names of the sleeping modifiers, one per line
    return {"way": SHAPE_KEYS, "stamp": "", "slept": [[name, True, True] for name in text.splitlines()]}


def leave(body: bpy.types.PropertyGroup, source: bpy.types.Object | None) -> None:
    """A body goes off the list; `source` is the object that it moves. What carries its motion is known by its marks from now on."""
    copy = body.baked_copy
    if copy is not None:
        copy[LEFT], copy[STANDS_FOR] = True, source
    elif source is not None and not body.is_recovered and source.library is None and MARK in source:
        source[LEFT] = True


def take_back(body: bpy.types.PropertyGroup, source: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """An object is a body again, with the motion that it had then."""
    if LEFT in source:
        del source[LEFT]
    for copy in [obj for obj in left_in(scene) if obj.get(STANDS_FOR) == source]:
        body.baked_copy = copy
        del copy[LEFT], copy[STANDS_FOR]
        return


def left_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of a scene that keep the motion of bodies which are no longer in the list."""
    return [obj for obj in scene.objects if LEFT in obj and MARK in obj and obj.library is None]
