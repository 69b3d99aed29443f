"""How to bake a motion, the mark that records how an object was baked, and motion left behind when its body leaves the list.

Without NumPy, since a scene's status needs it at every change.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

MARK = "seeing_wind_bake"
"""Custom property of a baked object: JSON that records how it was baked, and what to restore."""

LEFT = "seeing_wind_left"
"""Custom property of an object that keeps the motion of a body no longer in the list."""

STANDS_FOR = "seeing_wind_stands_for"
"""Custom property of a copy: the object that it replaces, None if that is gone."""

SHAPE_KEYS, POINT_CACHE, TRANSFORM, ALEMBIC, USD, AUTO = "SHAPE_KEYS", "POINT_CACHE", "TRANSFORM", "ALEMBIC", "USD", "AUTO"

RIGID_TOLERANCE = 0.002
"""Fraction of the body's size: a deviation of 0.2 % is not visible. Elastic bodies that bend more do not count as rigid."""


@dataclass(frozen=True)
class Plan:
    """How a motion is to be baked."""

    frame_start: int
    """Scene frame of clip frame 0."""
    fps: float
    """Frame rate of the motion [1/s]."""
    way: str = AUTO
    frames: tuple[int, int] | None = None
    """First and last scene frame to bake, inclusive; None bakes all. Before and after them the body stands still."""
    cache: Path | None = None
    """Where a point cache goes, without its suffix; None where there is no place for one."""
    rigid_tolerance: float = RIGID_TOLERANCE
    """A body counts as rigid while no vertex deviates from a rigid motion by more than this fraction of the body's size."""
    stamp: str = ""
    """Hash of everything that the bake depends on: an object whose bake has this stamp is left alone. "" always bakes."""
    preview: bool = False
    """The motion is that of a preview."""
    smooth: int = 0
    """Number of smoothing passes, which remove ripples as short as an edge; see the module `smooth`."""
    reshaped: bool = False
    """The object's own modifiers or shape keys change its shape over time, see `at_rest.reshaped`."""
    frames_follow_time: bool = False
    """Keep the real speed if the scene's frame rate differs from `fps`; otherwise each clip frame lasts one scene frame."""


@dataclass(frozen=True)
class Baked:
    """What `bake_motion` did."""

    way: str
    frames: int
    residual: float
    """Largest distance of a vertex from the best rigid motion [m]."""
    kept: bool = False
    """The object already had this bake and was left alone."""


def plan_of(scene: bpy.types.Scene) -> Plan:
    """The plan that the scene's settings ask for; the caller fills in rate and cache, which depend on the motion."""
    settings = scene.seeing_wind
    frames = tuple(settings.bake_frames) if settings.bake_use_frames else None
    return Plan(
        settings.frame_start, 1.0, settings.bake_way, frames, rigid_tolerance=0.01 * settings.bake_tolerance,
        smooth=settings.bake_smooth, frames_follow_time=settings.real_time,
    )  # fmt: skip


def stamp_of_bakes(scene: bpy.types.Scene) -> str:
    """Stamp of the bake's settings, without the motion."""
    return repr(plan_of(scene)) + (f"{scene.render.fps / scene.render.fps_base:g}" if scene.seeing_wind.real_time else "")


def mark_of(obj: bpy.types.Object) -> dict[str, Any] | None:
    """The record of how an object was baked, from its mark; None for an object without a bake."""
    text = obj.get(MARK)
    if text is None:
        return None
    if text.startswith("{"):
        return json.loads(text)
    # before 0.2: names of the modifiers switched off, one per line
    return {"way": SHAPE_KEYS, "stamp": "", "slept": [[name, True, True] for name in text.splitlines()]}


def leave(body: bpy.types.PropertyGroup, source: bpy.types.Object | None) -> None:
    """Mark what carries the motion of a body that leaves the list, so that it can still be found; `source` is the body's object."""
    copy = body.baked_copy
    if copy is not None:
        copy[LEFT], copy[STANDS_FOR] = True, source
    elif source is not None and not body.is_recovered and source.library is None and MARK in source:
        source[LEFT] = True


def take_back(body: bpy.types.PropertyGroup, source: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Give an object that becomes a body again the motion that it kept when it left the list."""
    if LEFT in source:
        del source[LEFT]
    for copy in [obj for obj in left_in(scene) if obj.get(STANDS_FOR) == source]:
        body.baked_copy = copy
        del copy[LEFT], copy[STANDS_FOR]
        return


def left_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of a scene that carry baked motion of bodies no longer in the list."""
    return [obj for obj in scene.objects if LEFT in obj and MARK in obj and obj.library is None]
