"""Dense Gauss-Newton with Levenberg damping in the prior's own metric.

    minimise |r(theta)|² + (theta - m)' P (theta - m)        r whitened residuals, m mean and P precision of the prior

Damping adds lambda P, so that a shortened step is one that the prior likes, not an arbitrary one. One Jacobian serves several *chord*
steps with fresh residuals: a Jacobian costs a simulation per unknown, a step half a dozen.
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
"""Candidates of lambda: those that mostly serve, and those tried when they do not. Those of a group are simulated in parallel."""


@dataclass(frozen=True)
class Linearisation:
    """The problem at one point."""

    theta: np.ndarray
    """(n,)."""
    residual: np.ndarray
    """(m,) whitened residuals."""
    jacobian: np.ndarray
    """(n, m) their derivatives."""
    normal: np.ndarray
    """(n, n) J'J."""

    @staticmethod
    def at(theta: np.ndarray, residual: np.ndarray, jacobian: np.ndarray) -> Linearisation:
        """From point, residual and Jacobian."""
        return Linearisation(theta, residual, jacobian, (jacobian @ jacobian.T).astype(np.float64))

    @property
    def pull(self) -> np.ndarray:
        """(n,) J'(J theta - r): right side of the normal equations (J'J + P) mean = pull of the linearised problem."""
        return self.normal @ self.theta - self.jacobian @ self.residual


@dataclass(frozen=True)
class Solution:
    """Where the iterations ended."""

    theta: np.ndarray
    residual: np.ndarray
    cost: float
    iterations: int
    """Jacobians used."""
    converged: bool
    point: Linearisation
    """The last linearisation; theta may be some chord steps away."""

    @property
    def pull(self) -> np.ndarray:
        """(n,) that of the last linearisation with theta and its residuals."""
        return self.point.normal @ self.theta - self.point.jacobian @ self.residual


Residuals = Callable[[np.ndarray], np.ndarray]
"""(B, n) -> whitened residuals (B, m), infinite where a simulation broke down."""


def cost_of(residual: np.ndarray, offset: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """(B,) costs of residuals (B, m) at theta - mean (B, n); infinite where a residual is."""
    return (residual**2).sum(axis=-1) + np.einsum("bi,ij,bj->b", offset, precision, offset, optimize=True)


def _damped(normal: np.ndarray, precision: np.ndarray) -> Callable[[float], tuple[np.ndarray, np.ndarray]]:
    """lambda -> LU factors of J'J + (1 + lambda) P, each made once: the chord steps of one Jacobian share them."""
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
    """Minimise from `theta` (n,).

    Args:
        theta: start, at which the simulation must not break down.
        mean, precision: (n,) and (n, n) of the prior.
        residuals: of several candidates at once.
        linearise: residual and Jacobian at one point; where it breaks down, what was found before stands, if anything was.
        iterations: Jacobians at most, the one given not counted.
        report: called with the number of Jacobians so far and the whitened residuals (m,).
        point: a linearisation near `theta` to begin with.
        tolerance, per_unknown: what a step must promise, as a share of the cost and per unknown.
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
            for candidates in DAMPING:
                trials = theta - np.stack([lu_solve(damped(damp), gradient) for damp in candidates])
                missed = residuals(trials)
                costs = cost_of(missed, trials - mean, precision)
                best = int(np.argmin(costs))
                if costs[best] < cost:
                    break
            if not costs[best] < cost:
                break
            won, cost, theta, residual = cost - costs[best], float(costs[best]), trials[best], missed[best]
            if won < PACE.stale * promised:
                break
        if used >= iterations or (used and not cost < (1.0 - tolerance) * at_start):
            return Solution(theta, residual, cost, used, False, point)
        point, before = None, point
