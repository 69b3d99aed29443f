"""Motion that was baked to bodies which are no longer in the list: it stays, and Clear Bake still finds it. Without NumPy."""

from __future__ import annotations

import bpy

from .plan import MARK

LEFT = "seeing_wind_left"
"""Custom property of an object with such a motion."""

STANDS_FOR = "seeing_wind_stands_for"
"""Custom property of a copy that stands in for another object: that object, None where it is gone."""


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
    """The objects of a scene with such a motion."""
    return [obj for obj in scene.objects if LEFT in obj and MARK in obj and obj.library is None]
