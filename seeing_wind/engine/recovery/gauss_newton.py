"""Dense Gauss-Newton with Levenberg damping in the prior's own metric.

    minimise |r(theta)|² + theta' P theta        r whitened residuals, P the prior's precision

Damping adds lambda P, so that a shortened step is one that the prior likes, not an arbitrary one. One Jacobian serves several *chord*
steps with fresh residuals: a Jacobian costs a simulation per unknown, a residual one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

DAMPING = (0.0, 0.3, 3.0, 30.0, 300.0, 3000.0)
"""Candidates of lambda, all tried at once: the simulations of a line search run in parallel."""
CHORD_STEPS = 3
TOLERANCE = 1e-3
"""Relative fall of the cost under which the solve has converged."""
CHORD_GAIN = 0.2
"""A chord step that wins less than this share of the cost's fall so far is not followed by another one."""


@dataclass(frozen=True)
class Linearisation:
    """The problem at one point: residual (m,), Jacobian (n, m) of the whitened residuals."""

    theta: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    normal: np.ndarray
    """(n, n) J'J."""

    @staticmethod
    def at(theta: np.ndarray, residual: np.ndarray, jacobian: np.ndarray) -> Linearisation:
        return Linearisation(theta, residual, jacobian, jacobian @ jacobian.T)

    @property
    def pull(self) -> np.ndarray:
        """(n,) J'(J theta - r): the right side of the linearised problem's normal equations."""
        return self.normal @ self.theta - self.jacobian @ self.residual


@dataclass(frozen=True)
class Solution:
    """Where the iterations ended."""

    theta: np.ndarray
    cost: float
    iterations: int
    """Jacobians used."""
    converged: bool
    last: Linearisation


Residuals = Callable[[np.ndarray], np.ndarray]
"""(B, n) -> whitened residuals (B, m), with infinities where a simulation broke down."""


def cost_of(residual: np.ndarray, theta: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """(B,) costs; infinite where a residual is."""
    data = np.where(np.isfinite(residual), residual, np.inf)
    return (data**2).sum(axis=-1) + np.einsum("bi,ij,bj->b", theta, precision, theta)


def solve(
    theta: np.ndarray,
    precision: np.ndarray,
    residuals: Residuals,
    linearise: Callable[[np.ndarray], Linearisation],
    iterations: int,
    report: Callable[[int, float], None] = lambda iteration, cost: None,
) -> Solution:
    """Minimise from `theta` (n,) with at most `iterations` Jacobians.

    Args:
        theta: start (n,), at which the simulation does not break down.
        precision: (n, n) of the prior, whose mean is zero.
        residuals: whitened residuals of several candidates at once.
        linearise: residual and Jacobian at one point.
        iterations: Jacobians at most.
        report: called with the iteration and the cost.
    """
    cost, converged = np.inf, False
    used = 0
    while True:
        point = linearise(theta)
        used += 1
        start = float(cost_of(point.residual[None], theta[None], precision)[0])
        cost = start
        report(used, cost)
        residual, damping = point.residual, DAMPING
        for _ in range(CHORD_STEPS):
            gradient = point.jacobian @ residual + precision @ theta
            steps = [np.linalg.solve(point.normal + (1.0 + damp) * precision, gradient) for damp in damping]
            trial = theta - np.stack(steps)
            missed = residuals(trial)
            costs = cost_of(missed, trial, precision)
            best = int(np.argmin(costs))
            if not costs[best] < cost:
                break
            gain, cost, theta, residual = cost - costs[best], float(costs[best]), trial[best], missed[best]
            damping = tuple(sorted({0.0, DAMPING[best]}))
            if gain < max(CHORD_GAIN * (start - cost), TOLERANCE * cost):
                break
        converged = start - cost < TOLERANCE * start
        if converged or used >= iterations:
            return Solution(theta, cost, used, converged, point)
