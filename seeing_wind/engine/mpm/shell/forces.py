"""The forces of a sheet's faces on its vertices (`face_kernels`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import face_kernels
from .bending import Bending
from .compiled import launcher, rows_by
from .membrane import Membrane


@dataclass(frozen=True)
class Faces:
    """The state of the faces for given positions of the vertices."""

    F: np.ndarray
    """(F, 3, 2) deformation."""
    stress: np.ndarray
    """(F, 3) S11, S22, S12, damping included [N/m]."""
    curvature: np.ndarray
    """(F, 3) k11, k22, 2 k12 along the normals [1/m]."""
    gradient: np.ndarray
    """(F, 3, 3) derivative with respect to the corners of the membrane's energy, and of the bending energy through the turning of the rest
    curvature with the face [N]."""
    moment: np.ndarray
    """(F, 3, 3) moments times the area, a vector for each of the three curvatures [N m²]."""


class Forces:
    """The forces of one sheet's faces: its constants, as the kernels read them."""

    def __init__(self, m: Membrane, b: Bending, vertices: int) -> None:
        count = len(m.faces)
        self._count, self._vertices = count, vertices
        self._faces = np.ascontiguousarray(m.faces, dtype=np.int32)
        self._slope, self._area = np.ascontiguousarray(m.slope), np.ascontiguousarray(m.area)
        self._buckling = np.ascontiguousarray(m.buckling)
        self._sheet = np.concatenate([[m.stiffness, m.poisson_ratio, 0.0], b.law.ravel()])
        self._rest, self._curved = np.ascontiguousarray(b.rest.T), int(not b.flat)
        self._none = np.zeros((count, 3))
        self._corner = rows_by(m.faces.ravel(), vertices)
        entries = b.curvature.tocoo()
        row, column = entries.coords
        face, part = row % count, row // count
        key, place = np.unique(face.astype(np.int64) * vertices + column, return_inverse=True)
        weight = np.zeros((len(key), 3))
        weight[place.ravel(), part] = entries.data
        face, vertex = key // vertices, key % vertices
        self._first = rows_by(face, count)[0]
        self._vertex, self._weight = vertex.astype(np.int32), weight
        self._first_bent, by_vertex = rows_by(vertex, vertices)
        self._bent, self._bent_weight = face[by_vertex].astype(np.int32), np.ascontiguousarray(weight[by_vertex])
        kernels = face_kernels.forces_of_faces, face_kernels.forces_of_vertices, face_kernels.tangents
        self._of_faces, self._of_vertices, self._tangents = (launcher(kernel) for kernel in kernels)

    def faces(self, x: np.ndarray, lag: float = 0.0, before: Faces | None = None) -> Faces:
        """The faces with vertices at x (V, 3) [m].

        lag: retardation time over the substep; before: the undamped faces at the substep's start, relative to which damping is computed.
        """
        count = self._count
        found = Faces(*(np.empty((count, *shape)) for shape in ((3, 2), (3,), (3,), (3, 3), (3, 3))))
        self._sheet[face_kernels.LAG] = lag
        stress, curvature = (self._none, self._none) if before is None else (before.stress, before.curvature)
        self._of_faces(
            np.ascontiguousarray(x), self._faces, self._slope, self._area, self._buckling, self._sheet, stress, self._first, self._vertex,
            self._weight, self._rest, self._curved, curvature, found.F, found.stress, found.curvature, found.gradient, found.moment,
        )  # fmt: skip
        return found

    def at_vertices(self, x: np.ndarray, inertia: np.ndarray, goal: np.ndarray, push: np.ndarray, faces: Faces) -> np.ndarray:
        """Minus the forces (V, 3) [N] of the faces, of `push` (V, 3) and of inertia (V,) [N/m] about `goal` (V, 3)."""
        force = np.empty((self._vertices, 3))
        self._of_vertices(
            np.ascontiguousarray(x), inertia, goal, np.ascontiguousarray(push, dtype=np.float64), faces.gradient, faces.moment,
            *self._corner, self._first_bent, self._bent, self._bent_weight, force,
        )  # fmt: skip
        return force

    def tangents(self, F: np.ndarray, stress: np.ndarray, lag: float, convex: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """dS/dE (F, 6) at deformation F (F, 3, 2), the upper half row by row, and the stress (F, 3), both times the area [N m].

        lag: retardation time over the substep. convex: leave out the compressive part of the stress, which makes the matrix positive
        semidefinite; False keeps it, for the true derivative.
        """
        tangent, tension = np.empty((self._count, 6)), np.empty((self._count, 3))
        self._sheet[face_kernels.LAG] = lag
        self._tangents(self._area, self._buckling, self._sheet, int(convex), F, stress, tangent, tension)
        return tangent, tension
