"""Keyframes and animation curves, the same way in Blender 4 and 5, and digests of where objects stand that no frame changes."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator
from typing import Any

import bpy

PLACE = ("location", "rotation", "scale", "delta_")
"""Beginnings of the data paths that move an object."""
BEZIER, AUTOMATIC = 2, {1, 4}
"""Blender's numbers for Bézier interpolation, and for handles that it places by itself."""
PASSING = {"name", "active", "show_expanded", "select", "frame_start_ui", "frame_end_ui", "frame_start_raw", "frame_end_raw"}
"""Properties of a constraint or a strip that do not change what it does, or say the same as another."""


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


def keyframes(datablock: bpy.types.ID) -> list[tuple[str, int, tuple]]:
    """All keyframes of a datablock as plain values for a digest: data path, array index, and frames and values in turn, followed by what
    else shapes the curve if that is not Blender's default. Those in the NLA editor are followed by how their strip plays them."""
    found = _keys_of(curves_of(datablock))
    data = datablock.animation_data
    for track in data.nla_tracks if data is not None and data.use_nla else ():
        found += [(path, index, (*keys, *plays)) for strip in track.strips for path, index, keys, plays in _played(strip, track)]
    return found


def _keys_of(curves: Iterable[bpy.types.FCurve]) -> list[tuple[str, int, tuple]]:
    return [
        (curve.data_path, curve.array_index, (*(round(value, 5) for value in _of_keys(curve, "co", "f", 2)), *_shape_of(curve)))
        for curve in curves
    ]  # fmt: skip


def _played(strip: bpy.types.NlaStrip, owner: bpy.types.NlaTrack | bpy.types.NlaStrip) -> Iterator[tuple[str, int, tuple, tuple]]:
    """The curves that a strip, or the strips in it, play: data path, array index, keyframes, and how they are played."""
    inner = _keys_of(strip.fcurves)  # of the strip's own influence and time, which change them as the scene plays
    changed = {path for path, _, _ in inner} | {"strip_time"}
    settings = [
        (prop.identifier, _plain(getattr(strip, prop.identifier))) for prop in strip.bl_rna.properties
        if prop.type not in ("POINTER", "COLLECTION") and not prop.is_readonly and prop.identifier not in PASSING | changed
    ]  # fmt: skip
    plays = (getattr(owner, "is_solo", False), owner.mute, *settings, *inner)
    if strip.action is not None:
        curves = (curve for bag in _bags_in(strip.action, strip.action_slot) for curve in bag.fcurves)
        yield from ((*keys, plays) for keys in _keys_of(curves))
    for each in strip.strips:
        yield from ((path, index, keys, (*within, *plays)) for path, index, keys, within in _played(each, strip))


def _shape_of(curve: bpy.types.FCurve) -> tuple:
    """Interpolation, handles, extrapolation, modifiers and mute of an animation curve; empty if all are as for a key just inserted."""
    kinds = [_of_keys(curve, name, "i", 1) for name in ("interpolation", "handle_left_type", "handle_right_type")]
    plain = set(kinds[0]) <= {BEZIER} and set(kinds[1]) | set(kinds[2]) <= AUTOMATIC and curve.extrapolation == "CONSTANT"
    if plain and not curve.mute and not len(curve.modifiers):
        return ()
    handles = [
        round(value, 5) for name, types in (("handle_left", kinds[1]), ("handle_right", kinds[2]))
        for at, value in enumerate(_of_keys(curve, name, "f", 2)) if types[at // 2] not in AUTOMATIC
    ]  # fmt: skip
    modifiers = [(each.type, each.mute, each.influence) for each in curve.modifiers]
    return (*map(tuple, kinds), tuple(handles), curve.extrapolation, curve.mute, *modifiers)


def _of_keys(curve: bpy.types.FCurve, name: str, kind: str, count: int) -> array:
    """A property of all keyframes of a curve: `count` numbers each, of the array type `kind`."""
    flat = array(kind, bytes(4 * count * len(curve.keyframe_points)))
    curve.keyframe_points.foreach_get(name, flat)
    return flat


def set_frame(scene: bpy.types.Scene, frame: float) -> None:
    """Set a scene to a frame, which may lie between two whole ones and before frame 0."""
    scene.frame_set(int(frame // 1), subframe=float(frame % 1.0))


def with_parents(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """An object and all its parents, from the nearest on."""
    found = [obj]
    while found[-1].parent is not None:
        found.append(found[-1].parent)
    return found


def lineage(obj: bpy.types.Object) -> list[tuple]:
    """Where an object stands, for a digest: transforms of it and its parents, and their constraints with where the targets stand.

    Keyframes and drivers stand in for the values they change, so that it is the same in every frame. Nothing needs to be evaluated, which
    Blender has not done yet in a file just opened.
    """
    return _lineage(obj, set())


def _lineage(obj: bpy.types.Object, seen: set[bpy.types.Object]) -> list[tuple]:
    above = [each for each in with_parents(obj) if each not in seen]
    seen.update(above)
    return [(_own_place(each), rounded(each.matrix_parent_inverse), *_ties(each, seen)) for each in above]


def _own_place(obj: bpy.types.Object) -> list:
    moved = [*keys_of_place(obj), *(driver for driver in drivers_of(obj) if driver[0].startswith(PLACE))]
    if not moved:
        return rounded(obj.matrix_basis)
    taken = {each[:2] for each in moved}
    turn = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}.get(obj.rotation_mode, "rotation_euler")
    names = ("location", turn, "scale", "delta_location", "delta_rotation_euler", "delta_scale")
    still = ((name, index, round(value, 5)) for name in names for index, value in enumerate(getattr(obj, name)))
    return moved + [each for each in still if each[:2] not in taken]


def _ties(obj: bpy.types.Object, seen: set[bpy.types.Object]) -> list[tuple]:
    """The constraints of an object: settings, keyframes and drivers in place of those they change, and where the targets stand."""
    changes = [each for each in (*keyframes(obj), *drivers_of(obj)) if each[0].startswith("constraints[")]
    taken, found = {each[0] for each in changes}, []
    for one in obj.constraints:
        names = [prop.identifier for prop in one.bl_rna.properties if prop.type != "POINTER" and not prop.is_readonly]
        values = [(name, _plain(getattr(one, name))) for name in names if name not in PASSING and one.path_from_id(name) not in taken]
        target = getattr(one, "target", None)
        found.append((one.type, values, _lineage(target, seen) if target is not None else ()))
    return found + changes


def _plain(value: Any) -> Any:
    """A property's value for a digest."""
    if isinstance(value, float):
        return round(value, 5)
    if isinstance(value, (bool, int, str)):
        return value
    return [_plain(each) for each in (sorted(value) if isinstance(value, set) else value)]


def keys_of_place(obj: bpy.types.Object) -> list[tuple[str, int, tuple]]:
    """The keyframes that move an object."""
    return [curve for curve in keyframes(obj) if curve[0].startswith(PLACE)]


def drivers_of(datablock: bpy.types.ID) -> list[tuple[str, int, str]]:
    """All drivers of a datablock as plain values for a digest: data path, array index, and expression."""
    data = datablock.animation_data
    return [(each.data_path, each.array_index, each.driver.expression) for each in (data.drivers if data is not None else ())]


def rounded(matrix: Iterable[Iterable[float]]) -> list[float]:
    """A matrix as plain values for a digest."""
    return [round(value, 5) for row in matrix for value in row]


def values_over(scene: bpy.types.Scene, owner: bpy.types.bpy_struct, name: str, frames: Iterable[float]) -> list[float]:
    """A numeric property of the scene (or of something in it) at each of these frames; just the present value if it has no keyframes."""
    path = owner.path_from_id(name)
    curve = next((each for each in curves_of(scene) if each.data_path == path), None)
    if curve is None or curve.mute:
        return [float(getattr(owner, name))]
    return [float(curve.evaluate(frame)) for frame in frames]


def _bags(datablock: bpy.types.ID) -> list[bpy.types.ActionChannelbag]:
    data = datablock.animation_data
    return [] if data is None or data.action is None else _bags_in(data.action, data.action_slot)


def _bags_in(action: bpy.types.Action, slot: bpy.types.ActionSlot | None) -> list[bpy.types.ActionChannelbag]:
    return [bag for layer in action.layers for strip in layer.strips for bag in strip.channelbags if bag.slot == slot]
