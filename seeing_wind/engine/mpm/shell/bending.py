"""Bending: the curvature of every face, and the energy of a thin plate in it.

The curvature of a face follows from the slopes at its three edges by the divergence theorem, A k = sum over edges of l n (x) grad: a
rotation-free element (Onate and Zarate 2000, Int. J. Numer. Methods Eng. 47, 557) on the slopes of `slopes`. A constant curvature is exact
on any mesh, and because both faces of an edge share its slope, the moments of neighbours cancel as they should.

The slopes are those of the positions, all three coordinates at once: k is then a vector, the second derivative of the position. In a flat
sheet that is bent without stretching, k is along the normal and |k| is the curvature, so that the energy

    1/2 D sum A (k11² + k22² + 2 nu k11 k22 + 2 (1 - nu) k12²)

is quadratic in the positions with a constant matrix, yet invariant under rotation (Bergou, Wardetzky, Harmon, Zorin and Grinspun 2006,
Symposium on Geometry Processing 227; Wardetzky et al. 2007, CAGD 24, 499). For a sheet that is curved at rest, k is measured from its
value at rest, turned with the face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from .membrane import Membrane, deformation, plane_axes
from .slopes import edge_slopes
from .surface import Surface

FLAT = 1e-6
"""A sheet counts as flat if its curvature at rest times its median edge length is below this."""


@dataclass(frozen=True)
class Bending:
    """Faces that resist bending."""

    curvature: csr_array
    """(3 F, V) [1/m²]: takes positions to k11 of all faces, then k22, then 2 k12, less the in-plane part that k has at rest."""
    rest: np.ndarray
    """(3, F) k11, k22, 2 k12 at rest, along the normal [1/m]."""
    law: np.ndarray
    """(3, 3) D (1, nu; nu, 1; (1 - nu) / 2) [N m]."""
    area: np.ndarray
    """(F,) at rest [m²]."""
    faces: np.ndarray
    """(F, 3)."""
    matrix: csr_array
    """(V, V) constant second derivative of the energy [N/m]."""

    @property
    def flat(self) -> bool:
        """Whether the sheet is flat at rest."""
        return not self.rest.any()


def bending(surface: Surface, m: Membrane, bending_stiffness: float, pinned: np.ndarray | None = None) -> Bending:
    """The bending of a surface with the membrane m.

    Args:
        bending_stiffness: D of the plate [N m]: B / (1 - nu²), where B was measured on a strip.
        pinned: (V,) bool; None for no pinned vertices.
    """
    nu = m.poisson_ratio
    law = bending_stiffness * np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - nu)]])
    clamp = np.zeros(len(surface.faces), dtype=bool) if pinned is None else pinned[surface.faces].all(axis=1)
    k = _curvature(surface, edge_slopes(surface, clamp))
    k, rest = _from_rest(k, surface, m)
    count = len(surface.faces)
    parts = [k[i * count : (i + 1) * count] for i in range(3)]
    weight = [[law[i, j] * surface.area[:, None] for j in range(3)] for i in range(3)]
    moments = [sum(parts[j].multiply(weight[i][j]) for j in range(3) if law[i, j]) for i in range(3)]
    matrix = csr_array(sum(parts[i].T @ moments[i] for i in range(3)))
    return Bending(k, rest, law, surface.area, surface.faces, matrix)


def _curvature(surface: Surface, slopes: csr_array) -> csr_array:
    """Matrix (3 F, V) [1/m²]: takes a function at the vertices to k11, k22, 2 k12 in the plane of each face, axis 1 from corner 0 to 1."""
    x, faces, count = surface.x, surface.faces, len(surface.faces)
    t, s = plane_axes(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    _, first = np.unique(surface.edge.ravel(), return_index=True)
    rows, columns, values = [], [], []
    across = []
    for side in range(3):
        p, q = faces[:, (side + 1) % 3], faces[:, (side + 2) % 3]
        along = np.stack([((x[q] - x[p]) * axis).sum(axis=1) for axis in (t, s)], axis=1)  # l times the tangent
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1)  # l times the outward normal
        l2 = (along**2).sum(axis=1)
        # l n (x) tangent (w_q - w_p) / l, symmetric
        straight = [normal[:, 0] * along[:, 0], normal[:, 1] * along[:, 1], normal[:, 0] * along[:, 1] + normal[:, 1] * along[:, 0]]
        sign = np.where(first[surface.edge[:, side]] == 3 * np.arange(count) + side, 1.0, -1.0)
        out = [normal[:, 0] ** 2, normal[:, 1] ** 2, 2.0 * normal[:, 0] * normal[:, 1]]
        for i in range(3):
            value = straight[i] / l2 / surface.area
            for end, way in ((q, 1.0), (p, -1.0)):
                rows.append(i * count + np.arange(count))
                columns.append(end)
                values.append(way * value)
            across.append((i * count + np.arange(count), surface.edge[:, side], sign * out[i] / np.sqrt(l2) / surface.area))
    plain = csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(3 * count, len(x)))
    r, c, v = (np.concatenate(part) for part in zip(*across))
    return csr_array(plain + csr_array((v, (r, c)), shape=(3 * count, surface.edges)) @ slopes)


def _from_rest(k: csr_array, surface: Surface, m: Membrane) -> tuple[csr_array, np.ndarray]:
    """The matrix k less its in-plane part at rest, turned with the face, and its part along the normal at rest (3, F) [1/m]."""
    count = len(surface.faces)
    at_rest = (k @ surface.x).reshape(3, count, 3)
    if np.abs(at_rest).max() * surface.edge_length < FLAT:
        return k, np.zeros((3, count))
    axes = deformation(m, surface.x)
    inside = np.einsum("ifc,fca->ifa", at_rest, axes)
    weights = -np.einsum("ifa,fka->ifk", inside, m.slope)
    rows = np.broadcast_to((np.arange(3 * count)).reshape(3, count, 1), weights.shape)
    columns = np.broadcast_to(surface.faces[None], weights.shape)
    moved = csr_array((weights.ravel(), (rows.ravel(), columns.ravel())), shape=k.shape)
    return csr_array(k + moved), np.einsum("ifc,fc->if", at_rest, normals(surface.x, surface.faces))


def normals(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (F, 3) of faces (F, 3) with vertices at x (V, 3)."""
    a, b, c = (x[faces[:, i]] for i in range(3))
    n = np.cross(b - a, c - a)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def energy(b: Bending, x: np.ndarray) -> float:
    """Bending energy [J] of vertices at x (V, 3) [m]."""
    k = (b.curvature @ x).reshape(3, -1, 3) - b.rest[..., None] * normals(x, b.faces)
    return 0.5 * float(np.einsum("ifc,ij,jfc,f->", k, b.law, k, b.area))
