"""How far off the most probable wind may be where a sheet hardly tells one of its components.

A sheet that turns little feels |w| (w.n) and hardly more: a wind across it, and stronger ones at a slant, push it alike. The posterior
is then a long, bent valley, its floor as good as level, and a Gaussian at the lowest point is far too narrow. So the floor is walked: the
least known component of the mean is held at one value after the other, all else is solved for, and each place counts by its evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from ...prior.kernel import Prior
from ...solve.gauss_newton import solve
from .air import Push
from .problem import SheetProblem

NARROW = 0.2
"""A component whose deviation is less than this part of the mean speed is known: the linearised posterior serves."""
STEP = 1.5
"""Between two places, in standard deviations of the linearised posterior."""
FALLS = 4.0
"""The walk ends where the logarithm of the probability is less than the greatest by this much, or after"""
STEPS = 6
"""steps to either side."""
FIRM = 10.0
"""How firmly the component is held: steps over its deviation."""
ITERATIONS = 3
"""Linearisations at each place, most of them close to the last."""


@dataclass(frozen=True)
class Posterior:
    """Of the unknowns."""

    theta: np.ndarray
    """(n,) the most probable ones, and"""
    covariance: np.ndarray
    """(n, n) their mean square error, all of the valley counted."""
    known: bool
    """Whether there is no valley."""

    def between_knots(self, hats: np.ndarray) -> Posterior:
        """The same with a knot in each frame, where the knots had hats (T, K)."""
        modes = (len(self.theta) - 3) // hats.shape[1]
        onto = block_diag(np.kron(hats, np.eye(modes)), np.eye(3))
        return Posterior(onto @ self.theta, onto @ self.covariance @ onto.T, self.known)


def mixed(several: Sequence[Posterior], evidence: Sequence[float]) -> Posterior:
    """One of several that were found from different starts: the most probable, with the others' errors by their log evidence."""
    weights = np.exp(np.array(evidence) - max(evidence))
    best = several[int(np.argmax(weights))]
    spread = [one.covariance + np.outer(one.theta - best.theta, one.theta - best.theta) for one in several]
    return Posterior(best.theta, np.einsum("a,aij->ij", weights / weights.sum(), spread), best.known)


def walked(problem: SheetProblem, prior: Prior, theta: np.ndarray, check: Callable[[], None] = lambda: None) -> Posterior:
    """The posterior about a solution theta (n,)."""
    precision, means = prior.precision(), mean_wind(problem)
    covariance = np.linalg.inv(problem.linearise(theta).normal + precision)
    variances, axes = np.linalg.eigh(means @ covariance @ means.T)
    step = STEP * float(np.sqrt(max(variances[-1], 0.0)))
    narrow = step < STEP * NARROW * float(np.linalg.norm(means @ theta))
    if narrow or isinstance(problem.cause, Push):  # a force of its own is linear
        return Posterior(theta, covariance, True)
    along = axes[:, -1] @ means
    places = [_held(problem, precision, theta, along, float(along @ theta), step)]
    for way in (step, -step):
        at = places[0]
        for _ in range(STEPS):
            check()
            start = at.theta + way * (covariance @ along) / float(along @ covariance @ along)
            at = _held(problem, precision, start, along, float(along @ start), step)
            places.append(at)
            if at.probable < max(one.probable for one in places) - FALLS:
                break
    return mixed([Posterior(one.theta, one.covariance, False) for one in places], [one.probable for one in places])


def mean_wind(problem: SheetProblem) -> np.ndarray:
    """(3, n) the uniform wind's mean over time, from the unknowns."""
    gusts = np.zeros((3, problem.hats.shape[1], problem.basis.phi.shape[1], 3))
    gusts[:, :, 0] = problem.hats.mean(axis=0)[None, :, None] * np.eye(3)[:, None, :]
    return np.concatenate([gusts.reshape(3, -1), np.eye(3)], axis=1)


@dataclass(frozen=True)
class _Place:
    theta: np.ndarray
    covariance: np.ndarray
    probable: float
    """Logarithm, but for a constant."""


def _held(problem: SheetProblem, precision: np.ndarray, start: np.ndarray, along: np.ndarray, value: float, step: float) -> _Place:
    """The most probable unknowns whose component `along` (n,) has this value, from `start` (n,)."""
    firm = (FIRM / step) ** 2
    held = precision + firm * np.outer(along, along)
    mean = np.linalg.solve(held, firm * value * along)
    found = solve(
        start, mean, held, lambda trials: np.stack([problem.residual(one) for one in trials]), problem.linearise, ITERATIONS
    )
    total = problem.linearise(found.theta).normal + held
    cost = float(found.residual @ found.residual + found.theta @ precision @ found.theta)
    return _Place(found.theta, np.linalg.inv(total), -0.5 * (cost + float(np.linalg.slogdet(total)[1])))
