"""The field object as it stands in the scene: place, strength and what becomes of it beside its box, as native solvers feel them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import bpy

from ...bake.animation import keyframes
from ...field.display import share
from .geometry import lineage, may_move_along

if TYPE_CHECKING:
    import numpy as np

ALIKE = 1e-6
"""Metres, and parts of one, by which the field may stand beside where it was recovered and still be there: single precision."""


def stamp(scene: bpy.types.Scene) -> tuple:
    """Of the field object as far as the re-simulation depends on it, keyframes in place of what they change."""
    obj = _field(scene)
    if obj is None:
        return ()
    keys = keyframes(obj)
    strength = "keyframes" if any(path == "field.strength" for path, _, _ in keys) else round(share(obj), 5)
    return (lineage(obj), keys, strength, obj.get("seeing_wind_reach", ""))


@dataclass(frozen=True)
class Standing:
    """As the engine reads it."""

    place: np.ndarray | None
    """(T, 4, 4) from the field's coordinates to the world's [m]; None where it was recovered."""
    share: list[float]
    """(T,) of the recovered strength."""
    ends: dict[str, Any]
    """`fade` or `falloff` of the edit, or neither."""


def standing(scene: bpy.types.Scene, box: np.ndarray, frames: list[float], metres: float) -> Standing:
    """The field object from each of a clip's frames to the next.

    Args:
        box: (2, 3) of the field as it was recovered [m].
        frames: scene frames of the T + 1 clip frames; the scene is left at the first.
        metres: length of a unit of the scene.
    """
    import numpy as np  # not above, see CONTRIBUTING.md

    from ...field.texture.reach import CONTINUE, FADE, reach_of

    obj = _field(scene)
    if obj is None:
        return Standing(None, [1.0] * (len(frames) - 1), {"fade": reach_of(FADE, box).width})
    # solvers go to a frame, and feel the field as it stands there
    asked = [int(frame // 1) + 1 for frame in frames[:-1]]
    matrices, shares = {}, {}
    for frame in asked if may_move_along(obj) else asked[:1]:
        scene.frame_set(frame)
        now = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrices[frame], shares[frame] = np.array(now.matrix_world, dtype=np.float64), share(now)
    scene.frame_set(int(frames[0] // 1), subframe=frames[0] % 1.0)
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
    """Where the re-simulation feels the recovered field and Blender's own solvers do not."""
    obj = _field(scene)
    if obj is None:
        return ["The field object was deleted: the recovered field acts where it was, and fades beside it. Reload brings the object back"]
    if obj.hide_viewport:
        return [f"{obj.name} is hidden in viewports, where Blender's own solvers do not feel it; the bodies here did"]
    return []


def _field(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The scene's field object, unless the user has deleted it: the recovered field blows on then, where it was."""
    obj = scene.seeing_wind.field_object
    return obj if obj is not None and scene in obj.users_scene else None
