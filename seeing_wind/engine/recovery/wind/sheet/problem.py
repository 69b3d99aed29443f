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
    least: np.ndarray
    """(D,) least standard deviation of the errors of what is seen [m]."""
    more: tuple[float, float] = (1.0, 1.0)
    """How many times that they are, along the normals and within the sheet."""
    check: Callable[[], None] = lambda: None

    @property
    def across(self) -> np.ndarray:
        """(D,) bool: which of the data are along the normals."""
        within = 2 * int((self.views.degree <= ALONG).sum())
        return np.arange(self.views.phi.shape[1] + within) < self.views.phi.shape[1]

    @property
    def sigma(self) -> np.ndarray:
        """(D,) [m]."""
        return self.least * np.where(self.across, *self.more)

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

    def reweighed(self, point: Linearisation, residual: np.ndarray, precision: np.ndarray) -> tuple[SheetProblem, Linearisation]:
        """The same with errors as large as what the data leave unexplained at a linearisation (MacKay 1992), and that one with them.

        Args:
            residual: (m,) whitened, where the solve ended; precision: (n, n) of the prior.
        """
        covariance, across = np.linalg.inv(point.normal + precision), np.tile(self.across, len(self.hats))
        more = []
        for now, part in zip(self.more, (across, ~across), strict=True):
            slope = point.jacobian[:, part]
            free = part.sum() - float(np.einsum("im,im->", slope, covariance @ slope))
            more.append(max(1.0, now * float(np.sqrt((residual[part] ** 2).sum() / max(free, 0.1 * part.sum())))))
        other = replace(self, more=(more[0], more[1]))
        scale = np.tile(self.sigma / other.sigma, len(self.hats))
        return other, Linearisation.at(point.theta, residual * scale, point.jacobian * scale)
