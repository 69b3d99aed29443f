"""Particles for a mesh: a lattice inside what is closed and thick enough, a shell of two layers on everything else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..errors import UsageError
from ..records import Particles

COUNT = 2000
"""Particles per body, roughly, where nothing else is asked."""
MOST = 12_000
"""Particles beyond which a thin closed part becomes a shell instead of a finer lattice."""
LAYERS = 2.0
"""A part is thick enough for a lattice if that many particles lie across it: one layer alone cannot bend."""
_FEWEST = 8
"""A closed part that catches fewer lattice points than this becomes a shell, as does one thinner than"""
_THINNEST = 1.2
"""times the spacing: the lattice would leave holes in it."""


@dataclass(frozen=True)
class Filling:
    """The particles of a mesh, and what the user should know of how they were placed."""

    particles: Particles
    notes: list[str]


def fill(vertices: np.ndarray, triangles: np.ndarray, *, spacing: float | None = None, count: int = COUNT) -> Filling:
    """Fill a mesh with about `count` particles, or with particles `spacing` apart.

    The volumes of a closed mesh's particles sum to the mesh's volume. An open surface has none: it becomes a shell as thick as two
    particles, and so does a closed part too thin for the lattice (which keeps its volume). Every connected part gets particles.

    Args:
        vertices: (V, 3) [m]; triangles: (M, 3).
        spacing: distance between neighbouring particles [m].
        count: wanted number of particles, if no spacing is given; a lower number where it would leave nothing.

    Raises:
        UsageError: a count or spacing that is not positive, or a mesh without any area.
    """
    if count < 1 or (spacing is not None and not spacing > 0.0):
        raise UsageError(f"A mesh cannot be filled with {count} particles {spacing} m apart.", "Give positive numbers.")
    vertices, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(triangles)
    area, cross = triangle_areas(vertices, triangles)
    if area.sum() <= 0.0:
        raise UsageError("The mesh has no area: all its triangles are lines or points.", "Check the mesh and its scale.")
    sewn = weld(vertices, triangles)
    parts = connected_parts(sewn, len(vertices))
    closed = np.array([is_closed(sewn[parts == part]) for part in range(parts.max() + 1)])[parts]
    volume = abs(signed_volume(vertices, triangles[closed]))
    if spacing is None:
        spacing = _spacing_for(volume, area[closed].sum(), area[~closed].sum(), count)

    inside, owner = _lattice(vertices, triangles[closed], parts[closed], spacing)
    caught = np.bincount(owner, minlength=parts.max() + 1)
    contents = part_volumes(vertices, triangles, parts)
    thickness = 2.0 * np.abs(contents) / np.maximum(np.bincount(parts, area), 1e-300)
    shell = ~closed | (caught < _FEWEST)[parts] | (thickness < _THINNEST * spacing)[parts]
    in_bulk = ~np.isin(owner, np.unique(parts[shell]))
    x, sizes = [inside[in_bulk]], [_shares(owner[in_bulk], contents)]
    notes: list[str] = []
    if shell.any():
        points, normals, patch = sample_surface(vertices, triangles[shell], cross[shell], area[shell], spacing)
        shell_closed = triangles[shell & closed]
        thin = abs(signed_volume(vertices, shell_closed)) if len(shell_closed) else 0.0
        offset = 0.5 * spacing * normals
        x += [points - offset, points + offset]
        open_share = area[shell & ~closed].sum() / area[shell].sum()
        # What is open gets two particles' thickness; what is closed but thin keeps the volume that it has.
        total = 2.0 * spacing * area[shell].sum() * open_share + thin
        each = patch / patch.sum() * max(total, 1e-12) / 2.0
        sizes += [each, each]
        if open_share > 0.0:
            notes.append(f"open surface: simulated as a shell {2000.0 * spacing:.3g} mm thick")
        if open_share < 1.0:
            notes.append("closed but thinner than its particles: simulated as a shell of the same volume")
    particles = Particles(np.concatenate(x), np.concatenate(sizes), np.zeros(sum(map(len, x)), dtype=bool), float(spacing))
    return Filling(particles, notes)


def _shares(owner: np.ndarray, contents: np.ndarray) -> np.ndarray:
    """Volume (P,) [m³] of lattice points: those of a part share its volume; where a part bounds a cavity of another, all share alike."""
    caught = np.bincount(owner, minlength=len(contents))
    volumes = contents[caught > 0]
    if len(volumes) and (np.sign(volumes) != np.sign(volumes[0])).any():
        return np.full(len(owner), abs(volumes.sum()) / len(owner))
    return np.abs(contents)[owner] / np.maximum(caught, 1)[owner]


def _spacing_for(volume: float, closed_area: float, open_area: float, count: int) -> float:
    """Spacing [m] at which closed parts of `volume` and open ones of `open_area` take about `count` particles, two layers for thin ones."""
    shell = np.sqrt(LAYERS * open_area / count) if open_area else 0.0
    if volume <= 0.0:
        return float(max(shell, np.sqrt(LAYERS * closed_area / count)))
    spacing = (volume / count) ** (1.0 / 3.0)
    thickness = 2.0 * volume / closed_area
    if thickness < LAYERS * spacing:
        fine = thickness / LAYERS
        spacing = fine if volume / fine**3 <= MOST else np.sqrt(0.5 * closed_area * LAYERS / count)
    return float(max(spacing, shell))


# -- the mesh ---------------------------------------------------------------------------------------------------------------------


def weld(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles (M, 3) in which vertices at the same place go by one number: many files repeat vertices at texture seams."""
    size = max(float(np.ptp(vertices, axis=0).max()), 1e-300)
    return np.unique(np.round(vertices / (1e-7 * size)), axis=0, return_inverse=True)[1].ravel()[triangles]


def triangle_areas(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Areas (M,) [m²] and edge cross products (M, 3) of triangles."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    return 0.5 * np.linalg.norm(cross, axis=1), cross


def signed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Volume [m³] that a closed surface encloses, positive if its normals point outwards (divergence theorem)."""
    if len(triangles) == 0:
        return 0.0
    shifted = vertices - vertices[triangles[:, 0]].mean(axis=0)
    a, b, c = (shifted[triangles[:, k]] for k in range(3))
    return float(np.einsum("mi,mi->", a, np.cross(b, c)) / 6.0)


def part_volumes(vertices: np.ndarray, triangles: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """(P,) signed volume [m³] of each connected part, negative for a cavity's wall; without meaning for open parts."""
    a, b, c = (vertices[triangles[:, k]] - vertices.mean(axis=0) for k in range(3))
    return np.bincount(parts, np.einsum("mi,mi->m", a, np.cross(b, c)) / 6.0)


def connected_parts(triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """(M,) number of the connected part that each triangle belongs to."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(vertex_count, vertex_count))
    label = connected_components(graph, directed=False)[1][triangles[:, 0]]
    return np.unique(label, return_inverse=True)[1].ravel()


def is_closed(triangles: np.ndarray) -> bool:
    """Whether every edge is passed once in either direction: a surface with an inside, consistently wound."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    size = edges.max() + 1
    forward, backward = edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0]
    return len(np.unique(forward)) == len(forward) and bool(np.array_equal(np.sort(forward), np.sort(backward)))


# -- inside -----------------------------------------------------------------------------------------------------------------------


def _lattice(vertices: np.ndarray, triangles: np.ndarray, parts: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Lattice points (P, 3) inside closed triangles, and the part (P,) whose surface is nearest."""
    if len(triangles) == 0:
        return np.zeros((0, 3)), np.zeros(0, dtype=int)
    used = vertices[np.unique(triangles)]
    low, high = used.min(axis=0), used.max(axis=0)
    counts = np.maximum(np.ceil((high - low) / spacing).astype(int), 1)
    # Centred, and off the places where a modeller's vertices lie: a line through an edge would count it twice.
    start = 0.5 * (low + high) - 0.5 * (counts - 1) * spacing + spacing * np.array([1.37e-4, 2.11e-4, 0.0])
    axes = [start[c] + spacing * np.arange(counts[c]) for c in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    points = points[_winding(vertices, triangles, axes).ravel() != 0]
    if len(points) == 0:
        return points, np.zeros(0, dtype=int)
    return points, parts[cKDTree(vertices[triangles].mean(axis=1)).query(points)[1]]


def _winding(vertices: np.ndarray, triangles: np.ndarray, axes: list[np.ndarray]) -> np.ndarray:
    """Winding number (A, B, C) int of a closed surface about the lattice's points, by signed crossings of the lines along Z."""
    corners = vertices[triangles]
    first = [np.searchsorted(axes[c], corners[:, :, c].min(axis=1)) for c in range(2)]
    last = [np.searchsorted(axes[c], corners[:, :, c].max(axis=1)) for c in range(2)]
    wide = [last[c] - first[c] for c in range(2)]
    each = wide[0] * wide[1]
    triangle = np.repeat(np.arange(len(triangles)), each)
    rank = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
    i = first[0][triangle] + rank // np.maximum(wide[1][triangle], 1)
    j = first[1][triangle] + rank % np.maximum(wide[1][triangle], 1)
    a, b, c = (corners[triangle, k] for k in range(3))
    px, py = axes[0][i], axes[1][j]

    def side(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return (q[:, 0] - p[:, 0]) * (py - p[:, 1]) - (q[:, 1] - p[:, 1]) * (px - p[:, 0])

    wa, wb, wc = side(b, c), side(c, a), side(a, b)
    total = wa + wb + wc
    hit = (total != 0.0) & (((wa > 0) & (wb > 0) & (wc > 0)) | ((wa < 0) & (wb < 0) & (wc < 0)))
    height = (wa * a[:, 2] + wb * b[:, 2] + wc * c[:, 2])[hit] / total[hit]
    change = np.zeros((len(axes[0]), len(axes[1]), len(axes[2]) + 1), dtype=int)
    above = np.searchsorted(axes[2], height)
    np.add.at(change, (i[hit], j[hit], above), np.where(total[hit] > 0, -1, 1))
    return np.cumsum(change, axis=2)[:, :, :-1]


# -- shells -----------------------------------------------------------------------------------------------------------------------


def sample_surface(
    vertices: np.ndarray, triangles: np.ndarray, cross: np.ndarray, area: np.ndarray, spacing: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points about `spacing` apart on triangles.

    Returns:
        points (P, 3) [m], unit normals (P, 3), and the area (P,) [m²] that each stands for.
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
    for _ in range(4):  # Lloyd's relaxation evens the distances out
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
    """Indices of dots no two of which are nearer than 0.75 spacings: greedy, in the given (random) order."""
    neighbours = cKDTree(dots).query_ball_point(dots, 0.75 * spacing, return_sorted=False)
    free = np.ones(len(dots), dtype=bool)
    chosen = []
    for index, around in enumerate(neighbours):
        if free[index]:
            chosen.append(index)
            free[around] = False
    return np.array(chosen)
