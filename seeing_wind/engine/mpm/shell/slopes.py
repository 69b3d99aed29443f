"""The slope of a surface across each edge of its mesh, from the vertices around.

The slope is the derivative along the normal of an edge, at the edge's midpoint: a weighted sum over vertices. The two flat triangles at an
edge have different slopes there. Their mean is right on regular meshes, but on others it has an error that refinement does not reduce, and
bending energies computed from it do not converge (Grinspun, Gingold, Reisman and Zorin 2006, Computer Graphics Forum 25, 547). So the
weights of the mean are changed as little as is needed to make every quadratic function exact. The vertices used are those of the two faces
and of the faces next to them, unfolded into the plane; at a border, and where these are not enough, further rings of faces are added.

A face with all its corners pinned is a clamp, and the slope at its edges is its own: otherwise the sheet would begin to bend inside it.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from .surface import NONE, Surface

ENOUGH = 1e-3
"""Singular values below this fraction of the largest are not used: vertices that nearly lie on a conic do not determine every curvature."""
EXACT = 1e-6
"""Largest error allowed in the slope of quadratic functions; where it is larger, more vertices are used."""
FARTHEST = 4
"""Rings of faces, at most, that are added around an edge."""


def edge_slopes(surface: Surface, clamp: np.ndarray) -> csr_array:
    """Matrix (edges, V) [1/m] that takes a function at the vertices to its slope at each edge's midpoint, out of the edge's first face.

    clamp (F,) bool: faces with all corners pinned.
    """
    _, first = np.unique(surface.edge.ravel(), return_index=True)
    face, k = first // 3, first % 3
    rows, columns, values = [], [], []
    held, beyond = clamp[face], clamp[surface.neighbour[face, k]] & (surface.neighbour[face, k] != NONE)
    for side, sign in ((held & ~beyond, 1.0), (beyond & ~held, -1.0)):
        number = np.flatnonzero(side)
        own = (face[side], k[side]) if sign > 0.0 else _other_half(surface, face[side], k[side])
        nodes, at = _one_face(surface, *own)
        rows.append(np.repeat(number, 3))
        columns.append(nodes.ravel())
        values.append(sign * _mean_slope(at).ravel())
    settled = held ^ beyond
    whole = _whole(surface, face, k) & ~settled
    if whole.any():
        nodes, at = _patches(surface, face[whole], k[whole])
        weights, exact = _weights(at, _mean_slope(at))
        number = np.flatnonzero(whole)[exact]
        rows.append(np.repeat(number, nodes.shape[1]))
        columns.append(nodes[exact].ravel())
        values.append(weights[exact].ravel())
        whole[np.flatnonzero(whole)[~exact]] = False
    for edge in np.flatnonzero(~whole & ~settled):
        some, weight = _by_rings(surface, int(face[edge]), int(k[edge]))
        rows.append(np.full(len(some), edge))
        columns.append(some)
        values.append(weight)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return csr_array(entries, shape=(surface.edges, len(surface.x)))


def _whole(surface: Surface, face: np.ndarray, k: np.ndarray) -> np.ndarray:
    """(E,) bool: whether an edge has two faces and each of them has all three neighbours."""
    complete = (surface.neighbour != NONE).all(axis=1)
    return complete[face] & complete[surface.neighbour[face, k]]


def _patches(surface: Surface, face: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (E, 8) around inner edges (ends, opposite corners, those across the faces' other edges), and their places (E, 8, 2) [m]."""
    other, corner = _other_half(surface, face, k)
    far = surface.opposite[face, k]
    p, q, c = (surface.faces[face, (k + shift) % 3] for shift in (1, 2, 0))
    flaps = [surface.opposite[f, (at + shift) % 3] for f, at in ((face, k), (other, corner)) for shift in (1, 2)]
    nodes = np.stack([p, q, c, far, *flaps], axis=1)
    length = lambda a, b: np.linalg.norm(surface.x[nodes[:, a]] - surface.x[nodes[:, b]], axis=1)  # noqa: E731
    at = np.zeros((*nodes.shape, 2))
    at[:, :3] = _one_face(surface, face, k)[1]
    for new, a, b, third in ((3, 0, 1, 2), (4, 1, 2, 0), (5, 2, 0, 1), (6, 0, 3, 1), (7, 3, 1, 0)):
        at[:, new] = _beyond(at[:, a], at[:, b], at[:, third], length(a, new), length(b, new))
    return nodes, at


def _other_half(surface: Surface, face: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The faces across inner edges k of `face`, and the number of the shared edge within them, both (E,)."""
    other = surface.neighbour[face, k]
    return other, np.argmax(surface.faces[other] == surface.opposite[face, k][:, None], axis=1)


def _one_face(surface: Surface, face: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The two ends of edge k of each face and the corner opposite (E, 3), and their places in the plane (E, 3, 2) [m]."""
    nodes = np.stack([surface.faces[face, (k + shift) % 3] for shift in (1, 2, 0)], axis=1)
    p, q, c = (surface.x[nodes[:, i]] for i in range(3))
    at = np.zeros((*nodes.shape, 2))
    at[:, 1, 0] = 0.5 * np.linalg.norm(q - p, axis=1)
    at[:, 0, 0] = -at[:, 1, 0]
    up = np.broadcast_to([0.0, 1.0], (len(nodes), 2))
    at[:, 2] = _beyond(at[:, 0], at[:, 1], up, np.linalg.norm(c - p, axis=1), np.linalg.norm(c - q, axis=1))
    return nodes, at


def _beyond(p: np.ndarray, q: np.ndarray, third: np.ndarray, to_p: np.ndarray | np.floating, to_q: np.ndarray | np.floating) -> np.ndarray:
    """The place (..., 2) at distances to_p and to_q from p and q, on the side of pq away from `third`."""
    span = np.linalg.norm(q - p, axis=-1)
    t = (q - p) / span[..., None]
    along = 0.5 * (to_p**2 - to_q**2 + span**2) / span
    height = np.sqrt(np.maximum(to_p**2 - along**2, 0.0))
    n = np.stack([-t[..., 1], t[..., 0]], axis=-1)
    side = -np.sign(((third - p) * n).sum(axis=-1))
    return p + along[..., None] * t + (side * height)[..., None] * n


def _mean_slope(at: np.ndarray) -> np.ndarray:
    """Weights (E, n) [1/m] of the slope across the edge from node 0 to node 1: the mean over the triangles with nodes 2 and 3.

    Each triangle's slope is weighted by the other's height, which is exact along a line of unequal intervals. Without a node 3 (n = 3) it
    is the slope of the one triangle.
    """
    span = at[:, 1, 0] - at[:, 0, 0]
    weights = np.zeros(at.shape[:2])
    two = at.shape[1] > 3
    heights = -at[:, 2, 1], at[:, 3, 1] if two else np.zeros(len(at))
    for node, height, other, sign in ((2, heights[0], heights[1], 1.0), (3, heights[1], heights[0], -1.0))[: 2 if two else 1]:
        share = (other / (height + other) if two else 1.0) * sign / height
        foot = at[:, node, 0] / span
        weights[:, 0] += share * (0.5 - foot)
        weights[:, 1] += share * (0.5 + foot)
        weights[:, node] -= share
    return weights


def _weights(at: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The weights (E, n) [1/m] nearest to `start` that give quadratic functions their exact slope, and whether they do so (E,) bool."""
    size = (at[:, 1, 0] - at[:, 0, 0])[:, None]
    u, v = at[..., 0] / size, at[..., 1] / size
    functions = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)  # (E, n, 6)
    wanted = np.broadcast_to([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (len(at), 6))
    start = start * size
    missing = wanted - np.einsum("eni,en->ei", functions, start)
    change = np.einsum("ein,ei->en", np.linalg.pinv(functions, rcond=ENOUGH), missing)
    weights = start + change
    error = np.abs(wanted - np.einsum("eni,en->ei", functions, weights)).max(axis=1)
    return weights / size, error < EXACT


def _by_rings(surface: Surface, face: int, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n,) and weights (n,) [1/m] for an edge at a border or in an irregular place; rings of faces are added until exact."""
    p, q, c = (int(surface.faces[face, (k + shift) % 3]) for shift in (1, 2, 0))
    distance = lambda a, b: np.linalg.norm(surface.x[a] - surface.x[b])  # noqa: E731
    half = 0.5 * distance(p, q)
    place = {p: np.array([-half, 0.0]), q: np.array([half, 0.0])}
    place[c] = _beyond(place[p], place[q], np.array([0.0, 1.0]), distance(p, c), distance(q, c))
    seen, ring = {face}, [(face, [place[int(one)] for one in surface.faces[face]])]
    other = int(surface.neighbour[face, k])
    if other != NONE:  # the other face's own vertex must be node 3
        ring.append(_unfold(surface, ring[0], k, place, distance))
        seen.add(other)
    paired = other != NONE
    for _ in range(FARTHEST):
        outer = []
        for parent in ring:
            for side in range(3):
                beyond = int(surface.neighbour[parent[0], side])
                if beyond != NONE and beyond not in seen:
                    seen.add(beyond)
                    outer.append(_unfold(surface, parent, side, place, distance))
        ring = outer
        at = np.array(list(place.values()))[None]
        start = _mean_slope(at[:, : 4 if paired else 3])
        weights, exact = _weights(at, np.pad(start, ((0, 0), (0, at.shape[1] - start.shape[1]))))
        if exact[0] or not ring:
            break
    return np.array(list(place)), weights[0]


def _unfold(surface: Surface, parent, side: int, place: dict, distance):
    """The face across an edge of `parent`, a face already in the plane, unfolded into the plane; a new vertex is added to `place`."""
    face, corners = parent
    new = int(surface.opposite[face, side])
    a, b = int(surface.faces[face, (side + 1) % 3]), int(surface.faces[face, (side + 2) % 3])
    at = _beyond(corners[(side + 1) % 3], corners[(side + 2) % 3], corners[side], distance(a, new), distance(b, new))
    place.setdefault(new, at)
    known = {a: corners[(side + 1) % 3], b: corners[(side + 2) % 3], new: at}
    beyond = int(surface.neighbour[face, side])
    return beyond, [known[int(one)] for one in surface.faces[beyond]]
