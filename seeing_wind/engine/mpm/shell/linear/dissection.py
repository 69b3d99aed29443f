"""An order of elimination for the vertices of a mesh, by nested dissection.

The vertices are halved across their longest axis, again and again, and each time the row of vertices that separates the halves is
eliminated after both (George 1973, SIAM J. Numer. Anal. 10, 345).
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

LEAF = 16
"""Groups of up to this many vertices are not halved any more."""


def nested_dissection(pattern: csr_array, places: np.ndarray) -> tuple[list[np.ndarray], list[tuple[int, ...]]]:
    """Groups of vertices in the order of their elimination, and for each group the numbers of the groups that it separates.

    Args:
        pattern: (V, V), symmetric; its values are not used. places: (V, 3) where the vertices lie.
    """
    groups: list[np.ndarray] = []
    tree: list[tuple[int, ...]] = []
    _dissect(np.arange(len(places)), pattern, places, groups, tree)
    return groups, tree


def _dissect(vertices: np.ndarray, pattern: csr_array, places: np.ndarray, groups: list[np.ndarray], tree: list[tuple[int, ...]]) -> int:
    """Append the groups of `vertices` to `groups` and `tree`, children first; returns the number of the last group."""
    children: tuple[int, ...] = ()
    group = vertices
    if len(vertices) > LEAF:
        low, high, group = _halves(vertices, pattern, places)
        children = tuple(_dissect(half, pattern, places, groups, tree) for half in (low, high) if len(half))
    groups.append(group)
    tree.append(children)
    return len(groups) - 1


def _halves(vertices: np.ndarray, pattern: csr_array, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two halves that do not touch, and the vertices that separate them."""
    here = places[vertices] - places[vertices].mean(axis=0)
    _, short, axis = np.linalg.eigh(here.T @ here)[1].T
    along = np.argsort(here @ axis, kind="stable")
    low, high = vertices[along[: len(along) // 2]], vertices[along[len(along) // 2 :]]
    side = np.zeros(len(places), dtype=np.int8)
    side[low], side[high] = 1, 2
    edges = [half[_touches(half, pattern, side, other)] for half, other in ((low, 2), (high, 1))]
    between = min(edges, key=len)
    # Sorted by position, so that whatever touches part of the separator touches few contiguous runs of it.
    between = between[np.argsort(places[between] @ short, kind="stable")]
    return low[~np.isin(low, between)], high[~np.isin(high, between)], between


def _touches(half: np.ndarray, pattern: csr_array, side: np.ndarray, other: int) -> np.ndarray:
    """(n,) bool: whether a vertex of `half` has a neighbour on the other side."""
    return np.asarray(abs(pattern[half]) @ (side == other).astype(np.float64)).ravel() > 0.0
