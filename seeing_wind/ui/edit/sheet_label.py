"""What the panel says of a body that will be simulated as a shell."""

from __future__ import annotations

import bpy

from ...engine.materials import SHEETS
from ..scene_units import metres_per_unit


def open_area(obj: bpy.types.Object | None, scene: bpy.types.Scene) -> float:
    """Area [m²] of a mesh that has a border, without its modifiers; 0 for a closed one, and for None."""
    import numpy as np  # not above, see CONTRIBUTING.md

    if obj is None or obj.type != "MESH" or not len(obj.data.polygons):
        return 0.0
    mesh = obj.data
    edges = np.empty(len(mesh.loops), dtype=np.int32)
    mesh.loops.foreach_get("edge_index", edges)
    if not (np.bincount(edges) == 1).any():
        return 0.0
    mesh.calc_loop_triangles()
    corners = np.empty((len(mesh.loop_triangles), 3), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners.reshape(-1))
    places = np.empty((len(mesh.vertices), 3), dtype=np.float32)
    mesh.vertices.foreach_get("co", places.reshape(-1))
    a, b, c = (places @ np.array(obj.matrix_world.to_3x3()).T)[corners].transpose(1, 0, 2)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) * metres_per_unit(scene) ** 2


def measure(body: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Note the area of a body's mesh, so that drawing need not look for it."""
    scene = body.id_data
    if isinstance(scene, bpy.types.Scene):  # None while these are the arguments of an operator
        body.open_area = open_area(body.object, scene)


def shell_words(body: bpy.types.PropertyGroup) -> str:
    """Areal density and mass of a body that will be a shell, as its mesh was when it was inserted; "" for a solid."""
    sheet = SHEETS.get(body.material)
    if body.is_recovered or sheet is None or body.open_area <= 0.0:
        return ""
    areal = body.density * sheet.thickness if body.use_density else sheet.areal_density
    areal = (body.mass / body.open_area if body.use_mass else areal) * body.mass_scale
    return f"Shell, {areal:.3g} kg/m², {areal * body.open_area:.3g} kg"
