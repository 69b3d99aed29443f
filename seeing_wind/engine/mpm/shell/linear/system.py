"""The linear equations of a Newton iteration: conjugate gradients, preconditioned with Cholesky factors of nearly the same matrix.

The matrix has a 3 x 3 block for each vertex and each pair of neighbours (mass, stretching, contact, drag), plus the matrix of bending,
which reaches two rings far. Factors of all this would be large. If bending is replaced by a simpler one, which couples only the two
vertices opposite an edge and its ends, they take a fifth of the time, and a few iterations make up for the difference. Where bending
between neighbours does not far outweigh inertia, the coupling across an edge is dropped as well: separators become one row of vertices
wide, and the factors take a third of that time.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array

from ..bending import Bending
from ..compiled import launcher, rows_by
from ..surface import NONE, Surface
from . import system_kernels
from .cholesky import BlockCholesky, Factors

MOST = 200
"""Iterations of conjugate gradients, at most."""
THIN = 20.0
"""Ratio of bending between neighbours to inertia up to which the factors leave out the coupling across edges."""
SINGLE = 1e6
"""Ratio of stretching to inertia up to which single precision is good enough for the factors: their error is 1e-7 of the stretching."""


@dataclass(frozen=True)
class _Pattern:
    """The pattern of blocks of a matrix that is factored, and where the blocks come from."""

    plan: BlockCholesky
    source: np.ndarray
    """(B,) int32 number of the near block that each block is taken from, or NOT_NEAR, HELD or ALONE (`system_kernels`)."""
    hinge: np.ndarray
    """(B,) entry of the simpler bending's matrix for each block [N/m]."""


class System:
    """What depends on the mesh alone: patterns, orders of elimination, and the simpler bending.

    A near block is the 3 x 3 block of a vertex or of two vertices with a common face.
    """

    def __init__(self, surface: Surface, slope: np.ndarray, b: Bending, plate: float, pinned: np.ndarray) -> None:
        count, faces = len(surface.x), surface.faces
        self.free = ~pinned
        rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
        near = csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
        near.sort_indices()
        self._row, self._column = np.repeat(np.arange(count), np.diff(near.indptr)), near.indices
        key = self._row.astype(np.int64) * count + self._column
        number = np.searchsorted(key, rows.astype(np.int64) * count + columns)
        transposed = np.searchsorted(key, self._column.astype(np.int64) * count + self._row)
        upper = np.flatnonzero(self._row <= self._column)
        vertex = np.where(self._row == self._column, self._row, -1)
        self._twins = np.stack([upper, transposed[upper], vertex[upper]], axis=1).astype(np.int32)
        first, entry = rows_by(number, len(key))
        corner = np.stack([entry // 9, entry // 3 % 3, entry % 3], axis=1)
        used = self._row[number[entry]] <= self._column[number[entry]]
        self._first = np.concatenate([[0], np.cumsum(np.diff(first)[upper])]).astype(np.int32)
        self._corner = np.ascontiguousarray(corner[used], dtype=np.int32)
        self._slope = np.ascontiguousarray(slope)
        self._diagonal = np.flatnonzero(self._row == self._column)
        bend = csr_array(b.matrix)
        self._fixed = near.indptr.astype(np.int32), self._column.astype(np.int32)
        self._bending = bend.indptr.astype(np.int32), bend.indices.astype(np.int32), bend.data, self.free.astype(np.int32)
        self._near, self._hinges, self._places, self._pinned = near, _hinges(surface, plate), surface.x, np.flatnonzero(pinned)
        self._narrow, self._added = _within(near, self._hinges)
        self._near_blocks, self._product = (launcher(k) for k in (system_kernels.near_blocks, system_kernels.product))
        self._factored = {real: launcher(system_kernels.factored_blocks, real) for real in map(np.dtype, (np.float32, np.float64))}

    @cached_property
    def _thin(self) -> _Pattern:
        """Pattern of vertices with a common face."""
        return self._pattern(self._near, self._narrow)

    @cached_property
    def _wide(self) -> _Pattern:
        """Pattern of vertices with a common face, or on both sides of a common edge."""
        return self._pattern(csr_array(self._near + abs(self._hinges)), self._hinges)

    def _pattern(self, entries: csr_array, hinges: csr_array) -> _Pattern:
        plan = BlockCholesky(entries, self._places)
        kept = plan.later(self._row, self._column)
        row, column = plan.pairs.T
        source = np.full(len(row), system_kernels.NOT_NEAR, np.int32)
        source[plan.slots(self._row[kept], self._column[kept])] = np.flatnonzero(kept)
        source[~self.free[plan.pairs].all(axis=1)] = system_kernels.HELD
        source[plan.slots(self._pinned, self._pinned)] = system_kernels.ALONE
        return _Pattern(plan, source, np.asarray(hinges[row, column]).ravel())

    def matrix(self, F: np.ndarray, tangents: tuple[np.ndarray, np.ndarray], of_vertices: np.ndarray, bending: float) -> Matrix:
        """A matrix from the faces' deformation F (F, 3, 2) and `Forces.tangents`, the blocks `of_vertices` (V, 3, 3) [N/m] on the diagonal,
        and the matrix of bending times `bending`."""
        data = np.empty((len(self._row), 3, 3))
        self._near_blocks(self._twins, self._first, self._corner, F, self._slope, *tangents, np.ascontiguousarray(of_vertices), data)
        inertia = float(np.median(np.trace(of_vertices, axis1=1, axis2=2))) / 3.0
        return Matrix(self, data, bending, inertia)

    def times(self, near: np.ndarray, bending: float, x: np.ndarray) -> np.ndarray:
        """The matrix with the blocks `near` and the factor `bending` on bending, times x (V, 3): (V, 3), zero at pinned vertices."""
        result = np.empty_like(x)
        self._product(*self._fixed, near, *self._bending[:3], np.array([bending]), self._bending[3], x, result)
        return result

    def factors(self, data: np.ndarray, bending: float, inertia: float) -> Factors:
        """Factors of the matrix with near blocks `data` and the simpler bending; pinned vertices are decoupled.

        They are in single precision, which takes two thirds of the time, where the matrix allows it: conjugate gradients correct the rest.
        """
        thin = bending * self._added <= THIN * inertia
        pattern = self._thin if thin else self._wide
        if thin and np.abs(data[self._diagonal]).max() < SINGLE * inertia:
            with contextlib.suppress(np.linalg.LinAlgError):
                return self._factors(pattern, data, bending, inertia, np.float32)
        return self._factors(pattern, data, bending, inertia, np.float64)

    def _factors(self, pattern: _Pattern, data: np.ndarray, bending: float, inertia: float, real: type[np.floating]) -> Factors:
        blocks: np.ndarray = np.empty((len(pattern.hinge), 3, 3), dtype=real)
        self._factored[blocks.dtype](pattern.source, pattern.hinge, np.array([bending, inertia]), data, blocks)
        return pattern.plan.factor(blocks)


class Unfinished(np.linalg.LinAlgError):
    """Conjugate gradients have not reached their tolerance; `x` (V, 3) is the solution so far."""

    def __init__(self, x: np.ndarray, iterations: int) -> None:
        super().__init__(f"conjugate gradients have not converged after {iterations} iterations")
        self.x = x


class Matrix:
    """One matrix, on the free vertices."""

    def __init__(self, system: System, near: np.ndarray, bending: float, inertia: float) -> None:
        self._system, self._near, self._bend, self._inertia = system, near, bending, inertia

    def times(self, x: np.ndarray) -> np.ndarray:
        """The matrix times x (V, 3): (V, 3), zero at pinned vertices; x must be zero there."""
        return self._system.times(self._near, self._bend, x)

    def factors(self) -> Factors:
        """Factors for `solve`.

        Raises:
            numpy.linalg.LinAlgError: when the matrix is not positive definite or not finite.
        """
        return self._system.factors(self._near, self._bend, self._inertia)

    def solve(self, right: np.ndarray, factors: Factors, tolerance: float, most: int = MOST) -> tuple[np.ndarray, int]:
        """x (V, 3) with matrix x = right, to a relative tolerance in the preconditioner's norm, and the iterations it took.

        Each iteration makes one solve with the factors, whose result both measures the error of the last x and improves it.

        Raises:
            Unfinished: when `most` iterations are not enough.
            numpy.linalg.LinAlgError: when a number is not finite, or the matrix is not positive definite.
        """
        x, residual, p = np.zeros_like(right), right.copy(), np.zeros_like(right)
        before, enough = np.inf, 0.0
        for iteration in range(1, most + 1):
            z = factors.solve(residual)
            rz = float((residual * z).sum())
            if rz == 0.0:
                return x, iteration
            p = z + (rz / before) * p
            q = self.times(p)
            pq = float((p * q).sum())
            if not (rz > 0.0 and 0.0 < pq < np.inf):
                raise np.linalg.LinAlgError("the matrix is not positive definite, or not finite")
            x += (rz / pq) * p
            if rz <= enough:
                return x, iteration
            residual -= (rz / pq) * q
            if iteration == 1:
                enough = tolerance**2 * rz
            before = rz
        raise Unfinished(x, most)


def _within(near: csr_array, hinges: csr_array) -> tuple[csr_array, float]:
    """The hinges' matrix (V, V) with its couplings beyond `near` moved onto the diagonal, and the median of what that adds there [N/m].

    The couplings are positive: 2 e x y becomes e (x² + y²), which adds e (x - y)², so the matrix stays positive semidefinite.
    """
    inside = csr_array(hinges.multiply(near != 0))
    added = np.asarray((hinges - inside).sum(axis=1)).ravel()
    return csr_array(inside + diags_array(added)), float(np.median(added))


def _hinges(surface: Surface, plate: float) -> csr_array:
    """Matrix (V, V) [N/m] of a simpler bending energy: a sum over inner edges of the squared change of slope across the edge, weighted with
    the bending energy that it causes in the two faces."""
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
