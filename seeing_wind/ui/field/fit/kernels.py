"""A sampled vector field as a sum of Blender wind sources.

Blender's WIND force field of shape *Every Point* blows from every vertex along its normal, weaker with distance as (1 + r)^-p, r in
scene units. Every source reaches every place, so the sources' vectors are not the field's values at the sources: they follow from a
least-squares fit. Everything here is NumPy.
"""

from __future__ import annotations

import numpy as np

from .lattice import lattice_counts

POWER_RANGE = (0.05, 10.0)
"""Falloff powers used; Blender's slider ends at 10."""

RIDGE = 1e-8
"""Tikhonov weight relative to the mean diagonal of the normal equations: small against the fit's error, large against float64 noise. It
keeps the coefficients of nearly equal kernels from growing against each other, which Blender's float32 sums would turn into noise."""


def source_places(nodes: np.ndarray, beyond: float) -> np.ndarray:
    """Where the sources for a lattice (M, 3) stand, in its order: the same lattice, drawn out by `beyond` of its cells: (M, 3).

    A sum of kernels fits worst near its outermost ones: standing on the faces of the box, they left twice the error there (2.2 % of a swirl
    instead of 1.2 % at 0.3 cells).
    """
    middle, cells = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0)), np.array(lattice_counts(nodes)) - 1
    return middle + (nodes - middle) * (1.0 + 2.0 * beyond / cells)


def choose_power(nodes: np.ndarray) -> float:
    """The falloff power that suits the size of a set of nodes (M, 3): 0.5 at a half-size of 1 m, 5 at 0.1 m.

    Too flat kernels are nearly equal and need large cancelling vectors; too steep ones leave dents between the nodes. Swirls on 6x6x6
    nodes came out alike within a factor of two of this choice.
    """
    half_size = 0.5 * float(np.ptp(nodes, axis=0).max())
    return float(np.clip(0.5 / max(half_size, 1e-9), *POWER_RANGE))


def kernel(nodes: np.ndarray, points: np.ndarray, power: float) -> np.ndarray:
    """What each source does at each point: (P, M) for nodes (M, 3) and points (P, 3), (1 + r)^-power."""
    # from the common middle, so that squares of large coordinates do not swallow small distances
    middle = nodes.mean(axis=0)
    a, b = np.asarray(points) - middle, np.asarray(nodes) - middle
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    return (1.0 + np.sqrt(np.maximum(squared, 0.0))) ** -power


def fit_nodes(
    nodes: np.ndarray, sample_points: np.ndarray, samples: np.ndarray, power: float, weights: np.ndarray | None = None
) -> np.ndarray:
    """Source vectors whose sum of kernels comes closest to a sampled field, by least squares with the ridge `RIDGE`.

    Args:
        nodes: (M, 3) where the sources stand.
        sample_points: (P, 3) where the field is known; P >= M for a well determined fit.
        samples: (T, P, 3) the field there, any unit, finite.
        power: falloff power of the kernels.
        weights: (P,) how much an error at each point counts; None: all alike.

    Returns:
        (T, M, 3) source vectors, unit of `samples`.

    Raises:
        ValueError: when shapes do not agree.
    """
    if np.ndim(samples) != 3 or np.shape(samples)[1:] != (len(sample_points), 3):
        raise ValueError(f"samples have the shape {np.shape(samples)}, expected (T, {len(sample_points)}, 3)")
    matrix = kernel(nodes, sample_points, power)
    weighted = matrix if weights is None else matrix * (weights**2)[:, None]
    normal = weighted.T @ matrix
    normal[np.diag_indices_from(normal)] += RIDGE * np.trace(normal) / len(nodes)
    right = weighted.T @ np.asarray(samples, dtype=np.float64).transpose(1, 0, 2).reshape(len(sample_points), -1)
    return np.linalg.solve(normal, right).reshape(len(nodes), len(samples), 3).transpose(1, 0, 2)


def evaluate(nodes: np.ndarray, vectors: np.ndarray, points: np.ndarray, power: float) -> np.ndarray:
    """The field of sources: (T, P, 3) at points (P, 3) for source vectors (T, M, 3)."""
    flat = kernel(nodes, points, power) @ vectors.transpose(1, 0, 2).reshape(len(nodes), -1)
    return flat.reshape(len(points), len(vectors), 3).transpose(1, 0, 2)


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
