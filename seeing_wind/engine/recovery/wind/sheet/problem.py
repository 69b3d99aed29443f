"""The field on a sheet as an inverse problem: unknowns, the balance of forces, and its derivative by the unknowns.

    u(X, t) = sum_p phi_p(X) (sum_k H_k(t) c_kp + m [p = 0])        unknowns theta: c (K, P, 3), then the mean m (3,)

Residuals are what the balance lacks. Their errors are those of `Balance`, and those of the law of the cause and of the sheet's stiffness:
a part of the forces that these make, which lasts. Errors that are taken to be independent from frame to frame would be averaged away over
a long clip, and what is left of them be put down to gusts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from ....errors import SimulationError
from ...prior.basis import SpatialBasis
from ...solve.gauss_newton import Linearisation
from .air import Cause
from .balance import Balance, Moments

LAW = 0.05
"""Error of the cause's law to begin with, as a part of the root mean square of its force in each mode."""
STIFFNESS = 0.5
"""Relative error of the bending stiffness, in each mode apart."""
LASTS, ALWAYS = 8.0, 0.5
"""Frames over which the law's error changes, and the part of its variance that never does."""
LEAST = 0.01
"""Least mean square of a mode's force, relative to the largest, of which the law's error is a part."""


@dataclass(frozen=True)
class SheetProblem:
    """See above; D = (T-1) 3 Q data."""

    balance: Balance
    cause: Cause
    basis: SpatialBasis
    """P modes of the field."""
    hats: np.ndarray
    """(T, K)."""
    factor: np.ndarray
    """(D, D) lower triangle whose square is the covariance of the residuals."""
    law: float = LAW
    """Error of the cause's law that `factor` has, and"""
    noise: float = 1.0
    """how many times as large as they are said to be it takes errors in the places for."""
    check: Callable[[], None] = lambda: None

    @property
    def unknowns(self) -> int:
        """n."""
        return 3 * self.hats.shape[1] * self.basis.phi.shape[1] + 3

    def coefficients(self, theta: np.ndarray) -> np.ndarray:
        """theta (n,) -> (T, P, 3), the mean included."""
        per_frame = np.tensordot(self.hats, theta[:-3].reshape(self.hats.shape[1], -1, 3), 1)
        per_frame[:, 0] += theta[-3:]
        return per_frame

    def fields(self, theta: np.ndarray) -> np.ndarray:
        """(T, V, 3)."""
        return np.einsum("vp,tpi->tvi", self.basis.phi, self.coefficients(theta))

    def forces(self, theta: np.ndarray) -> np.ndarray:
        """(T-1, 3 Q) of the cause, under the hats."""
        return self._forces_at(self.balance.at, theta)

    def unsure(self, theta: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """(T-1, 3 Q) standard deviation of the `forces` at theta (n,), as it is not known how the sheet moves between frames: how far two
        interpolations differ. Where a sheet begins to flutter, that is hundreds of times as much as before."""
        off = self._forces_at(self.balance.plainly, theta) - forces
        square = (off.reshape(len(off), -1, 3) ** 2).mean(axis=2)
        around = np.pad(square, ((1, 1), (0, 0)), mode="edge")
        return np.repeat(np.sqrt(0.25 * around[:-2] + 0.5 * square + 0.25 * around[2:]), 3, axis=1)

    def _forces_at(self, moments: Moments, theta: np.ndarray) -> np.ndarray:
        b = self.balance
        tested = [self.cause.tested(*one, b.tests) for one in zip(self.fields(theta)[:, None], moments.x, moments.v, strict=True)]
        return moments.over_hats(np.stack(tested)).reshape(len(b.seen), -1)

    def residual(self, theta: np.ndarray) -> np.ndarray:
        """Whitened (D,)."""
        self.check()
        return self._whitened((self.forces(theta) - self.balance.seen).ravel())

    def linearise(self, theta: np.ndarray) -> Linearisation:
        """At theta (n,)."""
        b, fields = self.balance, self.fields(theta)
        parts = []
        for field, x, v in zip(fields, b.at.x, b.at.v, strict=True):
            self.check()
            slope = self.cause.slopes(field, x, v, b.tests, self.basis.phi)
            parts.append(np.tensordot([b.at.rising, b.at.falling], slope.reshape(len(slope), 3 * b.tests.shape[1], -1), 1))
        rising, falling = (np.stack([part[side] for part in parts]) for side in (0, 1))
        rising, falling = rising[:-1], falling[1:]
        by_knot = np.einsum("tk,tdp->tdkp", self.hats[:-1], rising) + np.einsum("tk,tdp->tdkp", self.hats[1:], falling)
        by_mean = (rising + falling)[..., :3]
        data = b.seen.size
        jacobian = np.concatenate([by_knot.reshape(data, -1), by_mean.reshape(data, 3)], axis=1)
        return Linearisation.at(theta, self.residual(theta), self._whitened(jacobian).T)

    def before(self, theta: np.ndarray) -> SheetProblem:
        """The same with errors for a first solve from theta (n,): the law's as a part of what the sheet was seen to feel."""
        return replace(self, factor=factor_of(self.balance, self.balance.seen, self.unsure(theta, self.forces(theta))))

    def with_errors(self, theta: np.ndarray, law: float | None = None, noise: float | None = None) -> SheetProblem:
        """The same with another error of the law, a part of the forces at theta (n,), or of the places."""
        law, noise = self.law if law is None else law, self.noise if noise is None else noise
        forces = self.forces(theta)
        factor = factor_of(self.balance, forces, self.unsure(theta, forces), law, noise)
        return replace(self, law=law, noise=noise, factor=factor)

    def _whitened(self, values: np.ndarray) -> np.ndarray:
        return solve_triangular(self.factor, values, lower=True, check_finite=False)


def factor_of(
    balance: Balance, forces: np.ndarray, unsure: np.ndarray | float = 0.0, law: float = LAW, noise: float = 1.0
) -> np.ndarray:
    """The lower triangle (D, D) of the residuals' covariance, where the cause makes the forces (T-1, 3 Q), give or take `law` of them.

    Args:
        unsure: standard deviation of the forces (T-1, 3 Q) in each frame apart.
        noise: errors in the places are this many times as large as they are said to be.

    Raises:
        SimulationError: for a motion that is not finite, or errors that are no covariance.
    """
    count, data = balance.seen.shape
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    size = np.repeat((forces.reshape(count, -1, 3) ** 2).mean(axis=(0, 2)), 3)
    off = law**2 * np.maximum(size, LEAST * size.max())
    lasting = ALWAYS + (1.0 - ALWAYS) * np.exp(-lag / LASTS)
    covariance = np.einsum("km,de->kdme", lasting, balance.bent)
    places = noise**2 * balance.noise
    before, here, after = places[:-2], places[1:-1], places[2:]
    for apart, values in enumerate((before + 4.0 * here + after, -2.0 * (here + after)[:-1], after[:-2])):
        first = np.arange(max(count - apart, 0))
        for k, m in {(0, apart), (apart, 0)}:
            covariance[first + k, :, first + m] += values[: len(first)]
    each = np.arange(data)
    covariance[:, each, :, each] += lasting * off[:, None, None] + STIFFNESS**2 * np.einsum("kd,md->dkm", balance.bending, balance.bending)
    every = np.arange(count)
    covariance[every, :, every] += balance.hidden + np.eye(data) * np.broadcast_to(unsure, balance.seen.shape)[:, None, :] ** 2
    whole = covariance.reshape(count * data, -1)
    if not np.isfinite(whole).all():
        raise SimulationError("The sheet's forces are not finite.", "Check the points, the mesh and the material's numbers.")
    try:
        return cholesky(whole, lower=True, overwrite_a=True, check_finite=False)
    except np.linalg.LinAlgError as error:
        raise SimulationError("The errors of the sheet's forces are no covariance.", "The take is damaged: run `recover` again.") from error
