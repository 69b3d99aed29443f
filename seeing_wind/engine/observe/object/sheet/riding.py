"""Points that ride on a bent sheet: quadratic moving least squares over the sheet laid flat.

Weights that only reproduce affine motions, as for solids (`motion.control`), put a point on the inner side of every bend: between vertices
2 cm apart they miss a bend of 5 cm radius by millimetres, which is more than a pixel.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ....records import Attachment
from ..motion.control import kernel_of

NEIGHBOURS = 14
"""Number of vertices that carry a point; a quadratic in the plane has six coefficients."""
REGULAR = 1e-6
"""Regularisation relative to the trace of the normal equations, which are singular if the vertices lie on a conic."""


def ride_flat(points: np.ndarray, flat: np.ndarray) -> Attachment:
    """Attach points (K, 2) to vertices (V, 2), both in the plane of the sheet laid flat [m].

    Each point's weights sum to one, and any quadratic in the plane is reproduced (Lancaster and Salkauskas, Math. Comp. 37, 1981).
    """
    count = min(NEIGHBOURS, len(flat))
    distance, index = cKDTree(flat).query(points, k=count)
    distance, index = distance.reshape(-1, count), index.reshape(-1, count)
    reach = np.maximum(distance.max(axis=1), 1e-300)
    kernel = kernel_of(distance)
    at = (flat[index] - points[:, None]) / reach[:, None, None]
    u, v = np.moveaxis(at, -1, 0)
    basis = np.stack([np.ones_like(u), u, v, u**2, u * v, v**2], axis=-1)
    normal = np.einsum("kja,kj,kjb->kab", basis, kernel, basis)
    normal += REGULAR * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    wanted = np.zeros((len(points), basis.shape[-1], 1))
    wanted[:, 0] = 1.0
    coefficients = np.linalg.solve(normal, wanted)[..., 0]
    return Attachment(index.astype(np.int32), kernel * np.einsum("kja,ka->kj", basis, coefficients))
