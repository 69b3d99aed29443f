"""Remove from a motion what its mesh is too coarse to show as a bend: ripples as short as an edge, which render as a quilt of triangles.

Taubin's filter (A signal processing approach to fair surface design, SIGGRAPH 1995): each pass moves every vertex towards the mean of
its neighbours and then back by slightly more, which removes ripples without shrinking the shape.

The filter acts on the displacement from the nearest rigid motion, so corners and creases of the rest shape stay.
"""

from __future__ import annotations

import numpy as np

from .rigid import RigidFit

TOWARDS, BACK = 0.5, -0.53
"""Factors of one pass. It removes a ripple from vertex to vertex almost completely, 7 % of one over 4 edges, and 0.5 % of one over 8 edges.
Four passes left 27 % of the effect of noise on the shading of a sheet."""
HELD = 1e-7
"""Fraction of the body's size: a vertex that moves less than this in the whole motion counts as held and is not smoothed."""


def smoothed(vertices: np.ndarray, edges: np.ndarray, fit: RigidFit, passes: int) -> np.ndarray:
    """Remove the shortest ripples from the motion of a mesh.

    Args:
        vertices: (T+1, V, 3) [m].
        edges: (E, 2) of the mesh.
        fit: the rigid motion nearest to it.
        passes: number of passes; 0 changes nothing.

    Returns:
        (T+1, V, 3) [m]; frame 0 and held vertices are unchanged.
    """
    if not passes or not len(edges):
        return vertices
    rigid = np.einsum("tij,vj->tvi", fit.rotation, vertices[0]) + fit.translation[:, None]
    moved = vertices - rigid
    free = np.abs(vertices - vertices[0]).max(axis=(0, 2)) > HELD * max(fit.size, 1e-12)
    both = np.concatenate([edges, edges[:, ::-1]])
    weights = _weights(vertices[0], both)
    for _ in range(passes):
        for share in (TOWARDS, BACK):
            moved[:, free] += share * _towards_neighbours(moved, both, weights)[:, free]
    return np.concatenate([vertices[:1], (rigid + moved)[1:]])


def _weights(rest: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Weights (2 E,) of directed edges (2 E, 2) for which the weighted differences to the neighbours vanish for any linear displacement.

    They are uniform weights minus the part explained by a linear fit over the neighbours. Uniform weights would pull a border inwards.
    """
    start, end = edges.T
    step, count = rest[end] - rest[start], np.maximum(np.bincount(start, minlength=len(rest)), 1.0)
    aside, spread = np.zeros((len(rest), 3)), np.zeros((len(rest), 3, 3))
    np.add.at(aside, start, step / count[start, None])
    np.add.at(spread, start, step[:, :, None] * step[:, None, :])
    inverse = np.linalg.pinv(spread, rcond=1e-6, hermitian=True)
    return 1.0 / count[start] - np.einsum("ei,eij,ej->e", aside[start], inverse[start], step)


def _towards_neighbours(values: np.ndarray, edges: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted sums (T+1, V, 3) of the differences from each vertex to its neighbours."""
    start, end = edges.T
    found = np.empty_like(values)
    for t, frame in enumerate(values):
        steps = weights[:, None] * (frame[end] - frame[start])
        for axis in range(3):
            found[t, :, axis] = np.bincount(start, steps[:, axis], minlength=values.shape[1])
    return found
