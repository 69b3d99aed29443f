"""Objects of the scene as arrays: meshes as displayed, and the vertices of a vertex group."""

from __future__ import annotations

import bmesh
import bpy
import numpy as np

from ..engine.errors import UsageError

FIRM = 0.999
"""A vertex of this weight or more is held firmly; one of less is drawn back as by a spring."""

COPY_OF = "seeing_wind_copy_of"
"""Custom property of a temporary copy: the name of the object that it stands for."""

THINNEST = 1e-6
"""Smallest scale of an object relative to its largest: below it, keyframes in the object's space could not move it in the world."""

JOINED = 1e-6
"""Distance, relative to the mesh's size, below which vertices count as one: single precision."""

FLATTEST = 1e-6
"""Smallest area of a mesh relative to its length squared: in single precision, points on one line span up to a tenth of this."""


def name_of(obj: bpy.types.Object) -> str:
    """The name by which the user knows an object, even if a temporary copy stands for it."""
    return str(obj.get(COPY_OF, obj.name))


def mesh_arrays(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[np.ndarray, np.ndarray]:
    """An object as displayed: vertices (V, 3) float64 in the world, in the scene's units, and triangles (M, 3) int32, normals outwards.

    Raises:
        UsageError: when the object has no triangles, a vertex or a place that is not finite, or a scale of 0.
    """
    evaluated = obj.evaluated_get(depsgraph)
    try:
        mesh = evaluated.to_mesh()
    except RuntimeError as error:
        raise UsageError(f"{name_of(obj)} has no geometry.", "Choose a mesh object.") from error
    try:
        mesh.calc_loop_triangles()
        local = np.empty((len(mesh.vertices), 3), dtype=np.float32)
        triangles = np.empty((len(mesh.loop_triangles), 3), dtype=np.int32)
        mesh.vertices.foreach_get("co", local.reshape(-1))
        mesh.loop_triangles.foreach_get("vertices", triangles.reshape(-1))
    finally:
        evaluated.to_mesh_clear()
    if len(triangles) == 0:
        raise UsageError(f"{name_of(obj)} has no faces.", "Choose a mesh with a surface.")
    matrix = np.array(evaluated.matrix_world)
    if not (np.isfinite(local).all() and np.isfinite(matrix).all()):
        raise UsageError(f"{name_of(obj)} has vertices that are nowhere (not a number).", "Delete them, or the modifier that makes them.")
    stretch = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    if not stretch[-1] > THINNEST * stretch[0]:
        raise UsageError(f"{name_of(obj)} has a scale of 0.", "Give it another scale, or apply it (Object > Apply > Scale).")
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        # a mirrored object would turn its surface inside out
        triangles = triangles[:, ::-1]
    return local.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3], np.ascontiguousarray(triangles)


def solid_arrays(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[np.ndarray, np.ndarray]:
    """`mesh_arrays` of an object that is to be a body or a collider.

    Raises:
        UsageError: as for `mesh_arrays`, and when all faces are degenerate (lines or points).
    """
    vertices, triangles = mesh_arrays(obj, depsgraph)
    corners = vertices[triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    if not area > FLATTEST * np.ptp(corners, axis=(0, 1)).max() ** 2:
        raise UsageError(f"{name_of(obj)} has no area: all its faces are lines or points.", "Check the mesh and its scale.")
    return vertices, triangles


def has_inside(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether the faces of an object as displayed form a closed, consistently oriented surface; coincident vertices count as joined."""
    evaluated, body = obj.evaluated_get(depsgraph), bmesh.new()
    try:
        body.from_mesh(evaluated.to_mesh())
        corners = np.array([vertex.co for vertex in body.verts])
        bmesh.ops.remove_doubles(body, verts=body.verts, dist=JOINED * float(np.ptp(corners, axis=0).max()))
        return len(body.faces) > 0 and all(edge.is_contiguous for edge in body.edges if edge.link_faces)
    finally:
        body.free()
        evaluated.to_mesh_clear()


def joined_edges(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each vertex (V,) its number after coincident ones are joined, and of how many triangles each edge (E,) is part."""
    grid = JOINED * float(np.ptp(vertices, axis=0).max())
    joined = np.unique(np.round(vertices / grid), axis=0, return_inverse=True)[1].ravel()
    faces = joined[triangles]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return joined, np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0, return_counts=True)[1]


def refuse_no_sheet(obj: bpy.types.Object, vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Refuse an open mesh that cannot be simulated as a sheet. A mesh without a border is simulated as a solid and not checked here.

    Args:
        vertices, triangles: of the object, from `mesh_arrays`; coincident vertices count as joined.

    Raises:
        UsageError: when a vertex belongs to no face, or an edge to more than two.
    """
    joined, count = joined_edges(vertices, triangles)
    if not (count == 1).any():
        return
    loose, branching = int(joined.max()) + 1 - len(np.unique(joined[triangles])), int((count > 2).sum())
    if loose:
        raise UsageError(
            f"{name_of(obj)} has {loose} loose {'vertex' if loose == 1 else 'vertices'}, of no face, and cannot be a sheet.",
            "Delete loose vertices in Edit Mode (Mesh > Clean Up > Delete Loose).",
        )
    if branching:
        raise UsageError(
            f"{name_of(obj)} has {branching} {'edge' if branching == 1 else 'edges'} with three faces or more, and cannot be a sheet.",
            "If faces are doubled, use Mesh > Merge > By Distance in Edit Mode; else separate what branches there (Select > All by Trait > "
            "Non Manifold shows it), or give the mesh a thickness (Solidify modifier).",
        )


def pinned_vertices(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, group: str) -> tuple[np.ndarray, np.ndarray]:
    """Indices (n,) int64 of the evaluated mesh's vertices in a vertex group, and their weights (n,) in 0..1, without those of weight 0.

    Raises:
        UsageError: when there is no such group, or no vertex in it has a weight.
    """
    vertex_group = obj.vertex_groups.get(group)
    if vertex_group is None:
        raise UsageError(
            f"{name_of(obj)} has no vertex group {group!r}." if group else f"{name_of(obj)} has no vertex group that is active.",
            "Make one in Properties > Data > Vertex Groups and assign the vertices to hold.",
        )
    index, evaluated = vertex_group.index, obj.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    try:
        found = [(vertex.index, g.weight) for vertex in mesh.vertices for g in vertex.groups if g.group == index and g.weight > 0.0]
    finally:
        evaluated.to_mesh_clear()
    if not found:
        raise UsageError(f"No vertex of {name_of(obj)} has a weight in {group!r}.", "Assign the vertices to hold to that group.")
    return np.array([vertex for vertex, _ in found], dtype=np.int64), np.array([weight for _, weight in found], dtype=np.float64)
