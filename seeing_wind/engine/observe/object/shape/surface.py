"""A closed triangle mesh of the body: the visible surface, its back, and a rim between them."""

from __future__ import annotations

import contourpy
import numpy as np
from scipy import ndimage
from scipy.spatial import Delaunay, QhullError

from ....errors import ObjectError
from ....records import Surface
from ..motion.control import attach
from .relief import Relief, sample

VERTICES = 900
"""About how many vertices front and back have together."""

MIN_STEP = 1.5
"""Least distance between vertices in the frame [px]."""

BIGGER = "Use a clip of higher resolution, or crop it round the object."

OUTLINE_BLUR = 0.7
"""Standard deviation of the Gaussian that smooths the staircase of the mask's outline [px]."""


def surface_of(relief: Relief, particles_x: np.ndarray) -> Surface:
    """Mesh of the body in frame 0, normals outward, every edge shared by two triangles.

    Args:
        particles_x: (N, 3) particles that the vertices ride on [m].

    Raises:
        ObjectError: the silhouette is too thin to carry a triangle.
    """
    step = max(MIN_STEP, float(np.sqrt(2.0 * relief.mask.sum() / VERTICES)))
    xy, triangles = silhouette_triangles(relief.mask, step)
    vertices = np.concatenate([relief.points(xy, 0.0), relief.points(xy, 1.0)])
    height, width = relief.mask.shape
    uv = np.stack([(xy[:, 0] + 0.5) / width, 1.0 - (xy[:, 1] + 0.5) / height], axis=1)
    return Surface(
        vertices=vertices,
        triangles=close_surface(triangles, len(xy)).astype(np.int32),
        uv=np.clip(np.concatenate([uv, uv]), 0.0, 1.0),
        attachment=attach(vertices, particles_x),
    )


def silhouette_triangles(mask: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangles over a mask (H, W) with vertices about `step` pixels apart, on its outline and inside.

    Returns:
        vertices (V, 2) [px] and triangles (M, 3), all counter-clockwise in (x right, y down), edge-manifold with boundary.
    """
    soft = ndimage.gaussian_filter(np.pad(mask, 4).astype(float), OUTLINE_BLUR)
    outline = _outline(soft, step)
    inside = ndimage.distance_transform_edt(np.pad(mask, 4))
    lattice = np.stack(np.meshgrid(np.arange(0.0, soft.shape[1], step), np.arange(0.0, soft.shape[0], step)), axis=-1).reshape(-1, 2)
    lattice = lattice[sample(inside, lattice) > 0.7 * step + 0.5]
    points = np.concatenate([outline, lattice]) if len(lattice) else outline
    if len(points) < 3:
        raise ObjectError("The object is too small for a surface.", BIGGER)
    try:
        triangles = Delaunay(points).simplices
    except QhullError as error:
        raise ObjectError("The object is too thin for a surface.", BIGGER) from error
    corners = points[triangles]
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    triangles = np.where((area > 0.0)[:, None], triangles, triangles[:, ::-1])
    triangles = triangles[(np.abs(area) > 1e-3 * step**2) & (sample(soft, corners.mean(axis=1)) > 0.5)]
    triangles = without_pinches(triangles)
    if len(triangles) == 0:
        raise ObjectError("The object is too thin for a surface.", BIGGER)
    used, renumbered = np.unique(triangles, return_inverse=True)
    return points[used] - 4.0, renumbered.reshape(-1, 3)


def boundary_edges(triangles: np.ndarray) -> np.ndarray:
    """The directed edges (B, 2) that belong to one only of the triangles (M, 3), which are consistently oriented."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    size = int(triangles.max(initial=0)) + 1
    key, opposite = edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0]
    return edges[~np.isin(key, opposite)]


def without_pinches(triangles: np.ndarray) -> np.ndarray:
    """Remove triangles until no two fans meet in a single vertex, where the rim would not be a manifold; the larger fan stays."""
    while len(triangles):
        starts, counts = np.unique(boundary_edges(triangles)[:, 0], return_counts=True)
        pinched = starts[counts > 1]
        if len(pinched) == 0:
            break
        removed = np.zeros(len(triangles), dtype=bool)
        for vertex in pinched:
            around = np.flatnonzero((triangles == vertex).any(axis=1) & ~removed)
            fans = _fans(triangles[around], int(vertex))
            largest = max(fans, key=len, default=[])
            for fan in fans:
                if fan is not largest:
                    removed[around[fan]] = True
        triangles = triangles[~removed]
    return triangles


def close_surface(triangles: np.ndarray, count: int) -> np.ndarray:
    """Close a sheet of triangles (M, 3) over `count` vertices with a back, whose vertices are numbered from `count`, and a rim.

    The input is counter-clockwise in (x right, y down), so its normals point away from the camera: the front gets reversed triangles.
    """
    front, back = triangles[:, ::-1], triangles + count
    a, b = boundary_edges(front).T
    rim = np.concatenate([np.stack([b, a, a + count], axis=1), np.stack([b, a + count, b + count], axis=1)])
    return np.concatenate([front, back, rim])


def _outline(soft: np.ndarray, step: float) -> np.ndarray:
    """Points (B, 2) [px] on the outlines of a soft mask, `step` [px] apart."""
    pieces: list[np.ndarray] = []
    lines = [np.asarray(line) for line in contourpy.contour_generator(z=soft, line_type="Separate").lines(0.5)]
    for line in lines:
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        number = int(round(length[-1] / step))
        if number < 3:
            continue
        at = np.linspace(0.0, length[-1], number, endpoint=False)
        pieces.append(np.stack([np.interp(at, length, line[:, i]) for i in range(2)], axis=1))
    return np.concatenate(pieces) if pieces else np.empty((0, 2))


def _fans(triangles: np.ndarray, vertex: int) -> list[list[int]]:
    """Groups of triangles round a vertex that are connected through edges at that vertex."""
    fans: list[tuple[set[int], list[int]]] = []
    for number, triangle in enumerate(triangles):
        others, members = {int(v) for v in triangle if v != vertex}, [number]
        for fan in [fan for fan in fans if fan[0] & others]:
            others, members = others | fan[0], members + fan[1]
            fans.remove(fan)
        fans.append((others, members))
    return [members for _, members in fans]
