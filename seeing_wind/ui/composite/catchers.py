"""Shadow catchers of the edit: a floor, a wall behind it, and its obstacles."""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.errors import UsageError
from ..bake.animation import set_frame
from .own import own_object

FLOOR, WALL = "Seeing Wind Floor", "Seeing Wind Wall"
REACH = 4.0
"""Half a side of floor and wall over the size of what stands before them."""


def set_catchers(scene: bpy.types.Scene, floor: bool, wall: bool) -> list[str]:
    """Add or hide floor and wall, and make every obstacle of the edit a shadow catcher. Returns the catchers, in words.

    An existing floor or wall keeps the pose that the user gave it, so that it can stand for any flat surface in the clip.

    Raises:
        UsageError: when no object could cast a shadow.
    """
    said = []
    for name, wanted, words in ((FLOOR, floor, "a floor that catches shadows"), (WALL, wall, "a wall that catches shadows")):
        obj = own_object(scene, name)
        if obj is None and wanted:
            obj = _plane(scene, name)
        if obj is not None:
            obj.hide_render = not wanted
        said += [words] * wanted
    walls = [each.object for each in scene.seeing_wind.colliders if each.object is not None and each.object.name in scene.objects]
    for obj in walls:
        obj.is_shadow_catcher = True
    return said + [f"shadows on {', '.join(obj.name for obj in walls[:3])}"] * bool(walls)


def _plane(scene: bpy.types.Scene, name: str) -> bpy.types.Object:
    """Add the floor, level below all bodies, or the wall, upright behind them as seen from the camera."""
    corners = _corners(scene)
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = float((high - low).max()) or 1.0
    obj = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    reach = REACH * size
    obj.data.from_pydata([(-reach, -reach, 0), (reach, -reach, 0), (reach, reach, 0), (-reach, reach, 0)], [], [(0, 1, 2, 3)])
    middle = 0.5 * (low + high)
    if name == FLOOR:
        obj.location = (middle[0], middle[1], low[2])
    else:
        away = np.array(scene.camera.matrix_world.to_3x3())[:, 2] * [-1.0, -1.0, 0.0]  # horizontal, since walls are upright
        away = away / np.linalg.norm(away) if np.linalg.norm(away) > 1e-3 else np.array([0.0, 1.0, 0.0])
        behind = float(((corners - middle) @ away).max()) + 0.05 * size
        obj.location = middle + behind * away
        obj.rotation_euler = (0.5 * np.pi, 0.0, float(np.arctan2(away[1], away[0])) - 0.5 * np.pi)
    obj.is_shadow_catcher, obj.display_type = True, "WIRE"
    # otherwise the white plane would reflect light onto the edit
    obj.visible_diffuse = obj.visible_glossy = obj.visible_transmission = False
    scene.collection.objects.link(obj)
    return obj


def _corners(scene: bpy.types.Scene) -> np.ndarray:
    """Corners (8 N, 3) of the bounding boxes of bodies and recovered object, at five frames of the scene's range."""
    settings, found, at = scene.seeing_wind, [], scene.frame_current_final
    bodies = [body.baked_copy or (settings.recovered_object if body.is_recovered else body.object) for body in settings.bodies]
    objects = [obj for obj in (*bodies, settings.recovered_object) if obj is not None]
    if not objects:
        raise UsageError("There is nothing that could throw a shadow.", "Insert a mesh, or leave floor and wall out.")
    for frame in np.linspace(scene.frame_start, scene.frame_end, 5):
        set_frame(scene, frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for obj in objects:
            evaluated = obj.evaluated_get(depsgraph)
            matrix = np.array(evaluated.matrix_world)
            found.append(np.array([corner[:] for corner in evaluated.bound_box]) @ matrix[:3, :3].T + matrix[:3, 3])
    set_frame(scene, at)
    return np.concatenate(found)
