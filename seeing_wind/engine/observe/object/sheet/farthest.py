"""The farthest shape of a sheet that its lengths allow: a start for shape from template that no earlier frame can lead astray."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, identity, kron
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from .mesh import SheetMesh
from .view import View

APART = 0.04
"""Least distance between the points that are used, as a share of the sheet's size. On a nylon flag the shape is 39 mm off, with all
points 28 mm: either is only a start."""
NEIGHBOURS, FAR, HELD = 8, 2, 2
"""Bounded distances per point: to its nearest points, to random ones, and to random held vertices."""
STRETCH, LOOSE = 0.003, 6e-4
"""How much longer than on the flat sheet a distance may be: a strain, and a share of the sheet's size."""
SLACK = 20.0
"""Cost of exceeding that, relative to the gain in depth, so that points which were taken for others do not hold the sheet back."""
FIXED = -1
"""Stands for a held vertex in a pair."""
FITTED, REGULAR = 6e-3, 1e-6
"""Deviation of the mesh from the points, as a share of the sheet's size; and the least share of the Hessian's mean diagonal."""


def farthest(mesh: SheetMesh, view: View, frame: int, bends: csr_matrix) -> np.ndarray:
    """Vertices (V, 3) [m] of a sheet whose visible points are as far from the camera as its lengths allow.

    The depths d of the points, each on its ray r, maximise their sum under |d_i r_i - d_j r_j| <= (their distance on the sheet laid
    flat). This is a convex problem: it has one minimum, wherever the sheet was before. (Maximum depth heuristic: Perriollat, Hartley and
    Bartoli, Monocular template-based reconstruction of inextensible surfaces, IJCV 2011; as a cone programme: Salzmann and Fua, Linear
    local models for monocular reconstruction of deformable surfaces, PAMI 2011.)

    Args:
        bends: the bends' matrix (3V, 3V), in units of the curvature that is expected: see `Template.bends`.
    """
    size = mesh.size
    ride, xy = view.points(frame)[:2]
    kept = _apart(ride @ mesh.flat, APART * size)
    ride, xy = ride[kept], xy[kept]
    points = _deepest(mesh, ride @ mesh.flat, *view.rays(frame, xy), LOOSE * size)
    firm = 1.0 / (FITTED * size) ** 2
    held = kron(csr_matrix(np.diag(mesh.pinned * firm)), identity(3))
    hessian = firm * kron(ride.T @ ride, identity(3)) + bends + held
    pull = firm * (ride.T @ points) + mesh.pinned[:, None] * firm * mesh.x
    least = REGULAR * float(hessian.diagonal().mean())
    return spsolve((hessian + least * identity(hessian.shape[0])).tocsc(), pull.ravel() + least * mesh.x.ravel()).reshape(-1, 3)


def _deepest(mesh: SheetMesh, places: np.ndarray, origin: np.ndarray, rays: np.ndarray, loose: float) -> np.ndarray:
    """The points (N, 3) [m] at `places` (N, 2) on the sheet laid flat [m], each on its ray (N, 3) from the origin (3,)."""
    count, anchors = len(places), np.flatnonzero(mesh.pinned)
    pairs = _pairs(places)
    one = np.repeat(np.arange(count), HELD if anchors.size else 0)
    held = anchors[np.random.default_rng(count).integers(max(1, anchors.size), size=one.size)]
    first, second = np.concatenate([pairs[:, 0], one]), np.concatenate([pairs[:, 1], np.full(one.size, FIXED)])
    fixed = np.concatenate([np.zeros((len(pairs), 3)), mesh.x[held] - origin])
    apart = np.concatenate([places[pairs[:, 0]] - places[pairs[:, 1]], places[one] - mesh.flat[held]])
    longest = (1.0 + STRETCH) * np.linalg.norm(apart, axis=1) + loose
    return origin + _depths(rays, first, second, fixed, longest)[:, None] * rays


def _depths(rays: np.ndarray, first: np.ndarray, second: np.ndarray, fixed: np.ndarray, longest: np.ndarray) -> np.ndarray:
    """The depths d (N,) whose sum is largest while |d_i r_i - d_j r_j| <= longest, for B pairs of `first` i and `second` j; where j is
    FIXED, `fixed` (B, 3) stands for d_j r_j."""
    from clarabel import DefaultSettings, DefaultSolver, NonnegativeConeT, SecondOrderConeT  # an engine may lack it: only sheets need it

    count, bounds = len(rays), len(longest)
    number, both, axis = np.arange(bounds), np.flatnonzero(second != FIXED), 1 + np.arange(3)
    # Rows: per bound a cone (longest + slack, difference of the points), then slack >= 0. Columns: the depths, then the slacks.
    entries = [
        (4 * number, count + number, -np.ones(bounds)),
        ((4 * number[:, None] + axis).ravel(), np.repeat(first, 3), -rays[first].ravel()),
        ((4 * both[:, None] + axis).ravel(), np.repeat(second[both], 3), rays[second[both]].ravel()),
        (4 * bounds + number, count + number, -np.ones(bounds)),
    ]
    row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    matrix = csc_matrix((value, (row, column)), (5 * bounds, count + bounds))
    right = np.concatenate([np.column_stack([longest, -fixed]).ravel(), np.zeros(bounds)])
    cost = np.concatenate([-np.ones(count), np.full(bounds, SLACK)])
    settings = DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    cones = [SecondOrderConeT(4)] * bounds + [NonnegativeConeT(bounds)]
    solver = DefaultSolver(csc_matrix((count + bounds,) * 2), cost, matrix, right, cones, settings)
    return np.array(solver.solve().x)[:count]


def _pairs(places: np.ndarray) -> np.ndarray:
    """Pairs (P, 2) of the points at `places` (N, 2): neighbours, and some far from each other."""
    count = len(places)
    near = cKDTree(places).query(places, k=min(NEIGHBOURS + 1, count))[1].reshape(count, -1)[:, 1:]
    far = np.random.default_rng(count).integers(count, size=(FAR * count, 2))
    pairs = np.concatenate([np.column_stack([np.repeat(np.arange(count), near.shape[1]), near.ravel()]), far])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    return pairs[pairs[:, 0] < pairs[:, 1]]


def _apart(places: np.ndarray, least: float) -> np.ndarray:
    """Indices of points, of those at `places` (N, 2), that are at least so far from each other."""
    tree, left, kept = cKDTree(places), np.ones(len(places), bool), []
    for one in range(len(places)):
        if left[one]:
            kept.append(one)
            left[tree.query_ball_point(places[one], least)] = False
    return np.array(kept, int)
