"""Particles for a mesh: a lattice inside parts that are closed and thick enough, two layers on the surface of all others.

A surface that encloses something without being a proper solid (see `voxels`) gets a lattice, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...conventions import in_units
from ...errors import UsageError
from ...mpm.lattice.closed_mesh import is_closed, signed_volume, triangle_areas, weld, winding_numbers
from ...records import Particles
from .voxels import Room, enclosed_room

COUNT = 2000
"""Default number of particles per body, approximately."""
MOST = 12_000
"""If a thin closed part needed more particles than this for a finer lattice, it gets two layers instead."""
LAYERS = 2.0
"""Fewest particles across a part for a lattice: a single layer cannot bend."""
_FEWEST = 8
"""A closed part with fewer lattice points inside than this gets two layers."""
_THINNEST = 1.2
"""A closed part that is thinner than this gets two layers, as a lattice would leave holes in it [spacings]."""


@dataclass(frozen=True)
class Filling:
    """The particles of a mesh, and notes for the user on how they were placed."""

    particles: Particles
    notes: list[str]
    layered: bool = False
    """Whether a part consists of two layers, which are one spacing apart."""


def fill(vertices: np.ndarray, triangles: np.ndarray, *, spacing: float | None = None) -> Filling:
    """Fill a mesh with about `COUNT` particles, or with particles `spacing` apart.

    The volumes of a closed mesh's particles sum to the mesh's volume. A surface that is not closed but still encloses something is filled
    by means of voxels. An open surface has no volume: it gets two layers with the thickness of two particles. A closed part that is too
    thin for a lattice gets two layers, too, and keeps its volume. Every connected part gets particles.

    Args:
        vertices: (V, 3) [m]; triangles: (M, 3).
        spacing: distance between neighbouring particles [m].

    Raises:
        UsageError: for a spacing that is not positive, or a mesh without any area.
    """
    if spacing is not None and not spacing > 0.0:
        raise UsageError(f"A mesh cannot be filled with particles {in_units(spacing, 'm')} apart.", "Give a distance above zero.")
    vertices, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(triangles)
    area, cross = triangle_areas(vertices, triangles)
    if area.sum() <= 0.0:
        raise UsageError("The mesh has no area: all its triangles are lines or points.", "Check the mesh and its scale.")
    sewn = weld(vertices, triangles)
    parts = connected_parts(sewn, len(vertices))
    closed = np.array([is_closed(sewn[parts == part]) for part in range(parts.max() + 1)])[parts]
    volume = abs(signed_volume(vertices, triangles[closed]))
    room = None if closed.all() else enclosed_room(vertices, triangles)
    walls = _walls(vertices, triangles, area, parts, room) & ~closed
    if room is not None and walls.any():
        volume += room.volume
    if spacing is None:
        spacing = _spacing_for(volume, area[closed | walls].sum(), area[~closed & ~walls].sum())
    in_room, room_volume = _in_room(vertices, triangles, closed, walls, room, spacing)
    walls &= len(in_room) >= _FEWEST

    inside, owner = _lattice(vertices, triangles[closed], parts[closed], spacing)
    caught = np.bincount(owner, minlength=parts.max() + 1)
    contents = part_volumes(vertices, triangles, parts)
    thickness = 2.0 * np.abs(contents) / np.maximum(np.bincount(parts, area), 1e-300)
    shell = (~closed & ~walls) | (closed & (caught < _FEWEST)[parts]) | (closed & (thickness < _THINNEST * spacing)[parts])
    in_bulk = ~np.isin(owner, np.unique(parts[shell]))
    x, sizes = [inside[in_bulk]], [_shares(owner[in_bulk], contents)]
    notes: list[str] = []
    if walls.any():
        x.append(in_room)
        sizes.append(np.full(len(in_room), room_volume / len(in_room)))
        notes.append("not a closed solid (open, crossing or turned faces): filled where it encloses something, holes closed")
    if shell.any():
        layers, volumes, said = _layers(vertices, triangles[shell], cross[shell], area[shell], closed[shell], spacing)
        x, sizes, notes = x + layers, sizes + volumes, notes + said
    particles = Particles(np.concatenate(x), np.concatenate(sizes), np.zeros(sum(map(len, x)), dtype=bool), float(spacing))
    return Filling(particles, notes, bool(shell.any()))


def _walls(vertices: np.ndarray, triangles: np.ndarray, area: np.ndarray, parts: np.ndarray, room: Room | None) -> np.ndarray:
    """(M,) bool: triangles of the parts that border on the room with most of their area."""
    if room is None:
        return np.zeros(len(triangles), dtype=bool)
    beside = room.borders(vertices[triangles].mean(axis=1))
    return (np.bincount(parts, area * beside) > 0.5 * np.bincount(parts, area))[parts]


def _in_room(
    vertices: np.ndarray, triangles: np.ndarray, closed: np.ndarray, walls: np.ndarray, room: Room | None, spacing: float
) -> tuple[np.ndarray, float]:
    """Lattice points (P, 3) in the room but in no closed part, and their total volume [m³]."""
    if room is None or not walls.any():
        return np.zeros((0, 3)), 0.0
    axes = _axes(vertices[np.unique(triangles[walls])], spacing)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    within = room.contains(points)
    alone = within & (winding_numbers(vertices, triangles[closed], axes).ravel() == 0) if closed.any() else within
    return points[alone], room.volume * float(alone.sum()) / max(float(within.sum()), 1.0)


def _shares(owner: np.ndarray, contents: np.ndarray) -> np.ndarray:
    """Volume (P,) [m³] of each lattice point: the points in a part share its volume; if one part is a cavity of another, all get equal
    volumes."""
    caught = np.bincount(owner, minlength=len(contents))
    volumes = contents[caught > 0]
    if len(volumes) and (np.sign(volumes) != np.sign(volumes[0])).any():
        return np.full(len(owner), abs(volumes.sum()) / len(owner))
    return np.abs(contents)[owner] / np.maximum(caught, 1)[owner]


def _spacing_for(volume: float, closed_area: float, open_area: float) -> float:
    """Spacing [m] for about `COUNT` particles in closed parts of `volume` and on open parts of `open_area`; thin parts get two layers."""
    shell = np.sqrt(LAYERS * open_area / COUNT) if open_area else 0.0
    if volume <= 0.0:
        return float(max(shell, np.sqrt(LAYERS * closed_area / COUNT)))
    spacing = (volume / COUNT) ** (1.0 / 3.0)
    thickness = 2.0 * volume / closed_area
    if thickness < LAYERS * spacing:
        fine = thickness / LAYERS
        spacing = fine if volume / fine**3 <= MOST else np.sqrt(0.5 * closed_area * LAYERS / COUNT)
    return float(max(spacing, shell))


# -- the mesh ---------------------------------------------------------------------------------------------------------------------


def part_volumes(vertices: np.ndarray, triangles: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """(P,) signed volume [m³] of each connected part: negative for the wall of a cavity, meaningless for open parts."""
    a, b, c = (vertices[triangles[:, k]] - vertices.mean(axis=0) for k in range(3))
    return np.bincount(parts, np.einsum("mi,mi->m", a, np.cross(b, c)) / 6.0)


def connected_parts(triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """(M,) number of the connected part to which each triangle belongs."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(vertex_count, vertex_count))
    label = connected_components(graph, directed=False)[1][triangles[:, 0]]
    return np.unique(label, return_inverse=True)[1].ravel()


# -- inside -----------------------------------------------------------------------------------------------------------------------


def _lattice(vertices: np.ndarray, triangles: np.ndarray, parts: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Lattice points (P, 3) inside closed triangles, and for each point the part (P,) whose surface is nearest."""
    if len(triangles) == 0:
        return np.zeros((0, 3)), np.zeros(0, dtype=int)
    axes = _axes(vertices[np.unique(triangles)], spacing)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    points = points[winding_numbers(vertices, triangles, axes).ravel() != 0]
    if len(points) == 0:
        return points, np.zeros(0, dtype=int)
    return points, parts[cKDTree(vertices[triangles].mean(axis=1)).query(points)[1]]


def _axes(vertices: np.ndarray, spacing: float) -> list[np.ndarray]:
    """Coordinates [m] along each axis of a lattice over the bounding box of the vertices."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    counts = np.maximum(np.ceil((high - low) / spacing).astype(int), 1)
    # Centred, but shifted off the round numbers at which modellers put vertices: a line through an edge would count the edge twice.
    start = 0.5 * (low + high) - 0.5 * (counts - 1) * spacing + spacing * np.array([1.37e-4, 2.11e-4, 0.0])
    return [start[c] + spacing * np.arange(counts[c]) for c in range(3)]


# -- shells -----------------------------------------------------------------------------------------------------------------------


def _layers(
    vertices: np.ndarray, triangles: np.ndarray, cross: np.ndarray, area: np.ndarray, closed: np.ndarray, spacing: float
) -> tuple[list[np.ndarray], list[np.ndarray], list[str]]:
    """The points (P, 3) [m] of two layers about the triangles, their volumes (P,) [m³], and notes. `closed` (M,) bool: of a closed part.

    Open parts get the thickness of two particles; closed but thin parts keep their volume.
    """
    points, normals, patch = sample_surface(vertices, triangles, cross, area, spacing)
    thin = abs(signed_volume(vertices, triangles[closed])) if closed.any() else 0.0
    offset = 0.5 * spacing * normals
    open_share = area[~closed].sum() / area.sum()
    total = 2.0 * spacing * area.sum() * open_share + thin
    each = patch / patch.sum() * max(total, 1e-12) / 2.0
    notes = [f"open surface: filled as a layer {in_units(2.0 * spacing, 'm')} thick"] if open_share > 0.0 else []
    if open_share < 1.0:
        notes.append("closed but thinner than its particles: filled as two layers of the same volume")
    return [points - offset, points + offset], [each, each], notes


def sample_surface(
    vertices: np.ndarray, triangles: np.ndarray, cross: np.ndarray, area: np.ndarray, spacing: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points about `spacing` apart on triangles.

    Returns:
        Points (P, 3) [m], unit normals (P, 3), and the area (P,) [m²] that each point represents.
    """
    rng = np.random.default_rng(0)
    dense = np.maximum(np.ceil(area / spacing**2 * 24.0), 1).astype(int)
    owner = np.repeat(np.arange(len(triangles)), dense)
    r, s = rng.random(len(owner)), rng.random(len(owner))
    flip = r + s > 1.0
    r, s = np.where(flip, 1.0 - r, r), np.where(flip, 1.0 - s, s)
    corners = vertices[triangles[owner]]
    dots = corners[:, 0] + r[:, None] * (corners[:, 1] - corners[:, 0]) + s[:, None] * (corners[:, 2] - corners[:, 0])
    share = (area / dense)[owner]
    chosen = _spread(dots, spacing)
    points = dots[chosen]
    for _ in range(4):  # Lloyd's relaxation evens out the distances
        nearest = cKDTree(points).query(dots)[1]
        weight = np.bincount(nearest, share, len(points))
        centre = np.stack([np.bincount(nearest, share * dots[:, c], len(points)) for c in range(3)], axis=1) / weight[:, None]
        points = dots[cKDTree(dots).query(centre)[1]]
    nearest = cKDTree(points).query(dots)[1]
    patch = np.bincount(nearest, share, len(points))
    unit = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    normal = unit[owner[cKDTree(dots).query(points)[1]]]
    return points[patch > 0], normal[patch > 0], patch[patch > 0]


def _spread(dots: np.ndarray, spacing: float) -> np.ndarray:
    """Indices of dots at least 0.75 spacings from each other, chosen greedily in the given (random) order."""
    neighbours = cKDTree(dots).query_ball_point(dots, 0.75 * spacing, return_sorted=False)
    free = np.ones(len(dots), dtype=bool)
    chosen = []
    for index, around in enumerate(neighbours):
        if free[index]:
            chosen.append(index)
            free[around] = False
    return np.array(chosen)
