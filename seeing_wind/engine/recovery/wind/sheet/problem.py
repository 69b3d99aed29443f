"""The field on a sheet as an inverse problem: unknowns, what is seen of the sheet, and the derivative of one by the other.

    u(X, t) = sum_p phi_p(X) (sum_k H_k(t) c_kp + m [p = 0])        unknowns theta: c (K, P, 3), then the mean m (3,)

What is compared of the following simulation and the sheet is how far one is off the other, as smooth modes over the sheet: along the
normals, where the air pushes, and, apart and with an error of its own, in the sheet. Another sheet's stretching, which is not this one's,
shows in the latter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...prior.basis import SpatialBasis
from ...solve.gauss_newton import Linearisation
from .following import Follower

ALONG = 1
"""Highest degree of the modes of what is off within the sheet."""


@dataclass(frozen=True)
class SheetProblem:
    """See above."""

    follower: Follower
    basis: SpatialBasis
    """P modes of the field."""
    views: SpatialBasis
    """Q modes in which the sheet is compared."""
    weight: np.ndarray
    """(V,) of the vertices: their share of the mass that is free."""
    hats: np.ndarray
    """(T, K)."""
    noise: tuple[float, float]
    """Standard deviation of one number of what is seen, along the normals and within the sheet [m]."""
    check: Callable[[], None] = lambda: None

    @property
    def across(self) -> np.ndarray:
        """(D,) bool: which of the data are along the normals."""
        within = 2 * int((self.views.degree <= ALONG).sum())
        return np.arange(self.views.phi.shape[1] + within) < self.views.phi.shape[1]

    @property
    def sigma(self) -> np.ndarray:
        """(D,) [m]."""
        return np.where(self.across, *self.noise)

    def coefficients(self, theta: np.ndarray) -> np.ndarray:
        """theta (n,) -> (T, P, 3), the mean included."""
        per_frame = np.tensordot(self.hats, theta[:-3].reshape(self.hats.shape[1], -1, 3), 1)
        per_frame[:, 0] += theta[-3:]
        return per_frame

    def fields(self, theta: np.ndarray) -> np.ndarray:
        """(T, V, 3)."""
        return np.einsum("vp,tpi->tvi", self.basis.phi, self.coefficients(theta))

    def seen(self, off: np.ndarray, frame: int) -> np.ndarray:
        """What is seen (D, R) of displacements (V, 3, R) at the end of a frame."""
        axes = self.follower.seen.axes[frame + 1]
        turned = np.matmul(axes, off) * self.weight[:, None, None]
        smooth = self.views.phi[:, self.views.degree <= ALONG]
        count, directions = smooth.shape[1], off.shape[2]
        normal = self.views.phi.T @ turned[:, 0]
        within = (smooth.T @ turned[:, 1:].reshape(len(off), -1)).reshape(2 * count, directions)
        return np.concatenate([normal, within])

    def off(self, path: np.ndarray) -> np.ndarray:
        """(T, D) [m] of places (T+1, V, 3)."""
        away = path - self.follower.seen.x
        return np.stack([self.seen(away[t + 1][..., None], t)[:, 0] for t in range(len(self.hats))])

    def residual(self, theta: np.ndarray) -> np.ndarray:
        """Whitened (m,)."""
        return (self.off(self.follower.path(self.fields(theta), self.check)) / self.sigma).ravel()

    def linearise(self, theta: np.ndarray) -> Linearisation:
        """At theta (n,)."""
        path, slopes = self.follower.linearised(self.fields(theta), self.basis.phi, self.hats, self.seen, self.check)
        mean = slopes[:, 0].sum(axis=0)
        jacobian = np.concatenate([slopes.reshape(-1, *slopes.shape[3:]), mean]) / self.sigma
        return Linearisation.at(theta, (self.off(path) / self.sigma).ravel(), jacobian.reshape(len(jacobian), -1))

    def with_noise(self, noise: tuple[float, float], point: Linearisation) -> tuple[SheetProblem, Linearisation]:
        """The same with other errors, and its linearisation."""
        other = replace(self, noise=noise)
        scale = np.tile(self.sigma / other.sigma, len(self.hats))
        return other, Linearisation.at(point.theta, point.residual * scale, point.jacobian * scale)
