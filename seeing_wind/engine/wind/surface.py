"""The surface of a simulated body as pieces with an area and a normal: where the air has hold of it.

A body that has a triangle mesh gives its triangles. One that is particles only gets its surface from them: the space within reach of a
particle is marked on fine voxels, and the faces between marked and unmarked ones are summed for the particle and the side of it where
they lie. Such sums have no stairs: by Gauss's theorem the vectors of a stair add up to that of the slope. Both sides of a sheet that is a
single particle thick are kept apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from ..records import Attachment, Particles
from .drag import TINY, area_normals

REACH = 1.1
"""Particle spacings round a particle that are marked at first, so that no gap stays between neighbours."""
SKIN = 0.5
"""Particle spacings from the outer particles to the surface: of what is marked, all beyond is taken off again."""
VOXELS = 4
"""Per spacing; fewer, see `MOST_VOXELS`, for a large body."""
MOST_VOXELS = 20_000_000
NEIGHBOURS = 12
"""Of a particle, that tell which way the surface faces there."""
SMALLEST = 0.02
"""Of the square of the spacing: a piece with less area is left out."""


@dataclass(frozen=True)
class BodySurface:
    """E pieces of surface that ride on particles."""

    attachment: Attachment
    """Of each piece's centre."""
    rest: np.ndarray
    """(E, 3) area normals at rest [m²], pointing outwards where `closed`."""
    closed: bool
    """As in `drag.face_forces`: air is on the outer side only."""
    triangles: np.ndarray | None = None
    """(E, 3) of a mesh; None for pieces of particles."""
    vertices: Attachment | None = None
    """Of the mesh."""
    offset: np.ndarray | None = None
    """(V, 3) what the attachment does not reproduce of the vertices at rest [m]."""

    def normals(self, x: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Area normals (E, 3) [m²] of the body at positions x (N, 3) [m] with deformation gradients F (N, 3, 3).

        Of a mesh those of its triangles; of particles a = J F^-T A (Nanson's formula).
        """
        if self.triangles is not None and self.vertices is not None:
            return area_normals(self.vertices.follow(x) + self.offset, self.triangles)
        carrier = F[self.attachment.index[:, 0]]
        return np.linalg.det(carrier)[:, None] * np.linalg.solve(np.swapaxes(carrier, 1, 2), self.rest[..., None])[..., 0]

    def spread(self, force: np.ndarray, count: int) -> np.ndarray:
        """Forces, or anything else that adds up, on the pieces (E, ...) -> on `count` particles (N, ...)."""
        weight = self.attachment.weight.reshape(*self.attachment.weight.shape, *(1,) * (force.ndim - 1))
        total = np.zeros((count, *force.shape[1:]))
        np.add.at(total, self.attachment.index, weight * force[:, None])
        return total


def mesh_surface(vertices: np.ndarray, triangles: np.ndarray, attachment: Attachment, x: np.ndarray, closed: bool) -> BodySurface:
    """The triangles (E, 3) of a mesh, vertices (V, 3) [m] at rest, which ride on particles x (N, 3) by `attachment`."""
    index = attachment.index[triangles].reshape(len(triangles), -1)
    weight = attachment.weight[triangles].reshape(len(triangles), -1) / 3.0
    offset = vertices - attachment.follow(x)
    return BodySurface(Attachment(index, weight), area_normals(vertices, triangles), closed, np.asarray(triangles), attachment, offset)


def particle_surface(particles: Particles) -> BodySurface:
    """The surface of particles at rest. A single particle gets that of a cube of its volume."""
    x, spacing = particles.x, particles.spacing
    if len(x) <= NEIGHBOURS:  # each a lump of its own, as in the simulation
        sides = np.concatenate([np.eye(3), -np.eye(3)])
        area = particles.volume ** (2.0 / 3.0)
        index = np.repeat(np.arange(len(x)), 6)[:, None].astype(np.int32)
        return BodySurface(Attachment(index, np.ones((len(index), 1))), (area[:, None, None] * sides).reshape(-1, 3), closed=True)
    axes = np.linalg.eigh(np.cov(x.T))[1]  # voxels along the body's own axes treat its sides alike
    centre, face = (found @ axes.T for found in _faces(x @ axes, spacing))
    nearest = cKDTree(x).query(x, k=NEIGHBOURS)[1]
    around = x[nearest] - x[nearest].mean(axis=1, keepdims=True)
    facing = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))[1][:, :, 0]
    owner = cKDTree(x).query(centre)[1]
    side = ((centre - x[owner]) * facing[owner]).sum(axis=1) > 0.0
    total = np.zeros((2 * len(x), 3))
    np.add.at(total, 2 * owner + side, face)
    kept = np.flatnonzero(np.linalg.norm(total, axis=1) > SMALLEST * spacing**2)
    index = (kept // 2)[:, None].astype(np.int32)
    return BodySurface(Attachment(index, np.ones((len(kept), 1))), total[kept], closed=True)


def _faces(x: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres (M, 3) [m] of the voxels' outer faces and their area normals (M, 3) [m²]."""
    low, high = x.min(axis=0) - (REACH + 1.0) * spacing, x.max(axis=0) + (REACH + 1.0) * spacing
    size = max(spacing / VOXELS, float(np.prod(high - low) / MOST_VOXELS) ** (1.0 / 3.0))
    shape = np.ceil((high - low) / size).astype(int) + 1
    axes = [low[axis] + size * np.arange(count) for axis, count in enumerate(shape)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    near = cKDTree(x).query(grid.reshape(-1, 3), distance_upper_bound=REACH * spacing)[0].reshape(shape) <= REACH * spacing
    inside = np.pad(distance_transform_edt(near) * size > (REACH - SKIN) * spacing, 1).astype(np.int8)
    centres, faces = [], []
    for axis in range(3):
        step = -np.diff(inside, axis=axis)  # 1 where the body ends along the axis
        found = np.argwhere(step)
        unit = np.eye(3)[axis]
        centres.append(low + size * (found - 1 + 0.5 * unit))
        faces.append(size**2 * step[tuple(found.T)][:, None] * unit)
    return np.concatenate(centres), np.concatenate(faces)


def facing_area(normals: np.ndarray, direction: np.ndarray) -> float:
    """Area [m²] that a closed surface of area normals (E, 3) shows along `direction` (3,)."""
    direction = direction / max(float(np.linalg.norm(direction)), TINY)
    return float(np.maximum(-normals @ direction, 0.0).sum())
