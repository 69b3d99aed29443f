"""Dense Gauss-Newton with Levenberg damping in the metric of the prior.

    minimise |r(theta)|² + (theta - m)' P (theta - m)        r whitened residuals, m mean and P precision of the prior

Damping adds lambda P, so that a step is shortened towards what is probable under the prior. One Jacobian serves several *chord* steps, each
with fresh residuals: a Jacobian costs as much as many simulations, a chord step only a few.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ...errors import SimulationError
from .constants import PACE

DAMPING = ((0.0, 1.0), (5.0, 30.0, 200.0, 1e3, 3e4, 1e6))
"""Candidates of lambda: those that usually suffice, and those that are tried otherwise. Each group is simulated in parallel."""


@dataclass(frozen=True)
class Linearisation:
    """The problem linearised at one point."""

    theta: np.ndarray
    """(n,) the point."""
    residual: np.ndarray
    """(m,) whitened residuals at the point."""
    jacobian: np.ndarray
    """(n, m) derivatives of the whitened residuals."""
    normal: np.ndarray
    """(n, n) J'J."""

    @staticmethod
    def at(theta: np.ndarray, residual: np.ndarray, jacobian: np.ndarray) -> Linearisation:
        """A linearisation from point (n,), residual (m,) and Jacobian (n, m)."""
        return Linearisation(theta, residual, jacobian, (jacobian @ jacobian.T).astype(np.float64))

    @property
    def pull(self) -> np.ndarray:
        """(n,) J'(J theta - r), the right side of the linearised problem's normal equations: (J'J + P) posterior mean = pull."""
        return self.normal @ self.theta - self.jacobian @ self.residual


@dataclass(frozen=True)
class Solution:
    """The result of `solve`."""

    theta: np.ndarray
    residual: np.ndarray
    cost: float
    iterations: int
    """Jacobians used."""
    converged: bool
    point: Linearisation
    """The last linearisation; `theta` may be a few chord steps away from its point."""

    @property
    def pull(self) -> np.ndarray:
        """(n,) as `Linearisation.pull`, at `theta` with its residuals, but with the Jacobian of the last linearisation."""
        return self.point.normal @ self.theta - self.point.jacobian @ self.residual


Residuals = Callable[[np.ndarray], np.ndarray]
"""Function from unknowns (B, n) to whitened residuals (B, m), infinite where a simulation broke down."""


def cost_of(residual: np.ndarray, offset: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Costs (B,) from residuals (B, m) and offsets theta - mean (B, n); infinite where a residual is infinite."""
    return (residual**2).sum(axis=-1) + np.einsum("bi,ij,bj->b", offset, precision, offset, optimize=True)


def _damped(normal: np.ndarray, precision: np.ndarray) -> Callable[[float], tuple[np.ndarray, np.ndarray]]:
    """Function from lambda to LU factors of J'J + (1 + lambda) P; cached, as the chord steps of one Jacobian share them."""
    return cache(lambda damp: lu_factor(normal + (1.0 + damp) * precision, overwrite_a=True, check_finite=False))


def solve(
    theta: np.ndarray,
    mean: np.ndarray,
    precision: np.ndarray,
    residuals: Residuals,
    linearise: Callable[[np.ndarray], Linearisation],
    iterations: int,
    report: Callable[[int, np.ndarray], None] = lambda iteration, residual: None,
    point: Linearisation | None = None,
    tolerance: float = PACE.tolerance,
    per_unknown: float = PACE.tolerance_per_unknown,
) -> Solution:
    """Minimise the cost, starting from `theta` (n,).

    Args:
        theta: start, at which the simulation must not break down.
        mean, precision: (n,) and (n, n) of the prior.
        residuals: whitened residuals of several candidates at once.
        linearise: residual and Jacobian at one point; if it breaks down, the last point before stands.
        iterations: most Jacobians to compute; a given `point` does not count.
        report: called with the number of Jacobians so far and the whitened residuals (m,).
        point: a linearisation near `theta` to begin with.
        tolerance, per_unknown: converged when a step promises to lower the cost by less than these, as a share of it or per unknown.

    Raises:
        SimulationError: when the first linearisation breaks down.
    """
    used, cost, before = 0, np.inf, point
    residual = residuals(theta[None])[0] if point else np.zeros(0)
    while True:
        if point is None:
            try:
                point, used = linearise(theta), used + 1
            except SimulationError:
                if before is None:
                    raise
                return Solution(theta, residual, cost, used, False, before)
            residual = point.residual
        cost = float(cost_of(residual[None], (theta - mean)[None], precision)[0])
        report(used, residual)
        at_start, damped = cost, _damped(point.normal, precision)
        for _ in range(PACE.chord_steps):
            gradient = point.jacobian @ residual + precision @ (theta - mean)
            promised = float(gradient @ lu_solve(damped(0.0), gradient))
            if promised < max(per_unknown * len(theta), tolerance * cost):
                return Solution(theta, residual, cost, used, True, point)
            step, missed, lower = _best_step(theta, gradient, damped, residuals, mean, precision, cost)
            if not lower < cost:
                break
            won, cost, theta, residual = cost - lower, lower, step, missed
            if won < PACE.stale * promised:
                break
        if used >= iterations or (used and not cost < (1.0 - tolerance) * at_start):
            return Solution(theta, residual, cost, used, False, point)
        point, before = None, point


def _best_step(
    theta: np.ndarray,
    gradient: np.ndarray,
    damped: Callable[[float], tuple[np.ndarray, np.ndarray]],
    residuals: Residuals,
    mean: np.ndarray,
    precision: np.ndarray,
    cost: float,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Unknowns, residuals and cost after the best step of the first group in `DAMPING` that has one below `cost`, or else of the last."""
    for candidates in DAMPING:
        trials = theta - np.stack([lu_solve(damped(damp), gradient) for damp in candidates])
        missed = residuals(trials)
        costs = cost_of(missed, trials - mean, precision)
        best = int(np.argmin(costs))
        if costs[best] < cost:
            break
    return trials[best], missed[best], float(costs[best])
