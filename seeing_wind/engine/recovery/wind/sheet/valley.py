"""The uncertainty of the most probable wind, also where a sheet hardly determines one of its components.

A sheet that turns little feels hardly more than |w| (w.n): a wind across it, and stronger ones at a slant, push it alike. In minus its
logarithm the posterior is then a long, bent valley with an almost level floor, and a Gaussian at the lowest point is far too narrow. The
floor is therefore walked: the least known component of the mean is held at one value after the other, everything else is solved for, and
each place is weighted by its evidence.
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
"""If the deviation of the least known component is less than this share of the mean speed, the linearised posterior is used."""
STEP = 1.5
"""Distance between places [standard deviations of the linearised posterior]."""
FALLS = 4.0
"""The walk ends where the logarithm of the probability has fallen this far below the greatest."""
STEPS = 6
"""Most steps to either side."""
FIRM = 10.0
"""How firmly the component is held: length of a step over the standard deviation that is left to the component."""
ITERATIONS = 3
"""Most linearisations at each place; few suffice, as each place is close to the one before."""


@dataclass(frozen=True)
class Posterior:
    """The posterior distribution of the unknowns."""

    theta: np.ndarray
    """(n,) the most probable unknowns."""
    covariance: np.ndarray
    """(n, n) mean square error of `theta`, over the whole valley."""
    known: bool
    """True if there is no valley."""

    def between_knots(self, hats: np.ndarray) -> Posterior:
        """The same on knots in every frame, given the hat functions (T, K) of the present knots."""
        modes = (len(self.theta) - 3) // hats.shape[1]
        onto = block_diag(np.kron(hats, np.eye(modes)), np.eye(3))
        return Posterior(onto @ self.theta, onto @ self.covariance @ onto.T, self.known)


def mixed(several: Sequence[Posterior], evidence: Sequence[float]) -> Posterior:
    """The most probable of several posteriors, with a covariance that includes the others, weighted by their log `evidence`."""
    weights = np.exp(np.array(evidence) - max(evidence))
    best = several[int(np.argmax(weights))]
    spread = [one.covariance + np.outer(one.theta - best.theta, one.theta - best.theta) for one in several]
    return Posterior(best.theta, np.einsum("a,aij->ij", weights / weights.sum(), spread), best.known)


def posterior_of(problem: SheetProblem, prior: Prior, theta: np.ndarray, check: Callable[[], None] = lambda: None) -> Posterior:
    """The posterior around a solution theta (n,), by a walk along the valley if there is one; check: raises to cancel."""
    precision, means = prior.precision(), mean_wind(problem)
    covariance = np.linalg.inv(problem.linearise(theta).normal + precision)
    variances, axes = np.linalg.eigh(means @ covariance @ means.T)
    step = STEP * float(np.sqrt(max(variances[-1], 0.0)))
    narrow = step < STEP * NARROW * float(np.linalg.norm(means @ theta))
    if narrow or isinstance(problem.cause, Push):  # an acceleration enters linearly, so its posterior is Gaussian
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
    """The matrix (3, n) that maps the unknowns to the uniform wind's mean over time."""
    gusts = np.zeros((3, problem.hats.shape[1], problem.basis.phi.shape[1], 3))
    gusts[:, :, 0] = problem.hats.mean(axis=0)[None, :, None] * np.eye(3)[:, None, :]
    return np.concatenate([gusts.reshape(3, -1), np.eye(3)], axis=1)


@dataclass(frozen=True)
class _Place:
    """A place on the valley's floor."""

    theta: np.ndarray
    covariance: np.ndarray
    probable: float
    """Logarithm of the probability, up to an additive constant."""


def _held(problem: SheetProblem, precision: np.ndarray, start: np.ndarray, along: np.ndarray, value: float, step: float) -> _Place:
    """The most probable unknowns whose component `along` (n,) is held near `value`, solved from `start` (n,)."""
    firm = (FIRM / step) ** 2
    held = precision + firm * np.outer(along, along)
    mean = np.linalg.solve(held, firm * value * along)
    found = solve(
        start, mean, held, lambda trials: np.stack([problem.residual(one) for one in trials]), problem.linearise, ITERATIONS
    )
    total = problem.linearise(found.theta).normal + held
    cost = float(found.residual @ found.residual + found.theta @ precision @ found.theta)
    return _Place(found.theta, np.linalg.inv(total), -0.5 * (cost + float(np.linalg.slogdet(total)[1])))
