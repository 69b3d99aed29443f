"""The stress in a sheet as a hidden Gaussian variable: a smooth part over the sheet, and a small independent part in each face.

A stress S (2, 2) [N/m] in a face of area A with deformation gradient F (3, 2) exerts the force -A F S grad N_c on corner c: linear in S.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ....mpm.shell import Shell
from ....mpm.shell.membrane import plane_axes

SMOOTH, FACE = 10.0, 0.1
"""Standard deviations of the smooth stress and of each face's own, in units of the stress that would carry the whole sheet's inertia over
its radius. The smooth one is far larger than this unit, as tension comes in jerks. With 1 for each face, the evidence was lower; with 3
for the smooth stress it was far higher, but the wind was less accurate."""
DEGREE = 8
"""Highest degree of the polynomials that make up the smooth stress."""
FADES = 3.0
"""Number of degrees over which the standard deviation of a polynomial falls by a factor e."""
PARTS = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 1.0], [1.0, 0.0]]])
"""The three parts of a symmetric stress."""


@dataclass(frozen=True)
class Tension:
    """The prior of the stress, and how the stress acts in virtual displacements."""

    faces: np.ndarray
    """(F, 3) vertex indices."""
    slopes: np.ndarray
    """(F, 3, 2) derivatives of the corners' hat functions along the two axes that all faces share [1/m]."""
    loads: np.ndarray
    """(F, Q, 2) minus area times gradient of the virtual displacements."""
    smooth: np.ndarray
    """(F, J) polynomials times their standard deviations [N/m]."""
    rough: float
    """Standard deviation of each face's own stress [N/m]."""

    @staticmethod
    def of(shell: Shell, tests: np.ndarray, acceleration: float) -> Tension:
        """The prior for a sheet with this root mean square acceleration less gravity [m/s²]; tests: (V, Q) virtual displacements."""
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
        """Deformation gradients (..., F, 3, 2) for vertices at x (..., V, 3) [m], with respect to the axes that all faces share."""
        return np.einsum("...fci,fcb->...fib", x[..., self.faces, :], self.slopes)

    def covariance(self, moved: np.ndarray) -> np.ndarray:
        """Covariance (3 Q, 3 Q) of the stress's generalised forces in the virtual displacements, for deformation gradients (F, 3, 2)."""
        forces = np.einsum("fia,mab,fqb->qifm", moved, PARTS, self.loads, optimize=True)
        count = forces.shape[0] * 3
        waves = np.einsum("qifm,fj->qimj", forces, self.smooth, optimize=True).reshape(count, -1)
        forces = forces.reshape(count, -1)
        return waves @ waves.T + self.rough**2 * forces @ forces.T


def _turn(corners: np.ndarray, longest: np.ndarray) -> np.ndarray:
    """Rotations (F, 2, 2) from each face's own axes to those that all share: `longest` (3,) projected onto the face, and across it."""
    t, s = plane_axes(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along = np.stack([t @ longest, s @ longest], axis=1)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    return np.stack([along, np.stack([-along[:, 1], along[:, 0]], axis=1)], axis=2)
