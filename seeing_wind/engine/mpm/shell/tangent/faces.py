"""Derivatives of the forces of a sheet's faces: by where the vertices are, and by where they were when the substep began.

The latter matters for damping only, which counts from there. All terms are kept, those as well that Newton's method leaves out: how a
compressed face gives way, and how the normals turn along which damping and a bent shape at rest act.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ..forces import Faces
from ..model import Shell
from .blocks import Corners, curvatures, diagonal

UPPER = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Where the six numbers of a symmetric 3 x 3 matrix go."""


@dataclass(frozen=True)
class Turning:
    """How the faces lie at some place of the vertices."""

    n: np.ndarray
    """(F, 3) unit normals."""
    slope: np.ndarray
    """(F, 3, 3) gradient of each corner's hat function in the face's plane [1/m]."""
    by_corners: np.ndarray
    """(F, 3, 9) derivative of n."""
    edge: np.ndarray
    """(F, 3, 3) the edge opposite each corner [m]."""
    twice: np.ndarray
    """(F,) twice the area [m²]."""

    @staticmethod
    def at(x: np.ndarray, faces: np.ndarray) -> Turning:
        """With vertices at x (V, 3) [m]."""
        corners = x[faces]
        edge = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        twice = np.linalg.norm(normal, axis=1)
        n = normal / twice[:, None]
        slope = np.cross(n[:, None], edge) / twice[:, None, None]
        by_corners = -np.einsum("fci,fj->ficj", slope, n).reshape(-1, 3, 9)
        return Turning(n, slope, by_corners, edge, twice)


class FaceSlopes:
    """What depends on the mesh alone."""

    def __init__(self, shell: Shell) -> None:
        self._shell = shell
        m, b = shell.membrane, shell.bending
        self.corners = Corners(m.faces, len(shell.mass))
        self._curvature = curvatures(b)
        self._spread = csr_array(self._curvature.T)
        self._law = b.area[:, None, None] * b.law
        moments = diagonal(np.einsum("fkl,ij->fkilj", self._law, np.eye(3)).reshape(-1, 9, 9))
        self._plain = csr_array(self._spread @ (moments @ self._curvature))

    def at_end(self, x: np.ndarray, faces: Faces, lag: float, before: Faces) -> csr_array:
        """(3 V, 3 V) derivative of minus the forces by x (V, 3), where the faces are `faces`; lag and before: as of `Forces.faces`."""
        shell, b = self._shell, self._shell.bending
        blocks = self._stretching(faces.F, *shell.forces.tangents(faces.F, faces.stress, lag, convex=False))
        if not lag and b.flat:
            return csr_array(self._plain + self.corners.assembled(blocks))
        turning, k = Turning.at(x, b.faces), self._vectors(x)
        along = np.einsum("fki,fi->fk", k, turning.n)
        damped = lag * (along - before.curvature) - b.rest.T
        twist = lag * np.einsum("fi,fmj,fjd->fmid", turning.n, k, turning.by_corners)
        twist += np.einsum("fm,fid->fmid", damped, turning.by_corners)
        by_corners = np.einsum("fkm,fmid->fkid", self._law, twist).reshape(-1, 9, 9)
        total = self._plain + self._spread @ (diagonal(by_corners) @ self.corners.gather)
        if lag:
            own = lag * np.einsum("fkm,fi,fj->fkimj", self._law, turning.n, turning.n).reshape(-1, 9, 9)
            total = total + self._spread @ (diagonal(own) @ self._curvature)
        if not b.flat:
            by_curvature, by_place = self._bent_at_rest(turning, k)
            blocks = blocks + by_place
            total = total + self.corners.scatter @ (diagonal(by_curvature) @ self._curvature)
        return csr_array(total + self.corners.assembled(blocks))

    def at_start(self, x: np.ndarray, faces: Faces, lag: float, begun: np.ndarray, before: Faces) -> csr_array:
        """(3 V, 3 V) derivative of minus the forces at x (V, 3) by `begun` (V, 3), where the substep began."""
        shell = self._shell
        tangent, _ = shell.forces.tangents(before.F, before.stress, 0.0, convex=False)
        stretch = np.einsum("fad,fab,fbe->fde", self._strains(faces.F), -lag * tangent[:, UPPER], self._strains(before.F))
        now, then, k = Turning.at(x, shell.bending.faces), Turning.at(begun, shell.bending.faces), self._vectors(begun)
        by_curvature = -lag * np.einsum("fkm,fi,fj->fkimj", self._law, now.n, then.n).reshape(-1, 9, 9)
        by_corners = -lag * np.einsum("fkm,fi,fmj,fjd->fkid", self._law, now.n, k, then.by_corners, optimize=True).reshape(-1, 9, 9)
        bend = self._spread @ (diagonal(by_curvature) @ self._curvature + diagonal(by_corners) @ self.corners.gather)
        return csr_array(bend + self.corners.assembled(stretch))

    def _vectors(self, x: np.ndarray) -> np.ndarray:
        """(F, 3, 3) the three curvature vectors of each face [1/m]."""
        return (self._curvature @ x.ravel()).reshape(-1, 3, 3)

    def _strains(self, F: np.ndarray) -> np.ndarray:
        """(F, 3, 9) derivative of Green's strain E11, E22, 2 E12 by the corners."""
        slope = self._shell.membrane.slope
        rows = [
            slope[..., 0, None] * F[:, None, :, 0],
            slope[..., 1, None] * F[:, None, :, 1],
            slope[..., 1, None] * F[:, None, :, 0] + slope[..., 0, None] * F[:, None, :, 1],
        ]
        return np.stack(rows, axis=1).reshape(len(F), 3, 9)

    def _stretching(self, F: np.ndarray, tangent: np.ndarray, tension: np.ndarray) -> np.ndarray:
        """(F, 9, 9) of the membrane, from `Forces.tangents`."""
        strains, slope = self._strains(F), self._shell.membrane.slope
        stress = np.stack([tension[:, [0, 2]], tension[:, [2, 1]]], axis=1)
        taut = np.einsum("fca,fab,fdb,ij->fcidj", slope, stress, slope, np.eye(3), optimize=True).reshape(-1, 9, 9)
        return np.einsum("fad,fab,fbe->fde", strains, tangent[:, UPPER], strains, optimize=True) + taut

    def _bent_at_rest(self, t: Turning, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(F, 9, 9) each: how the force by which a bent shape at rest turns with its face changes with curvature, and with the corners."""
        at_rest = np.einsum("fkl,lf->fk", self._law, self._shell.bending.rest)
        p = np.einsum("fk,fki->fi", at_rest, k)
        by_curvature = np.einsum("fi,fcj,fk->fcikj", t.n, t.slope, at_rest).reshape(-1, 9, 9)
        # The force at corner c is (p . slope_c) n with slope_c = n x edge_c / (2 area).
        share = np.einsum("fci,fi->fc", t.slope, p)
        grown = t.slope.reshape(-1, 1, 9)  # of the area, relative
        edges = np.zeros((3, 3, 3, 3))
        for c in range(3):
            edges[c, :, (c + 2) % 3], edges[c, :, (c + 1) % 3] = np.eye(3), -np.eye(3)
        twisted = np.cross(t.edge, p[:, None])  # p . (dn x e) = dn . (e x p)
        moved = np.cross(p, t.n)  # p . (n x de) = de . (p x n)
        change = np.einsum("fci,fid->fcd", twisted, t.by_corners) + np.einsum("fi,cid->fcd", moved, edges.reshape(3, 3, 9))
        change = change / t.twice[:, None, None] - share[..., None] * grown
        by_place = np.einsum("fcd,fi->fcid", change, t.n) + np.einsum("fc,fid->fcid", share, t.by_corners)
        return by_curvature, by_place.reshape(-1, 9, 9)
