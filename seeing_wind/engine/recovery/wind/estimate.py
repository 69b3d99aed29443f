"""From the force on a body to the wind that caused it: the most probable u(x, t) under the drag law, and its uncertainty.

The wind is a mean plus gusts. The gusts are a Gaussian process with the kernel of `recovery.prior.kernel`, in m/s instead of m/s², smooth
over space and time. Its size, length and time maximise the evidence. The drag law is not exact, so its predictions have an error
proportional to the size of the force; the two factors, for the net force and for its variation over the body, maximise the evidence too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...field.confidence import farthest_points
from ...progress import NoProgress, Progress
from ..prior.basis import SpatialBasis, hats, knots
from ..prior.evidence import linearised_evidence, maximise_evidence
from ..prior.kernel import Kernel, Places, Prior
from ..solve.gauss_newton import Linearisation, Solution, solve
from .felt import Felt
from .together import FeltTogether

MOST_KNOTS = 24
"""Most knots in time. In a longer clip a knot stands only every few frames."""
ROUNDS, ITERATIONS = 2, 12
"""How often the hyperparameters are learnt, and the most linearisations in each solve."""
MEAN = 20.0
"""Prior standard deviation of each component of the mean wind [m/s]."""
GUST = 0.5
"""First guess of the size of the gusts, relative to the wind."""
SHARES = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Candidate errors of the drag law, relative to the root mean square acceleration; the evidence chooses. No drag law of this kind is more
accurate than the first: with a smaller error, the friction along a plate, whose coefficient is uncertain by a factor of two, would be
taken for evidence of the wind along it."""
SAMPLES = 4
"""Particles per mode at which the covariance of the wind is evaluated."""
FIRST_SHARE = 1
"""Index in `SHARES` of the error to begin with."""


@dataclass(frozen=True)
class Estimate:
    """The wind on the body."""

    velocity: np.ndarray
    """(T, N, 3) u at the particles [m/s]."""
    deviation: np.ndarray
    """(T, N, 3) posterior standard deviation of the velocity [m/s]."""
    mean: np.ndarray
    """(3,) the mean wind [m/s]."""
    kernel: Kernel
    """Prior covariance of the gusts."""
    shares: tuple[float, float]
    """Relative errors of the drag law with the greatest evidence: for the net force, and for its variation over the body."""
    unexplained: float
    """Root mean square of the net force that this wind leaves unexplained, relative to that of the net force."""
    evidence: float
    """Natural logarithm of the probability density of the force's modes, in units of 1 m/s²."""


Observed = Felt | FeltTogether
"""D data in each of T frames, and P modes in which the wind is written."""


@dataclass(frozen=True)
class Problem:
    """Unknowns theta (n,): coefficients of the gusts (knots, modes, 3), then the mean wind (3,). Data: the modes of the force."""

    predicted: Callable[[np.ndarray], np.ndarray]
    """Coefficients of the wind (T, P, 3) -> predicted data (T, D) [m/s²], the net force first."""
    slopes: Callable[[np.ndarray], np.ndarray]
    """Coefficients of the wind (T, P, 3) -> derivatives of the predicted data by them (T, D, P, 3)."""
    felt: Observed
    hats: np.ndarray
    """(T, knots) values of the hat functions of the knots."""

    @property
    def measured(self) -> np.ndarray:
        """The data (T, D) [m/s²]."""
        return self.felt.measured

    def noise(self, shares: tuple[float, float]) -> np.ndarray:
        """(T, D) standard deviation of the data, the error of the drag law included [m/s²]."""
        share = np.where(self.felt.net, *shares)
        return np.sqrt(self.felt.deviation**2 + (share * self.felt.size / math.sqrt(3.0)) ** 2)

    def coefficients(self, theta: np.ndarray) -> np.ndarray:
        """Coefficients of the wind (T, P, 3), mean included, of the unknowns theta (n,)."""
        per_frame = np.tensordot(self.hats, theta[:-3].reshape(self.hats.shape[1], self.felt.modes, 3), 1)
        per_frame[:, self.felt.uniform_modes] += theta[-3:]
        return per_frame

    def residual(self, theta: np.ndarray, shares: tuple[float, float]) -> np.ndarray:
        """Whitened residual (T * D,) at theta (n,)."""
        return ((self.predicted(self.coefficients(theta)) - self.measured) / self.noise(shares)).ravel()

    def linearise(self, theta: np.ndarray, shares: tuple[float, float]) -> Linearisation:
        """The whitened problem linearised at theta (n,)."""
        wind = self.coefficients(theta)
        slope = self.slopes(wind) / self.noise(shares)[..., None, None]
        gusts = np.einsum("tk,tdpb->kpbtd", self.hats, slope).reshape(-1, self.measured.size)
        mean = slope[:, :, self.felt.uniform_modes].sum(axis=2).transpose(2, 0, 1).reshape(3, -1)
        return Linearisation.at(theta, self.residual(theta, shares), np.concatenate([gusts, mean]))


def wind_problem(felt: Observed) -> Problem:
    """The problem in which a wind explains the force through the drag law."""
    return Problem(felt.predicted, felt.slopes, felt, _hats(len(felt.measured)))


def force_problem(felt: Felt) -> Problem:
    """The rival problem, in which the unknown is a force without a drag law: the wind has to be more probable than that."""
    return Problem(
        lambda force: np.einsum("tdpi,tpi->td", felt.seen, force),
        lambda force: felt.seen,
        felt,
        _hats(len(felt.measured)),
    )


def _hats(frames: int) -> np.ndarray:
    return hats(frames, spacing_of(frames))


def spacing_of(frames: int) -> float:
    """Frames between the knots of the wind."""
    return float(max(1, math.ceil(frames / MOST_KNOTS)))


@dataclass(frozen=True)
class Found:
    """The solution of a `Problem`."""

    theta: np.ndarray
    precision: np.ndarray
    """(n, n) precision of the posterior of theta."""
    kernel: Kernel
    shares: tuple[float, float]
    evidence: float


def solve_problem(
    problem: Problem, places: Places, starts: Sequence[np.ndarray], mean: float, progress: Progress = NoProgress()
) -> Found:
    """The most probable theta, with the hyperparameters of greatest evidence.

    Args:
        places: where the modes are evaluated, see `places_of`.
        starts: several (T, P, 3) coefficients to start from; only the solution of the lowest cost is refined.
        mean: prior standard deviation of each component of the mean.
    """
    size = max(GUST * float(np.sqrt(np.mean([(one[:, 0] ** 2).mean() for one in starts]))), 1e-3 * mean)
    prior = Prior(Kernel(size**2 * np.eye(3)), places, np.full(3, mean))
    shares = (SHARES[FIRST_SHARE], SHARES[FIRST_SHARE])
    progress.update(0.0, "finding the wind")
    theta = min((_most_probable(problem, prior, _first(problem, one), shares) for one in starts), key=lambda one: one.cost).theta
    for number in range(ROUNDS):
        progress.update((number + 0.5) / (ROUNDS + 1), "finding the wind")
        point = problem.linearise(theta, shares)
        prior = replace(prior, kernel=maximise_evidence(prior, point.normal, point.pull, check=progress.check))
        shares = _best_shares(problem, prior, theta, shares)
        theta = _most_probable(problem, prior, theta, shares).theta
    point = problem.linearise(theta, shares)
    return Found(theta, point.normal + prior.precision(), prior.kernel, shares, log_evidence(problem, prior, theta, shares))


def places_of(basis: SpatialBasis, path: np.ndarray, spacing: float, counts: Sequence[int] = ()) -> Places:
    """`Places.along` with a sample of the particles, which suffices for so few modes; `counts`: particles of each of several bodies."""
    counts = counts or [len(basis.phi)]
    most, rows = math.ceil(SAMPLES * basis.phi.shape[1] / len(counts)), []
    for begin, count in zip(np.cumsum([0, *counts]), counts):
        rows.append(begin + farthest_points(path[0, begin : begin + count], min(count, most)))
    some = np.concatenate(rows)
    few = replace(basis, phi=basis.phi[some], gradient=basis.gradient[some])
    return Places.along(few, path[:, some], knots(len(path) - 1, spacing))


def _first(problem: Problem, start: np.ndarray) -> np.ndarray:
    """The unknowns theta (n,) whose wind is nearest to the coefficients (T, P, 3)."""
    uniform = problem.felt.uniform_modes
    mean = start[:, uniform].mean(axis=(0, 1))
    gusts = np.tensordot(np.linalg.pinv(problem.hats), start, 1)
    gusts[:, uniform] -= mean
    return np.concatenate([gusts.ravel(), mean])


def _most_probable(problem: Problem, prior: Prior, theta: np.ndarray, shares: tuple[float, float]) -> Solution:
    def residuals(trials: np.ndarray) -> np.ndarray:
        return np.stack([problem.residual(one, shares) for one in trials])

    return solve(theta, np.zeros(len(theta)), prior.precision(), residuals, partial(problem.linearise, shares=shares), ITERATIONS)


def log_evidence(problem: Problem, prior: Prior, theta: np.ndarray, shares: tuple[float, float]) -> float:
    """Log evidence of the data, with the problem linearised at theta."""
    noise, found = problem.noise(shares), linearised_evidence(problem.linearise(theta, shares), prior.precision())
    return float(found - np.log(noise).sum() - 0.5 * math.log(2.0 * math.pi) * noise.size)


def _best_shares(problem: Problem, prior: Prior, theta: np.ndarray, shares: tuple[float, float]) -> tuple[float, float]:
    """The errors of the drag law with the greatest evidence, chosen one after the other."""
    for which in range(1 if problem.felt.net.all() else 2):
        trials = [(share, shares[1]) if which == 0 else (shares[0], share) for share in SHARES]
        shares = max(trials, key=lambda one: log_evidence(problem, prior, theta, one))
    return shares


def wind_of(
    felt: Observed, basis: SpatialBasis, path: np.ndarray, progress: Progress = NoProgress(), counts: Sequence[int] = ()
) -> Estimate:
    """The most probable wind on a body, or on several bodies that are treated as one (`together`).

    Args:
        felt: the force on the body, in the modes `basis`.
        path: (T+1, N, 3) positions of its particles [m].
        counts: number of particles of each of several bodies, in order.
    """
    problem = wind_problem(felt)
    uniform = felt.uniform()
    starts = [_filled(one, felt) for one in (uniform, np.broadcast_to(uniform.mean(axis=0), uniform.shape))]
    best = solve_problem(problem, places_of(basis, path, spacing_of(len(felt.measured)), counts), starts, MEAN, progress)
    wind = problem.coefficients(best.theta)
    missed, net = (felt.measured - felt.predicted(wind))[:, felt.net], felt.measured[:, felt.net]
    return Estimate(
        velocity=np.einsum("np,tpi->tni", basis.phi, wind),
        deviation=deviation_of(np.linalg.inv(best.precision), problem.hats, basis, felt.uniform_modes),
        mean=best.theta[-3:],
        kernel=best.kernel,
        shares=best.shares,
        unexplained=float(np.sqrt((missed**2).sum() / max((net**2).sum(), 1e-300))),
        evidence=best.evidence,
    )


def _filled(uniform: np.ndarray, felt: Observed) -> np.ndarray:
    """Coefficients (T, P, 3) of a wind (T, 3) that is uniform over the body."""
    start = np.zeros((len(uniform), felt.modes, 3))
    start[:, felt.uniform_modes] = uniform[:, None]
    return start


def deviation_of(covariance: np.ndarray, hats: np.ndarray, basis: SpatialBasis, uniform_modes: Sequence[int] = (0,)) -> np.ndarray:
    """(T, N, 3) standard deviation [m/s] at the particles, from the covariance (n, n) of gusts and mean."""
    knots, modes = hats.shape[1], basis.phi.shape[1]
    # The mean enters in every frame, as a further knot of the uniform modes would.
    rows = np.zeros((len(hats), modes, 3, len(covariance)))
    for component in range(3):
        for mode in range(modes):
            rows[:, mode, component, np.arange(knots) * 3 * modes + 3 * mode + component] = hats
        rows[:, list(uniform_modes), component, -3 + component] = 1.0
    block = np.einsum("tpai,ij,tqaj->tapq", rows, covariance, rows, optimize=True)
    return np.sqrt(np.maximum(np.einsum("np,tapq,nq->tna", basis.phi, block, basis.phi, optimize=True), 0.0))
