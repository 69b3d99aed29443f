"""Keyframes and animation curves, the same way in Blender 4 and 5."""

from __future__ import annotations

from array import array
from collections.abc import Iterable

import bpy


def curves_of(datablock: bpy.types.ID) -> list[bpy.types.FCurve]:
    """The animation curves of a datablock, read through layers, strips and channel bags (the only way in Blender 5)."""
    bag = _bags(datablock)
    return [curve for each in bag for curve in each.fcurves]


def remove_curves(datablock: bpy.types.ID, paths: Iterable[str]) -> None:
    """Remove the curves of these data paths, and an action that is then empty and unused."""
    wanted = set(paths)
    for bag in _bags(datablock):
        for curve in [curve for curve in bag.fcurves if curve.data_path in wanted]:
            bag.fcurves.remove(curve)
    if datablock.animation_data is None or datablock.animation_data.action is None or curves_of(datablock):
        return
    action = datablock.animation_data.action
    datablock.animation_data.action = None
    if action.users == 0:
        bpy.data.actions.remove(action)
    if not datablock.animation_data.nla_tracks and not datablock.animation_data.drivers:
        datablock.animation_data_clear()


def retime(curves: Iterable[bpy.types.FCurve], first: float, last: float) -> None:
    """Rescale animation curves to span the scene frames `first` to `last`; keyframes keep their relative positions."""
    for curve in curves:
        points = curve.keyframe_points
        begin, end = points[0].co.x, points[-1].co.x
        for point in points:
            point.co_ui.x = first + (point.co.x - begin) * (last - first) / max(end - begin, 1e-6)
        curve.update()


def make_linear(datablock: bpy.types.ID, paths: Iterable[str]) -> None:
    """Interpolate linearly between the keyframes of these data paths, so that nothing overshoots between frames."""
    wanted = set(paths)
    for curve in curves_of(datablock):
        if curve.data_path in wanted:
            for point in curve.keyframe_points:
                point.interpolation = "LINEAR"
            curve.update()


def keyframes(datablock: bpy.types.ID) -> list[tuple[str, int, tuple[float, ...]]]:
    """All keyframes of a datablock as plain values for a digest: data path, array index, and frames and values in turn."""
    found = []
    for curve in curves_of(datablock):
        flat = array("f", bytes(8 * len(curve.keyframe_points)))
        curve.keyframe_points.foreach_get("co", flat)
        found.append((curve.data_path, curve.array_index, tuple(round(value, 5) for value in flat)))
    return found


def values_over(scene: bpy.types.Scene, owner: bpy.types.bpy_struct, name: str, frames: Iterable[float]) -> list[float]:
    """A numeric property of the scene (or of something in it) at each of these frames; just the present value if it has no keyframes."""
    path = owner.path_from_id(name)
    curve = next((each for each in curves_of(scene) if each.data_path == path), None)
    if curve is None or curve.mute:
        return [float(getattr(owner, name))]
    return [float(curve.evaluate(frame)) for frame in frames]


def _bags(datablock: bpy.types.ID) -> list[bpy.types.ActionChannelbag]:
    data = datablock.animation_data
    if data is None or data.action is None:
        return []
    return [bag for layer in data.action.layers for strip in layer.strips for bag in strip.channelbags if bag.slot == data.action_slot]
