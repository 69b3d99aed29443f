"""The prior of a sheet's shape, whatever moves it: its edges keep their lengths, and it has no sharp folds.

Both enter as squared errors in units of their standard deviations. The bend between two neighbouring faces is linear in the vertices
(Bergou et al., A quadratic bending model for inextensible surfaces, SGP 2006), so its Hessian is constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, kron

from .mesh import SheetMesh, edges_of

STRETCHED = 0.003
"""Standard deviation of the strain of an edge that is longer than in frame 0: threads hardly stretch. Along the bias, cloth does more."""
FOLDED = 2.0
"""Shortening [standard deviations] from which an edge costs less and less (Cauchy), as a fold within it may shorten it by any amount."""


@dataclass(frozen=True)
class Allowed:
    """Standard deviations of a sheet's shape in one frame."""

    curvature: float
    """Of the curvature, times the sheet's size (the root of its area)."""
    shortening: float
    """Of the strain of an edge that is shorter than in frame 0: an edge is a chord, and wrinkles finer than the mesh shorten it."""

    def within(self, least: Allowed, most: Allowed) -> Allowed:
        """The nearest that lies between two others."""
        return Allowed(
            min(most.curvature, max(least.curvature, self.curvature)), min(most.shortening, max(least.shortening, self.shortening))
        )


LOOSEST, TIGHTEST = Allowed(15.0, 0.02), Allowed(0.3, STRETCHED)
"""What is assumed at first, which allows a handful of folds; and the least that is estimated, as no sheet is a plane."""


class Template:
    """The shape of a mesh that keeps its lengths."""

    def __init__(self, mesh: SheetMesh) -> None:
        self.rest = mesh.x
        self.edges, self.hinges = edges_of(mesh.faces), hinges_of(mesh.faces)
        self._lengths = np.linalg.norm(self.rest[self.edges[:, 0]] - self.rest[self.edges[:, 1]], axis=1)
        self._size = mesh.size
        columns = (3 * self.edges[:, :, None] + np.arange(3)).reshape(len(self.edges), 6)
        self._where = (np.repeat(columns, 6, axis=1).ravel(), np.tile(columns, 6).ravel())

    def cost(self, x: np.ndarray, allowed: Allowed) -> float:
        """Half the sum of squares for vertices at x (V, 3) [m]."""
        strain = self._strains(x, allowed)[0]
        more, less = np.maximum(strain, 0.0), np.minimum(strain, 0.0)
        strains = float((more**2 + FOLDED**2 * np.log1p((less / FOLDED) ** 2)).sum())
        return 0.5 * (strains + float(x.ravel() @ (self.bends @ x.ravel())) / allowed.curvature**2)

    def linearise(self, x: np.ndarray, allowed: Allowed) -> tuple[csr_matrix, np.ndarray]:
        """Gauss-Newton Hessian (3V, 3V) and gradient (3V,) for vertices at x (V, 3) [m]."""
        strain, slope = self._strains(x, allowed)
        weight = 1.0 / (1.0 + (np.minimum(strain, 0.0) / FOLDED) ** 2)
        blocks = weight[:, None, None] * slope[:, :, None] * slope[:, None, :]
        gradient = np.zeros(x.size)
        np.add.at(gradient, self._where[0].reshape(-1, 6, 6)[:, :, 0].ravel(), ((weight * strain)[:, None] * slope).ravel())
        stretch = coo_matrix((blocks.ravel(), self._where), (x.size, x.size)).tocsr()
        bending = self.bends / allowed.curvature**2
        return stretch + bending, gradient + bending @ x.ravel()

    def shortening(self, x: np.ndarray) -> float:
        """Standard deviation of the shortening of edges with vertices at x (V, 3) [m], from its median: a few folds do not count."""
        strain = np.linalg.norm(x[self.edges[:, 0]] - x[self.edges[:, 1]], axis=1) / self._lengths - 1.0
        shorter = strain[strain < 0.0]
        return 1.4826 * float(np.median(-shorter)) if shorter.size else 0.0

    def _strains(self, x: np.ndarray, allowed: Allowed) -> tuple[np.ndarray, np.ndarray]:
        """Strains (E,) of the edges in standard deviations, and their derivatives (E, 6) by the two ends of each edge."""
        apart = x[self.edges[:, 0]] - x[self.edges[:, 1]]
        length = np.linalg.norm(apart, axis=1)
        sigma = np.where(length > self._lengths, STRETCHED, allowed.shortening)
        slope = apart / (length * self._lengths * sigma)[:, None]
        return (length / self._lengths - 1.0) / sigma, np.hstack([slope, -slope])

    @cached_property
    def bends(self) -> csr_matrix:
        """Matrix B (3V, 3V) of the bends: x^T B x is the sum of squared angles between faces, in units of a curvature of 1 / size."""
        a, b, c, d = self.rest[self.hinges].swapaxes(0, 1)
        side = b - a
        one, two = _cotangent(side, c - a), _cotangent(side, d - a)
        three, four = _cotangent(-side, c - b), _cotangent(-side, d - b)
        length = np.linalg.norm(side, axis=1)
        area = 0.5 * (np.linalg.norm(np.cross(side, c - a), axis=1) + np.linalg.norm(np.cross(side, d - a), axis=1))
        allowed = (2.0 / 3.0) * area / (length * self._size)  # sigma of an angle: curvature times the distance of the faces' centres
        weight = np.stack([three + four, one + two, -one - three, -two - four], axis=1) / (length * allowed)[:, None]
        rows = np.repeat(np.arange(len(self.hinges)), 4)
        bends = csr_matrix((weight.ravel(), (rows, self.hinges.ravel())), (len(self.hinges), len(self.rest)))
        return kron(bends.T @ bends, np.eye(3), format="csr")


def hinges_of(faces: np.ndarray) -> np.ndarray:
    """For every edge that two faces share, the vertices (H, 4): its two ends, and the opposite corner of each face."""
    sides = np.concatenate([faces[:, [0, 1, 2]], faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]])
    ends = np.sort(sides[:, :2], axis=1)
    order = np.lexsort(ends.T)
    ends, across = ends[order], sides[order, 2]
    twin = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
    return np.column_stack([ends[twin], across[twin], across[twin + 1]])


def _cotangent(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=1) / np.linalg.norm(np.cross(a, b), axis=1)
