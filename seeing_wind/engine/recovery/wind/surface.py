"""The surface of a simulated body, on which the air acts, as pieces with an area and a normal.

If a body has a triangle mesh, the pieces are its triangles. If it is particles only, the surface is built from them: fine voxels within
reach of a particle are marked, and as many outer layers are removed as bring the marked volume nearest to the body's. The faces between
marked and unmarked voxels are summed for each particle and each direction that the surface faces there. Such sums show no stairs: by
Gauss's theorem the area vectors of a staircase add up to that of the slope. The two sides of a sheet one particle thick, and the sides that
meet at an edge, are kept apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_cdt, gaussian_filter
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from ...records import Attachment, Particles
from .drag import TINY, area_normals

REACH = 1.1
"""Distance from a particle within which voxels are marked at first [spacings]; leaves no gap between neighbours."""
VOXELS = 4
"""Voxels per spacing along an axis; fewer for a large body, see `MOST_VOXELS`."""
MOST_VOXELS = 20_000_000
SMOOTH = 0.5
"""Standard deviation of the Gaussian that smooths the surface before its direction is determined [spacings]."""
TERRACE = 2.5
"""Distance over which areas are redistributed [spacings]."""
FEW = 12
"""In a body of at most this many particles, each counts as a separate cube."""
SMALLEST = 0.02
"""Pieces with a smaller area are left out [squared spacings]."""


@dataclass(frozen=True)
class BodySurface:
    """E pieces of surface that ride on particles."""

    attachment: Attachment
    """Attachment of the pieces' centres to the particles."""
    rest: np.ndarray
    """(E, 3) area normals at rest [m²], pointing outwards if `closed`."""
    closed: bool
    """As in `drag.face_forces`: True if air is on the outer side only."""
    triangles: np.ndarray | None = None
    """(E, 3) triangles of a mesh; None for a surface built from particles."""
    vertices: Attachment | None = None
    """Attachment of the mesh's vertices to the particles."""
    offset: np.ndarray | None = None
    """(V, 3) vertices at rest minus the positions that their attachment gives [m]."""

    def normals(self, x: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Area normals (E, 3) [m²] of a body whose particles are at x (N, 3) [m] with deformation gradients F (N, 3, 3).

        For a mesh, those of its triangles; for particles, a = J F^-T A (Nanson's formula).
        """
        if self.triangles is not None and self.vertices is not None:
            return area_normals(self.vertices.follow(x) + self.offset, self.triangles)
        carrier = F[self.attachment.index[:, 0]]
        return np.linalg.det(carrier)[:, None] * np.linalg.solve(np.swapaxes(carrier, 1, 2), self.rest[..., None])[..., 0]

    def spread(self, force: np.ndarray, count: int) -> np.ndarray:
        """Distribute forces, or other additive quantities, from the pieces (E, ...) to `count` particles (N, ...)."""
        weight = self.attachment.weight.reshape(*self.attachment.weight.shape, *(1,) * (force.ndim - 1))
        total = np.zeros((count, *force.shape[1:]))
        np.add.at(total, self.attachment.index, weight * force[:, None])
        return total


def mesh_surface(vertices: np.ndarray, triangles: np.ndarray, attachment: Attachment, x: np.ndarray, closed: bool) -> BodySurface:
    """The surface of a mesh with vertices (V, 3) [m] at rest and triangles (E, 3), attached to particles x (N, 3) [m] by `attachment`."""
    index = attachment.index[triangles].reshape(len(triangles), -1)
    weight = attachment.weight[triangles].reshape(len(triangles), -1) / 3.0
    offset = vertices - attachment.follow(x)
    return BodySurface(Attachment(index, weight), area_normals(vertices, triangles), closed, np.asarray(triangles), attachment, offset)


def particle_surface(particles: Particles) -> BodySurface:
    """The surface of a body of particles at rest. With at most `FEW` particles, each has the surface of a cube of its volume."""
    x, spacing = particles.x, particles.spacing
    if len(x) <= FEW:
        sides = np.concatenate([np.eye(3), -np.eye(3)])
        area = particles.volume ** (2.0 / 3.0)
        index = np.repeat(np.arange(len(x)), 6)[:, None].astype(np.int32)
        return BodySurface(Attachment(index, np.ones((len(index), 1))), (area[:, None, None] * sides).reshape(-1, 3), closed=True)
    axes = np.linalg.eigh(np.cov(x.T))[1]  # voxels along the body's own axes treat its sides alike
    centre, face, way = _faces(x @ axes, spacing, float(particles.volume.sum()))
    owner = cKDTree(x @ axes).query(centre)[1]
    total = np.zeros((6 * len(x), 3))
    np.add.at(total, 6 * owner + way, face @ axes.T)
    kept = np.flatnonzero(np.linalg.norm(total, axis=1) > SMALLEST * spacing**2)
    index = (kept // 6)[:, None].astype(np.int32)
    pieces = _level(x[index[:, 0]] / spacing, kept % 6, total[kept])
    return BodySurface(Attachment(index, np.ones((len(kept), 1))), pieces, closed=True)


def _level(at: np.ndarray, way: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Area normals (E, 3), each redistributed among nearby pieces that face the same way; `at` (E, 3): their places [spacings].

    On a lattice a slope becomes terraces one particle high, and each terrace would feel the wind by itself.
    """
    apart = 10.0 * TERRACE * way[:, None]
    tree = cKDTree(np.concatenate([at, apart], axis=1))
    near = tree.sparse_distance_matrix(tree, TERRACE, output_type="coo_matrix")
    weight = csr_matrix((1.0 - (near.data / TERRACE) ** 2 + TINY, (near.row, near.col)), shape=near.shape)
    return weight @ (area / np.asarray(weight.sum(axis=0)).reshape(-1, 1))


def _faces(x: np.ndarray, spacing: float, volume: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The voxels' outer faces: centres (M, 3) [m], area normals (M, 3) [m²], and the direction (M,) that the surface faces there, 0 to 5.

    The direction is the signed axis nearest to the normal of the smoothed surface.
    """
    reach = REACH * spacing
    low, high = x.min(axis=0) - reach - spacing, x.max(axis=0) + reach + spacing
    size = max(spacing / VOXELS, float(np.prod(high - low) / MOST_VOXELS) ** (1.0 / 3.0))
    low = x.min(axis=0) - size * (0.5 + np.ceil((x.min(axis=0) - low) / size))  # particles of a lattice lie between voxels
    shape = np.ceil((high - low) / size).astype(int) + 1
    axes = [low[axis] + size * np.arange(count) for axis, count in enumerate(shape)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    # Cubes around the particles, not balls, so that a plate keeps its edges.
    near = cKDTree(x).query(grid.reshape(-1, 3), p=np.inf, distance_upper_bound=reach)[0].reshape(shape) <= reach
    depth = distance_transform_cdt(near, "chessboard")
    layers = np.arange(1, max(2, int(reach / size)))
    off = layers[np.argmin(np.abs([np.count_nonzero(depth > layer) * size**3 - volume for layer in layers]))]
    inside = np.pad(depth > off, 1)
    outwards = -np.stack(np.gradient(gaussian_filter(inside.astype(np.float32), SMOOTH * spacing / size)), axis=-1)
    centres, faces, ways = [], [], []
    for axis in range(3):
        step = -np.diff(inside.astype(np.int8), axis=axis)  # 1 where the body ends along the axis
        found = np.argwhere(step)
        unit = np.eye(3, dtype=int)[axis]
        normal = outwards[tuple(found.T)] + outwards[tuple((found + unit).T)]
        nearest = np.abs(normal).argmax(axis=1)
        centres.append(low + size * (found - 1 + 0.5 * unit))
        faces.append(size**2 * step[tuple(found.T)][:, None] * unit)
        ways.append(2 * nearest + (normal[np.arange(len(found)), nearest] > 0.0))
    return np.concatenate(centres), np.concatenate(faces), np.concatenate(ways)
