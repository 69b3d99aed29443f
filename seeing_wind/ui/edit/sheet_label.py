"""What the panel displays for a body of a thin material: the shell that it will be, and why it can be none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ...engine.conventions import in_units, weight_in_words
from ...engine.errors import UsageError
from ...engine.materials import SHEET_UNITS, SHEETS
from ..scene_units import metres_per_unit
from .resimulate.geometry import once_per_shape

if TYPE_CHECKING:
    import numpy as np

SAME = 1e-5
"""Relative difference below which areas count as equal: single precision."""
SHEET = tuple(SHEET_UNITS)
"""Options of a body that apply only to a shell."""


def open_area(obj: bpy.types.Object | None, scene: bpy.types.Scene) -> float:
    """Area [m²] of a mesh with a border, ignoring its modifiers; 0 for a closed mesh and for None. Coincident vertices count as joined."""
    import numpy as np  # not above, see CONTRIBUTING.md; as in the next two functions

    if obj is None or obj.type != "MESH" or not once_per_shape(obj, "open", lambda: _has_border(obj.data)):
        return 0.0
    places, corners = _arrays(obj.data)
    a, b, c = (places @ np.array(obj.matrix_world.to_3x3()).T)[corners].transpose(1, 0, 2)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) * metres_per_unit(scene) ** 2


def said_of_no_sheet(obj: bpy.types.Object) -> str:
    """Why Re-simulate would refuse a mesh of a thin material, in the same words; "" if it would not. Modifiers are ignored."""
    from ..scene_mesh import refuse_no_sheet

    places, corners = _arrays(obj.data)
    try:
        if len(corners):
            refuse_no_sheet(obj, places, corners)
    except UsageError as error:
        return f"{error.message} {error.hint}"
    return ""


def _has_border(mesh: bpy.types.Mesh) -> bool:
    from ..scene_mesh import joined_edges

    places, corners = _arrays(mesh)
    return len(corners) > 0 and bool((joined_edges(places, corners)[1] == 1).any())


def _arrays(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) in object space, and triangles (M, 3); in Edit Mode, as the user has changed them so far."""
    import bmesh
    import numpy as np

    if mesh.is_editmode:
        edited = bmesh.from_edit_mesh(mesh)
        edited.verts.index_update()
        faces = [[loop.vert.index for loop in loops] for loops in edited.calc_loop_triangles()]
        return np.array([vertex.co for vertex in edited.verts], np.float32).reshape(-1, 3), np.array(faces, np.int32).reshape(-1, 3)
    mesh.calc_loop_triangles()
    corners = np.empty((len(mesh.loop_triangles), 3), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners.reshape(-1))
    places = np.empty((len(mesh.vertices), 3), dtype=np.float32)
    mesh.vertices.foreach_get("co", places.reshape(-1))
    return places, corners


def measure(scene: bpy.types.Scene) -> None:
    """Store the present area of each body's mesh, and why it can be no sheet, so that drawing the panel need not compute them."""
    for body in scene.seeing_wind.bodies:
        obj, area, refusal = body.object, 0.0, ""
        if obj is not None and obj.type == "MESH":
            stretched = [round(value, 6) for row in obj.matrix_world.to_3x3() for value in row]
            area = once_per_shape(obj, f"area {stretched} {metres_per_unit(scene)}", lambda obj=obj: open_area(obj, scene))
            # modifiers may mend or spoil it, which is known when the mesh is written
            if body.material in SHEETS and not any(modifier.show_viewport for modifier in obj.modifiers):
                refusal = once_per_shape(obj, f"no sheet {obj.name}", lambda obj=obj: said_of_no_sheet(obj))
        if abs(area - body.open_area) > SAME * area:
            body.open_area = area
        if body.no_sheet != refusal:
            body.no_sheet = refusal


def is_shell(body: bpy.types.PropertyGroup) -> bool:
    """Whether a body will be simulated as a shell: its material is a sheet and its mesh is open."""
    return not body.is_recovered and body.material in SHEETS and body.open_area > 0.0


def sheet_words(body: bpy.types.PropertyGroup) -> str:
    """What becomes of a body of a thin material: areal density, mass and thickness of a shell, or that it is a solid; "" for any other."""
    if body.is_recovered or body.object is None or body.material not in SHEETS:
        return ""
    if not is_shell(body):
        return "A solid: its mesh is closed. Only an open mesh becomes cloth"
    sheet = SHEETS[body.material]
    thickness = body.thickness if body.use_thickness else sheet.thickness
    areal = body.areal_density if body.use_areal_density else sheet.areal_density
    areal = body.density * thickness if body.use_density else areal
    areal = (body.mass / body.open_area if body.use_mass else areal) * body.mass_scale
    return f"Shell, {weight_in_words(areal, body.open_area)}, {in_units(thickness, 'm', 2)} thick"
