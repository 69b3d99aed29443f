"""The field on a sheet as an inverse problem: unknowns, the balance of forces, and its derivative by the unknowns.

    u(X, t) = sum_p phi_p(X) (sum_k H_k(t) c_kp + m [p = 0])        unknowns theta: c (K, P, 3), then the mean m (3,)

The residual is the imbalance of forces. Its errors are those of `Balance`, and those of the cause's law and of the sheet's stiffness, which
are proportional to the forces concerned and correlated over many frames. Were they taken to be independent from frame to frame, they would
average out over a long clip, and what remains would be attributed to gusts.
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
"""First guess of the error of the cause's law, relative to the root mean square of its force in each mode."""
STIFFNESS = 0.5
"""Relative error of the bending stiffness, independent in each mode."""
LASTS, ALWAYS = 8.0, 0.5
"""Correlation time of the errors of law and moments [frames], and the share of their variance that is constant in time."""
LEAST = 0.01
"""The law's error in a mode is at least that of a mode with this mean square force, relative to the largest."""


@dataclass(frozen=True)
class SheetProblem:
    """The inverse problem of this module; D = (T-1) 3 Q data."""

    balance: Balance
    cause: Cause
    basis: SpatialBasis
    """P modes of the field."""
    hats: np.ndarray
    """(T, K) values of the knots' hat functions."""
    factor: np.ndarray
    """(D, D) lower Cholesky factor of the covariance of the residuals."""
    law: float = LAW
    """Relative error of the cause's law that is contained in `factor`."""
    noise: float = 1.0
    """Factor on the stated errors of positions that is contained in `factor`."""
    reliability: float = 1.0
    """Factor on the cause's forces, which errors of the path make too large in the mean square: see `attenuation`."""
    check: Callable[[], None] = lambda: None
    """Called often; raises to cancel."""

    @property
    def unknowns(self) -> int:
        """n, the number of unknowns."""
        return 3 * self.hats.shape[1] * self.basis.phi.shape[1] + 3

    def coefficients(self, theta: np.ndarray) -> np.ndarray:
        """Coefficients of the field (T, P, 3), mean included, of the unknowns theta (n,)."""
        per_frame = np.tensordot(self.hats, theta[:-3].reshape(self.hats.shape[1], -1, 3), 1)
        per_frame[:, 0] += theta[-3:]
        return per_frame

    def fields(self, theta: np.ndarray) -> np.ndarray:
        """The field at the vertices (T, V, 3) of the unknowns theta (n,)."""
        return np.einsum("vp,tpi->tvi", self.basis.phi, self.coefficients(theta))

    def forces(self, theta: np.ndarray) -> np.ndarray:
        """Generalised forces (T-1, 3 Q) of the cause at theta (n,), weighted by the hats."""
        return self.reliability * self.forces_on(self.balance.at, theta)

    def interpolation_error(self, theta: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """(T-1, 3 Q) standard deviation of the `forces` at theta (n,) due to the unknown motion between frames: the difference between two
        interpolations. It grows by a factor of hundreds where a sheet begins to flutter."""
        off = self.reliability * self.forces_on(self.balance.catmull_rom, theta) - forces
        square = (off.reshape(len(off), -1, 3) ** 2).mean(axis=2)
        around = np.pad(square, ((1, 1), (0, 0)), mode="edge")
        return np.repeat(np.sqrt(0.25 * around[:-2] + 0.5 * square + 0.25 * around[2:]), 3, axis=1)

    def forces_on(self, moments: Moments, theta: np.ndarray) -> np.ndarray:
        """Those of a sheet that moves as in `moments`, without the factor `reliability`."""
        b = self.balance
        fields = self.fields(theta)[:, None]
        forces = [self.cause.generalised_forces(*one, b.tests) for one in zip(fields, moments.x, moments.v, strict=True)]
        return moments.over_hats(np.stack(forces)).reshape(len(b.seen), -1)

    def residual(self, theta: np.ndarray) -> np.ndarray:
        """Whitened residual (D,) at theta (n,)."""
        self.check()
        return self._whitened((self.forces(theta) - self.balance.seen).ravel())

    def linearise(self, theta: np.ndarray) -> Linearisation:
        """The whitened problem linearised at theta (n,)."""
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
        jacobian = self.reliability * np.concatenate([by_knot.reshape(data, -1), by_mean.reshape(data, 3)], axis=1)
        return Linearisation.at(theta, self.residual(theta), self._whitened(jacobian).T)

    def before(self, theta: np.ndarray) -> SheetProblem:
        """The same with errors for a first solve from theta (n,): the law's error is relative to the observed forces."""
        return replace(self, factor=factor_of(self.balance, self.balance.seen, self.interpolation_error(theta, self.forces(theta))))

    def with_errors(self, theta: np.ndarray, law: float | None = None, noise: float | None = None) -> SheetProblem:
        """The same with errors for the forces at theta (n,), and, where given, another relative error of the law or factor on the errors of
        positions."""
        law, noise = self.law if law is None else law, self.noise if noise is None else noise
        forces = self.forces(theta)
        factor = factor_of(self.balance, forces, self.interpolation_error(theta, forces), law, noise)
        return replace(self, law=law, noise=noise, factor=factor)

    def _whitened(self, values: np.ndarray) -> np.ndarray:
        return solve_triangular(self.factor, values, lower=True, check_finite=False)


def factor_of(
    balance: Balance, forces: np.ndarray, unsure: np.ndarray | float = 0.0, law: float = LAW, noise: float = 1.0
) -> np.ndarray:
    """The lower Cholesky factor (D, D) of the covariance of the residuals.

    Args:
        forces: (T-1, 3 Q) generalised forces of the cause.
        unsure: standard deviation of the forces (T-1, 3 Q), independent from frame to frame.
        law: error of the cause's law, relative to the forces.
        noise: factor on the stated errors of positions.

    Raises:
        SimulationError: for a motion that is not finite, or a covariance that is not positive definite.
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
        raise SimulationError(
            "The covariance of the errors in the sheet's forces is not positive definite.", "The take is damaged: run `recover` again."
        ) from error
