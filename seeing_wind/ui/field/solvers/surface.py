"""The surface of a mesh as solvers see it."""

from __future__ import annotations

import bpy
import numpy as np


def faces_of(obj: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """World-space vertices (V, 3) [scene units] (without the object's location), and triangles (F, 3), with visible modifiers applied."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    places = np.empty((len(mesh.vertices), 3), dtype=np.float32)
    corners = np.empty((len(mesh.loop_triangles), 3), dtype=np.int32)
    mesh.vertices.foreach_get("co", places.reshape(-1))
    mesh.loop_triangles.foreach_get("vertices", corners.reshape(-1))
    matrix = np.array(evaluated.matrix_world)[:3, :3]
    evaluated.to_mesh_clear()
    return places @ matrix.T, corners


def area_of(places: np.ndarray, corners: np.ndarray) -> float:
    """Total area of triangles (F, 3) with vertices (V, 3), counting one side of each."""
    a, b, c = (places[corners[:, k]] for k in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def surface_of(obj: bpy.types.Object) -> float:
    """Area of an object that is exposed to air [scene units²]: the outside of a closed mesh, both sides of an open one."""
    places, corners = faces_of(obj)
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    is_open = (np.unique(edges, axis=0, return_counts=True)[1] == 1).any()
    return area_of(places, corners) * (2.0 if is_open else 1.0)
