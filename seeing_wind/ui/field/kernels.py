"""A sampled vector field as a sum of Blender wind sources.

Blender's WIND force field of shape *Every Point* blows from every vertex along its normal, weaker with distance as (1 + r)^-p, r in
scene units. Every source reaches every place, so the sources' vectors are not the field's values at the sources: they follow from a
least-squares fit. Everything here is NumPy.
"""

from __future__ import annotations

import numpy as np

POWER_RANGE = (0.05, 10.0)
"""Falloff powers used; Blender's slider ends at 10."""

RIDGE = 1e-8
"""Tikhonov weight relative to the mean diagonal of the normal equations: small against the fit's error, large against float64 noise. It
keeps the coefficients of nearly equal kernels from growing against each other, which Blender's float32 sums would turn into noise."""


BEYOND = 0.3
"""How far, in cells of the lattice, the outermost sources stand outside it.

A sum of kernels fits worst near its outermost ones: standing on the faces of the box, they left twice the error there (2.2 % of a swirl
instead of 1.2 %). Farther out a smooth field gains a little more, but one that changes from node to node swings between the outermost ones
(measured for cubes and slabs from 0.1 to 10 m)."""


def lattice(box: np.ndarray, resolution: int = 6) -> np.ndarray:
    """Nodes of a regular lattice that fills a box, its faces included.

    Args:
        box: (2, 3) lower and upper corner [m].
        resolution: nodes along the longest side; the others get as many as keep the spacing alike, at least 3.

    Returns:
        (M, 3) nodes [m].
    """
    low, high = np.asarray(box, dtype=np.float64)
    side = np.maximum(high - low, 1e-9)
    counts = np.clip(np.round((resolution - 1) * side / side.max()).astype(int) + 1, 3, resolution)
    axes = [np.linspace(low[k], high[k], counts[k]) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def between(box: np.ndarray, resolution: int) -> np.ndarray:
    """Places amid the nodes of `lattice(box, resolution)`, where the field is to be known too for a good fit: (P, 3) [m]."""
    inset = 0.5 * (box[1] - box[0]) / max(resolution - 1, 1)
    return lattice(np.stack([box[0] + inset, box[1] - inset]), resolution)


def lattice_counts(nodes: np.ndarray) -> tuple[int, int, int]:
    """Nodes along x, y, z of a full lattice (M, 3) as `lattice` makes it, z fastest.

    Raises:
        ValueError: when the nodes are no such lattice.
    """
    axes = [np.unique(np.round(nodes[:, k], 9)) for k in range(3)]
    full = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if full.shape != np.shape(nodes) or not np.allclose(full, nodes, atol=1e-6 * max(1e-9, float(np.ptp(nodes, axis=0).max()))):
        raise ValueError("the nodes do not fill a lattice")
    return len(axes[0]), len(axes[1]), len(axes[2])


def source_places(nodes: np.ndarray) -> np.ndarray:
    """Where the sources for a lattice (M, 3) stand, in its order: the same lattice, drawn out to `BEYOND` its faces: (M, 3)."""
    middle, cells = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0)), np.array(lattice_counts(nodes)) - 1
    return middle + (nodes - middle) * (1.0 + 2.0 * BEYOND / cells)


def halved(counts: tuple[int, int, int], values: np.ndarray) -> np.ndarray:
    """Values (T, M, C) on a lattice -> (T, M', C) with a node more in the middle of every edge, face and cell, by linear interpolation."""
    grid = values.reshape(len(values), *counts, values.shape[-1])
    for axis in (1, 2, 3):
        n = grid.shape[axis]
        before, after = np.take(grid, range(n - 1), axis), np.take(grid, range(1, n), axis)
        woven = np.stack([before, 0.5 * (before + after)], axis=axis + 1)
        woven = woven.reshape(*grid.shape[:axis], 2 * n - 2, *grid.shape[axis + 1 :])
        grid = np.concatenate([woven, np.take(grid, [n - 1], axis)], axis=axis)
    return grid.reshape(len(values), -1, values.shape[-1])


def choose_power(nodes: np.ndarray) -> float:
    """The falloff power that suits the size of a set of nodes (M, 3): 0.5 at a half-size of 1 m, 5 at 0.1 m.

    Too flat kernels are nearly equal and need large cancelling vectors; too steep ones leave dents between the nodes. Swirls on 6x6x6
    nodes came out alike within a factor of two of this choice.
    """
    half_size = 0.5 * float(np.ptp(nodes, axis=0).max())
    return float(np.clip(0.5 / max(half_size, 1e-9), *POWER_RANGE))


def kernel(nodes: np.ndarray, points: np.ndarray, power: float) -> np.ndarray:
    """What each source does at each point: (P, M) for nodes (M, 3) and points (P, 3), (1 + r)^-power."""
    distance = np.linalg.norm(np.asarray(points)[:, None, :] - np.asarray(nodes)[None, :, :], axis=-1)
    return (1.0 + distance) ** -power


def fit_nodes(nodes: np.ndarray, sample_points: np.ndarray, samples: np.ndarray, power: float, ridge: float = RIDGE) -> np.ndarray:
    """Source vectors whose sum of kernels comes closest to a sampled field, by regularised least squares.

    Args:
        nodes: (M, 3) where the sources stand.
        sample_points: (P, 3) where the field is known; P >= M for a well determined fit.
        samples: (T, P, 3) the field there, any unit.
        power: falloff power of the kernels.
        ridge: see `RIDGE`.

    Returns:
        (T, M, 3) source vectors, unit of `samples`.

    Raises:
        ValueError: when shapes do not agree or a sample is not finite.
    """
    samples = np.asarray(samples, dtype=np.float64)
    if samples.ndim != 3 or samples.shape[1:] != (len(sample_points), 3):
        raise ValueError(f"samples have the shape {samples.shape}, expected (T, {len(sample_points)}, 3)")
    if not np.isfinite(samples).all():
        raise ValueError("the sampled field is not finite everywhere")
    matrix = kernel(nodes, sample_points, power)
    normal = matrix.T @ matrix
    normal[np.diag_indices_from(normal)] += ridge * np.trace(normal) / len(nodes)
    right = np.einsum("pm,tpc->mtc", matrix, samples).reshape(len(nodes), -1)
    return np.linalg.solve(normal, right).reshape(len(nodes), len(samples), 3).transpose(1, 0, 2)


def evaluate(nodes: np.ndarray, vectors: np.ndarray, points: np.ndarray, power: float) -> np.ndarray:
    """The field of sources: (T, P, 3) at points (P, 3) for source vectors (T, M, 3)."""
    return np.einsum("pm,tmc->tpc", kernel(nodes, points, power), vectors)


def paired_directions(vectors: np.ndarray, strength: float) -> np.ndarray:
    """Two unit vectors per source vector whose sum, times `strength`, is the vector.

    Blender scales all sources of one object by one strength; the angle between two sources at the same place encodes how much.

    Args:
        vectors: (..., M, 3), none longer than 2 * strength.
        strength: > 0, unit of `vectors`.

    Returns:
        (..., 2M, 3) unit vectors, the two of a pair adjacent.
    """
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    along = np.divide(vectors, length, out=np.broadcast_to([1.0, 0.0, 0.0], vectors.shape).copy(), where=length > 0.0)
    # the axis that the vector points least along is never parallel to it
    least = np.eye(3)[np.argmin(np.abs(along), axis=-1)]
    across = np.cross(along, least)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    cosine = np.minimum(length / (2.0 * strength), 1.0)
    sine = np.sqrt(1.0 - cosine**2)
    pair = np.stack([cosine * along + sine * across, cosine * along - sine * across], axis=-2)
    return pair.reshape(*vectors.shape[:-2], -1, 3)
