"""The stress in a sheet as a hidden Gaussian: smooth over the sheet for the most part, and a little different in every face.

The force of a stress S (2, 2) [N/m] in a face of area A, deformed by F (3, 2), on its corner c is -A F S grad N_c: linear in S.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ....mpm.shell import Shell
from ....mpm.shell.membrane import plane_axes

SMOOTH, FACE = 10.0, 0.1
"""Standard deviation of the smooth stress, and of that of each face, in units of what would carry the sheet's whole inertia over its
radius. The smooth one is far larger than that, as tension comes in jerks. With a face's of 1 sheets were less probable, and with a smooth
one of 3 far more so, but then their wind came out worse."""
DEGREE = 8
"""Highest degree of the polynomials that the smooth stress consists of."""
FADES = 3.0
"""Degrees over which their size falls by e."""
PARTS = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 1.0], [1.0, 0.0]]])
"""The three parts of a symmetric stress."""


@dataclass(frozen=True)
class Tension:
    """What is known of it."""

    faces: np.ndarray
    """(F, 3)."""
    slopes: np.ndarray
    """(F, 3, 2) derivatives of the corners' hats in the directions that all faces share [1/m]."""
    loads: np.ndarray
    """(F, Q, 2) minus the area times the slopes of the virtual displacements."""
    smooth: np.ndarray
    """(F, J) polynomials times their standard deviations [N/m]."""
    rough: float
    """Standard deviation of what each face has besides [N/m]."""

    @staticmethod
    def of(shell: Shell, tests: np.ndarray, acceleration: float) -> Tension:
        """For virtual displacements (V, Q) of a sheet that is accelerated by so much [m/s²], gravity included."""
        surface = shell.surface
        rest = surface.x - np.average(surface.x, axis=0, weights=shell.mass)
        axes = np.linalg.svd(rest, full_matrices=False)[2][:2]
        slopes = np.einsum("fca,fab->fcb", shell.membrane.slope, _turn(surface.x[surface.faces], axes[0]))
        loads = -surface.area[:, None, None] * np.einsum("fcq,fcb->fqb", tests[surface.faces], slopes)
        flat = rest @ axes.T
        at = flat[surface.faces].mean(axis=1) / np.maximum(np.abs(flat).max(axis=0), 1e-300)
        unit = shell.sheet.areal_density * acceleration * float(np.linalg.norm(rest, axis=1).max())
        powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
        first, second = (np.polynomial.legendre.legvander(at[:, axis], DEGREE) for axis in (0, 1))
        smooth = np.stack([SMOOTH * unit * math.exp(-(i + j) / FADES) * first[:, i] * second[:, j] for i, j in powers], axis=1)
        return Tension(surface.faces, slopes, loads, smooth, FACE * unit)

    def gradients(self, x: np.ndarray) -> np.ndarray:
        """Deformations (..., F, 3, 2) of vertices x (..., V, 3) [m], in the directions that all faces share."""
        return np.einsum("...fci,fcb->...fib", x[..., self.faces, :], self.slopes)

    def covariance(self, moved: np.ndarray) -> np.ndarray:
        """(3 Q, 3 Q) of its forces in the virtual displacements, at deformations (F, 3, 2)."""
        forces = np.einsum("fia,mab,fqb->qifm", moved, PARTS, self.loads, optimize=True)
        count = forces.shape[0] * 3
        waves = np.einsum("qifm,fj->qimj", forces, self.smooth, optimize=True).reshape(count, -1)
        forces = forces.reshape(count, -1)
        return waves @ waves.T + self.rough**2 * forces @ forces.T


def _turn(corners: np.ndarray, longest: np.ndarray) -> np.ndarray:
    """(F, 2, 2) from the faces' own axes to those that they share: the direction (3,) `longest` in their planes, and across it."""
    t, s = plane_axes(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along = np.stack([t @ longest, s @ longest], axis=1)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    return np.stack([along, np.stack([-along[:, 1], along[:, 0]], axis=1)], axis=2)
