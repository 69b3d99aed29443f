"""The inside of a surface that is not a proper solid: flipped faces, edges with three faces, inner walls, small holes.

The surface is drawn into voxels and the outside is flooded; what the flood does not reach is inside. An open sheet or an open bowl has
no inside, as it should be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, label

from ...mpm.lattice.closed_mesh import dots_on, triangle_areas

CELLS = 96
"""Voxels along the longest side: a hole under a hundredth of the mesh is closed, and a million voxels take a tenth of a second."""
_CLOSING = (0, 1)
"""Voxels by which the walls are thickened, tried in turn until something is inside: this closes holes of up to three voxels."""
_THICK = 4.0
"""Least mean thickness of the inside [voxels]: a thinner one is a fold in a sheet."""


@dataclass(frozen=True)
class Room:
    """The inside of a surface, in voxels."""

    low: np.ndarray
    """(3,) corner of the voxel (0, 0, 0) [m]."""
    size: float
    """Edge length of a voxel [m]."""
    inside: np.ndarray
    """(A, B, C) bool."""
    volume: float
    """Volume of the inside [m³]; voxels that contain the surface count half."""

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(P,) bool: whether points (P, 3) [m] are inside."""
        return self._at(self.inside, points)

    def borders(self, points: np.ndarray) -> np.ndarray:
        """(P,) bool: whether points (P, 3) [m] of the surface border on the inside."""
        return self._at(binary_dilation(self.inside, np.ones((3, 3, 3)), iterations=2), points)

    def _at(self, voxels: np.ndarray, points: np.ndarray) -> np.ndarray:
        cell = np.floor((points - self.low) / self.size).astype(int)
        within = ((cell >= 0) & (cell < voxels.shape)).all(axis=1)
        return within & voxels[tuple(np.where(within[:, None], cell, 0).T)]


def enclosed_room(vertices: np.ndarray, triangles: np.ndarray) -> Room | None:
    """The inside of a triangle surface; None if it encloses next to nothing.

    Args:
        vertices: (V, 3) [m]; triangles: (M, 3), with any winding.
    """
    corners = vertices[triangles]
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max()) / CELLS
    if size <= 0.0:
        return None
    # A margin for the flood, and another one for thickened walls.
    low = corners.reshape(-1, 3).min(axis=0) - 3.5 * size
    shape = np.ceil((corners.reshape(-1, 3).max(axis=0) - low) / size).astype(int) + 4
    walls = np.zeros(shape, dtype=bool)
    walls[tuple(np.floor((dots_on(corners, 0.5 * size)[0] - low) / size).astype(int).T)] = True
    area = triangle_areas(vertices, triangles)[0].sum()
    for closing in _CLOSING:
        thick = binary_dilation(walls, np.ones((3, 3, 3)), iterations=closing) if closing else walls
        region, _ = label(~thick)
        inside = ~thick & (region != region[0, 0, 0])
        if closing:
            inside = binary_dilation(inside, np.ones((3, 3, 3)), iterations=closing) & ~walls
        rim = binary_dilation(inside) & walls
        volume = size**3 * (inside.sum() + 0.5 * rim.sum())
        if 2.0 * volume / area >= _THICK * size:
            return Room(low, size, inside, float(volume))
    return None
