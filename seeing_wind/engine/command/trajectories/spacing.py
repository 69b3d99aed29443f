"""The spacing of a body's particles, from which the grid's cell size follows."""

from __future__ import annotations

import numpy as np

from ...errors import ObjectError

ALONE = 0.01
"""Spacing [m] of a single particle."""
EVEN = 1.25
"""Largest length of the links in an evenly filled body, relative to the distance of nearest neighbours: 1.24 in files of another
simulator."""
STRAYS = 0.02
"""Share of the links that may be longer, for particles that lie apart."""
NEIGHBOURS = 24
"""Number of a particle's neighbours among which links are sought at first."""


def particle_spacing(x: np.ndarray) -> float:
    """Spacing [m] of particles x (N, 3) [m]: the distance of nearest neighbours, or more if particles are closer in one direction.

    An example of the latter are the two layers of a plate: a body whose particles are more than a grid cell apart would fall to pieces.

    Raises:
        ObjectError: most particles coincide.
    """
    if len(x) == 1:
        return ALONE
    near = nearest(x)
    if near <= 1e-9 * max(1.0, float(np.abs(x).max())):
        raise ObjectError("Most particles coincide with another.", "Give every particle a place of its own in the first frame.")
    return max(near, _link(x) / EVEN)


def nearest(x: np.ndarray) -> float:
    """Median distance [m] of nearest neighbours among two or more particles x (N, 3) [m]."""
    from scipy.spatial import cKDTree

    return float(np.median(cKDTree(x).query(x, k=2)[0][:, 1]))


def _link(x: np.ndarray) -> float:
    """Length [m] of the longest edge of the minimum spanning tree of particles x (N, 3), leaving out a share `STRAYS` of the longest."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import minimum_spanning_tree
    from scipy.spatial import cKDTree

    tree, count, neighbours = cKDTree(x), len(x), NEIGHBOURS
    while True:
        each = min(neighbours, count - 1)
        away, index = tree.query(x, k=each + 1)
        begin = np.arange(0, each * count + 1, each)
        links = minimum_spanning_tree(csr_array((away[:, 1:].ravel(), index[:, 1:].ravel(), begin), shape=(count, count))).data
        if each == count - 1 or len(links) >= (1.0 - STRAYS) * (count - 1):
            return float(np.quantile(links, 1.0 - STRAYS))
        neighbours *= 2  # the neighbours so far are all in a particle's own layer
