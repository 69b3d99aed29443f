"""The linear equations of a Newton iteration: conjugate gradients, with Cholesky factors of nearly the same matrix before them.

The matrix is 3 x 3 blocks for a vertex and its neighbours (mass, stretching, contact, drag) plus the bending's, which reaches two rings
far. Factors of it all would be large. Those of the same matrix with a simpler bending, which couples only the two vertices across an
edge with its ends, take a fifth of the time, and a few iterations make up for the difference. Where bending between neighbours does
not far outweigh inertia, the coupling across an edge goes too: separators become one row of vertices wide, and factors take a third again.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import bsr_array, csr_array, diags_array

from .bending import Bending
from .blas import one_thread
from .cholesky import BlockCholesky, Factors
from .surface import NONE, Surface

MOST = 200
"""Iterations of conjugate gradients, at most."""
THIN = 20.0
"""Bending between neighbours over inertia up to which factors do without the coupling across edges."""
SINGLE = 1e6
"""Stretching over inertia up to which factors in single precision are good enough: their error is 1e-7 of the stretching."""


@dataclass(frozen=True)
class _Pattern:
    """What depends on where the factored matrix has blocks."""

    plan: BlockCholesky
    kept: np.ndarray
    """Which near blocks the plan keeps,"""
    slots: np.ndarray
    """and which of its blocks they are."""
    hinge: np.ndarray
    """(B,) bending of the plan's blocks [N/m]."""
    held: np.ndarray
    """(B,) bool: a vertex is pinned."""
    alone: np.ndarray
    """Diagonal blocks of pinned vertices."""


class System:
    """What depends on the mesh alone: patterns, orders, and the simpler bending."""

    def __init__(self, surface: Surface, b: Bending, plate: float, pinned: np.ndarray) -> None:
        count, faces = len(surface.x), surface.faces
        self._bending = b.matrix
        self.free = ~pinned
        rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
        near = csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
        near.sort_indices()
        self._indices, self._indptr = near.indices, near.indptr
        self._row = np.repeat(np.arange(count), np.diff(near.indptr))
        key = self._row.astype(np.int64) * count + self._indices
        place = np.searchsorted(key, rows.astype(np.int64) * count + columns)
        size = len(place)
        self._gather = csr_array((np.ones(size), (place, np.arange(size))), shape=(len(key), size))
        self._diagonal = np.searchsorted(key, np.arange(count, dtype=np.int64) * (count + 1))
        self._near, self._hinges, self._places, self._pinned = near, _hinges(surface, plate), surface.x, np.flatnonzero(pinned)
        self._narrow, self._added = _within(near, self._hinges)

    @cached_property
    def _thin(self) -> _Pattern:
        """Faces alone."""
        return self._pattern(self._near, self._narrow)

    @cached_property
    def _wide(self) -> _Pattern:
        """Faces, and the vertices across their edges."""
        return self._pattern(csr_array(self._near + abs(self._hinges)), self._hinges)

    def _pattern(self, entries: csr_array, hinges: csr_array) -> _Pattern:
        plan = BlockCholesky(entries, self._places)
        kept = plan.later(self._row, self._indices)
        row, column = plan.pairs.T
        return _Pattern(
            plan, np.flatnonzero(kept), plan.slots(self._row[kept], self._indices[kept]), np.asarray(hinges[row, column]).ravel(),
            ~self.free[plan.pairs].all(axis=1), plan.slots(self._pinned, self._pinned),
        )  # fmt: skip

    def matrix(self, of_faces: np.ndarray, of_vertices: np.ndarray, bending: float) -> Matrix:
        """A matrix: (F, 9, 9) of faces, (V, 3, 3) of vertices [N/m], and how often the bending's counts."""
        blocks = of_faces.reshape(-1, 3, 3, 3, 3).transpose(0, 1, 3, 2, 4).reshape(-1, 9)
        data = (self._gather @ blocks).reshape(-1, 3, 3)
        data[self._diagonal] += of_vertices
        size = 3 * len(self.free)
        inertia = float(np.median(np.trace(of_vertices, axis1=1, axis2=2))) / 3.0
        return Matrix(self, bsr_array((data, self._indices, self._indptr), shape=(size, size)), bending, inertia)

    def factors(self, data: np.ndarray, bending: float, inertia: float) -> Factors:
        """Of the matrix with near blocks `data` and a simpler bending; pinned vertices stand alone.

        In single precision, which takes two thirds of the time, where the matrix allows it: conjugate gradients mend the rest.
        """
        thin = bending * self._added <= THIN * inertia
        pattern = self._thin if thin else self._wide
        blocks = np.zeros((len(pattern.hinge), 3, 3))
        for c in range(3):
            blocks[:, c, c] = bending * pattern.hinge
        blocks[pattern.slots] += data[pattern.kept]
        blocks[pattern.held] = 0.0
        blocks[pattern.alone] = np.eye(3) * inertia
        with one_thread():
            if thin and np.abs(data[self._diagonal]).max() < SINGLE * inertia:
                with contextlib.suppress(np.linalg.LinAlgError):
                    return pattern.plan.factor(blocks.astype(np.float32))
            return pattern.plan.factor(blocks)

    def bend(self, x: np.ndarray) -> np.ndarray:
        """The bending's matrix times (V, 3)."""
        return self._bending @ x


class Matrix:
    """One matrix, on the free vertices."""

    def __init__(self, system: System, near: bsr_array, bending: float, inertia: float) -> None:
        self._system, self._near, self._bend, self._inertia = system, near, bending, inertia

    def times(self, x: np.ndarray) -> np.ndarray:
        """(V, 3), zero at pinned vertices; x (V, 3) must be zero there."""
        product = (self._near @ x.ravel()).reshape(-1, 3) + self._bend * self._system.bend(x)
        product[~self._system.free] = 0.0
        return product

    def factors(self) -> Factors:
        """For `solved`.

        Raises:
            numpy.linalg.LinAlgError: when the matrix is not positive definite or not finite.
        """
        return self._system.factors(self._near.data, self._bend, self._inertia)

    def solved(self, right: np.ndarray, factors: Factors, tolerance: float) -> tuple[np.ndarray, int]:
        """x (V, 3) with matrix x = right, to a tolerance in the norm of the factors, and the iterations it took."""
        with one_thread():
            x = np.zeros_like(right)
            residual = right.copy()
            z = factors.solve(residual)
            p, rz = z, float((residual * z).sum())
            enough = tolerance**2 * rz
            for iteration in range(1, MOST + 1):
                if rz <= 0.0:
                    return x, iteration
                q = self.times(p)
                step = rz / float((p * q).sum())
                x = x + step * p
                residual = residual - step * q
                z = factors.solve(residual)
                before, rz = rz, float((residual * z).sum())
                if rz <= enough:
                    return x, iteration
                p = z + (rz / before) * p
            return x, MOST


def _within(near: csr_array, hinges: csr_array) -> tuple[csr_array, float]:
    """The hinges' matrix (V, V) with its couplings beyond `near` moved onto the diagonal, and the median of what that adds there [N/m].

    These are positive: 2 e x y becomes e (x² + y²), which adds e (x - y)², and the matrix stays positive semidefinite.
    """
    inside = csr_array(hinges.multiply(near != 0))
    added = np.asarray((hinges - inside).sum(axis=1)).ravel()
    return csr_array(inside + diags_array(added)), float(np.median(added))


def _hinges(surface: Surface, plate: float) -> csr_array:
    """(V, V) of a bending energy that is a sum over inner edges of squared kinks: it weighs a kink as its two faces do, one by one."""
    first = np.unique(surface.edge.ravel(), return_index=True)[1]
    face, k = first // 3, first % 3
    inner = surface.neighbour[face, k] != NONE
    face, k = face[inner], k[inner]
    p, q, c, d = surface.faces[face, (k + 1) % 3], surface.faces[face, (k + 2) % 3], surface.faces[face, k], surface.opposite[face, k]
    x, areas = surface.x, (surface.area[face], surface.area[surface.neighbour[face, k]])
    along = x[q] - x[p]
    squared = (along**2).sum(axis=1)
    length = np.sqrt(squared)
    weights = np.zeros((len(face), 4))
    shares = []
    for tip, column, area in ((c, 2, areas[0]), (d, 3, areas[1])):
        height = 2.0 * area / length
        foot = ((x[tip] - x[p]) * along).sum(axis=1) / squared
        weights[:, 0] -= (1.0 - foot) / height
        weights[:, 1] -= foot / height
        weights[:, column] += 1.0 / height
        shares.append(height)
    total = shares[0] + shares[1]
    stiffness = plate * squared * ((shares[0] / total) ** 2 / areas[0] + (shares[1] / total) ** 2 / areas[1])
    nodes = np.stack([p, q, c, d], axis=1)
    entries = stiffness[:, None, None] * weights[:, :, None] * weights[:, None, :]
    rows, columns = np.repeat(nodes, 4, axis=1).ravel(), np.tile(nodes, (1, 4)).ravel()
    return csr_array((entries.ravel(), (rows, columns)), shape=(len(x), len(x)))
