"""Meshes that the tests insert into an edit, and where their vertices are."""

from __future__ import annotations

import bpy
import numpy as np


def cube(name: str, location: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    """A cube of 0.2 m."""
    bpy.ops.mesh.primitive_cube_add(size=0.2, location=location)
    bpy.context.object.name = name
    return bpy.context.object


def held_cube(name: str) -> bpy.types.Object:
    """The same with two vertices in the group *Top*."""
    group(cube(name), "Top", {0: 1.0, 1: 1.0})
    return bpy.context.object


def group(obj: bpy.types.Object, name: str, weights: dict[int, float]) -> None:
    """A vertex group of these vertices."""
    made = obj.vertex_groups.new(name=name)
    for vertex, weight in weights.items():
        made.add([vertex], weight, "REPLACE")


def world(obj: bpy.types.Object) -> np.ndarray:
    """World coordinates (V, 3) of the evaluated mesh."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([(evaluated.matrix_world @ vertex.co)[:] for vertex in evaluated.data.vertices])


def shown(obj: bpy.types.Object, frame: float) -> np.ndarray:
    """`world` at a scene frame."""
    bpy.context.scene.frame_set(int(frame // 1), subframe=frame % 1.0)
    return world(obj)
