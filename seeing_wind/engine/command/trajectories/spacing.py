"""How far apart the particles of a body are, which its grid follows."""

from __future__ import annotations

import numpy as np

from ...errors import ObjectError

ALONE = 0.01
"""Metres, of a single particle."""
EVEN = 1.25
"""Times the distance of nearest neighbours that links of an evenly filled body are long, at most: 1.24 in files of another simulator."""
STRAYS = 0.02
"""Share of the links that may be longer: of particles that lie apart."""
NEIGHBOURS = 24
"""Of a particle, among which links are looked for at first."""


def particle_spacing(x: np.ndarray) -> float:
    """Distance of neighbours [m] among particles x (N, 3): that of nearest ones, or more where particles lie closer one way than the
    others, as the two layers of a plate do. A body whose particles are more than a cell of the grid apart would fall to pieces.

    Raises:
        ObjectError: when most particles coincide.
    """
    if len(x) == 1:
        return ALONE
    near = nearest(x)
    if near <= 1e-9 * max(1.0, float(np.abs(x).max())):
        raise ObjectError("Most particles coincide with another.", "Give every particle a place of its own in the first frame.")
    return max(near, _link(x) / EVEN)


def nearest(x: np.ndarray) -> float:
    """Median distance of nearest neighbours [m] among two particles x (N, 3) or more."""
    from scipy.spatial import cKDTree

    return float(np.median(cKDTree(x).query(x, k=2)[0][:, 1]))


def _link(x: np.ndarray) -> float:
    """Length [m] of the longest of the shortest links by which particles x (N, 3) hang together, but for those of strays."""
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
        neighbours *= 2  # those so far are all of one's own layer
