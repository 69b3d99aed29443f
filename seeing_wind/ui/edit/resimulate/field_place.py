"""Field objects as placed in the scene: place, strength and reach outside the box, as Blender's own solvers feel them. No NumPy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import bpy

from ...bake.animation import keyframes, lineage, set_frame
from ...field.display import KIND, LOOP, STRIDE, is_field, share
from .geometry import may_move_along

if TYPE_CHECKING:
    import numpy as np

ALIKE = 1e-6
"""Largest difference from the identity matrix at which the field counts as not moved, times the largest coordinate of its box [m] if
above 1: single precision."""

OF_VALUES = ("seeing_wind_take", "seeing_wind_frame_start", "seeing_wind_frames", "seeing_wind_strength", STRIDE, LOOP, KIND)
"""Custom properties of a further field that tell which values it has, and when they act."""


def stamp(scene: bpy.types.Scene) -> tuple:
    """Everything about the field objects that the re-simulation depends on, with keyframes in place of the values they change."""
    obj = present_field(scene)
    others = [(_stamp_of(each), *(each[name] for name in OF_VALUES)) for each in further_fields(scene)]
    return (*(_stamp_of(obj) if obj is not None else ()), *others)


def further_fields(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The field objects that act beside the scene's own, if the edit asks for them; those disabled in viewports are left out."""
    settings = scene.seeing_wind
    if not settings.use_further_fields:
        return []
    found = {obj for obj in scene.objects if is_field(obj) and not obj.hide_viewport and obj != settings.field_object}
    return sorted(found, key=lambda obj: obj.name)


def _stamp_of(obj: bpy.types.Object) -> tuple:
    keys = keyframes(obj)
    strength = "keyframes" if any(path == "field.strength" for path, _, _ in keys) else round(share(obj), 5)
    return (lineage(obj), keys, strength, obj.get("seeing_wind_reach", ""))


@dataclass(frozen=True)
class Standing:
    """The placement of the field, in the form that the engine reads."""

    place: np.ndarray | None
    """(T, 4, 4) matrices from the field's coordinates to the world's [m]; None if the field stands where it was recovered."""
    share: list[float]
    """(T,) strength of the field object, as a factor on the recovered strength."""
    ends: dict[str, Any]
    """The edit's `fade` or `falloff`, or neither."""


def standing(
    obj: bpy.types.Object | None, scene: bpy.types.Scene, box: np.ndarray, frames: list[float], metres: float
) -> Standing:
    """The placement of a field object in each interval of a clip.

    Args:
        obj: None for the recovered field where the user has deleted its object.
        box: (2, 3) the field's box, where it was recovered [m].
        frames: scene frames of the T + 1 clip frames; the scene is left at the first.
        metres: length of one scene unit [m].
    """
    import numpy as np  # not above, see CONTRIBUTING.md

    from ...field.texture.reach import CONTINUE, FADE, reach_of

    if obj is None:
        return Standing(None, [1.0] * (len(frames) - 1), {"fade": reach_of(FADE, box).width})
    # a solver that steps to a frame feels the field as it is in that frame
    asked = [int(frame // 1) + 1 for frame in frames[:-1]]
    matrices, shares = {}, {}
    for frame in asked if may_move_along(obj) else asked[:1]:
        scene.frame_set(frame)
        now = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrices[frame], shares[frame] = np.array(now.matrix_world, dtype=np.float64), share(now)
    set_frame(scene, frames[0])
    world = np.stack([matrices.get(frame, matrices[asked[0]]) for frame in asked])
    world[:, :3, 3] = world[:, :3, 3] * metres - world[:, :3, :3] @ box.mean(axis=0)
    moved = np.abs(world - np.eye(4)).max() > ALIKE * max(1.0, float(np.abs(box).max()))
    reach = reach_of(obj["seeing_wind_reach"], box / metres)
    ends: dict[str, Any] = {}
    if reach.kind == FADE:
        ends = {"fade": reach.width * metres}
    elif reach.kind == CONTINUE:
        ends = {"falloff": [(1.0 + reach.radius) * metres, reach.power]}
    return Standing(world if moved else None, [shares.get(frame, shares[asked[0]]) for frame in asked], ends)


def said_of_field(scene: bpy.types.Scene) -> list[str]:
    """Messages on cases in which the re-simulation feels the recovered field but Blender's own solvers do not."""
    obj = present_field(scene)
    if obj is None:
        return ["The field object was deleted: the recovered field acts where it was, and fades beside it. Reload brings the object back"]
    if obj.hide_viewport:
        return [f"{obj.name} is hidden in viewports, where Blender's own solvers do not feel it; the bodies here did"]
    return []


def present_field(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The scene's field object; None if the user has deleted it, in which case the recovered field still acts where it was."""
    obj = scene.seeing_wind.field_object
    return obj if obj is not None and scene in obj.users_scene else None
