"""The most probable field on a sheet: Gauss-Newton on the balance of forces, under the prior of greatest evidence.

The prior is that of any body's wind (`wind.estimate`): a mean, and gusts that are a Gaussian process over the places and times that the
sheet passes. What the sheet does not feel, such as wind along it, keeps its prior value, with a large deviation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import least_squares

from ....mpm.shell import Shell
from ....progress import Journal, NoProgress, Progress
from ...prior.basis import hats, spatial_basis
from ...prior.kernel import Kernel, Prior
from ...solve.gauss_newton import Solution, solve
from ..drag import area_normals
from ..estimate import GUST, deviation_of, places_of
from .air import Air, Cause, Push
from .attenuation import reliability_of
from .balance import balance_of
from .following import Follower
from .learning import MOST_KNOTS, NOISES, SPACING, learn, likeliest, log_evidence
from .observed import Observed
from .problem import SheetProblem, factor_of
from .valley import Posterior, mixed, posterior_of

MODES = 6
"""Modes of the field over the sheet: constant, linear and quadratic."""
BREEZE = 2.5
"""Prior standard deviation of each component of the mean wind [m/s], which makes a gentle breeze, Beaufort 3. A sheet that turns little can
hardly distinguish a wind across it from a stronger one at a slant; of these, the prior prefers the weaker."""
ITERATIONS, ROUNDS = 8, 3
"""Most linearisations in each solve, and the number of solves; hyperparameters and errors are learnt between solves."""
STEPS = 6
"""Most evaluations for each of the steady winds that are tried first."""
UNSURE = 0.5
"""Share of the correction for attenuation that counts as uncertain: the factor on the errors of positions is known to a power of two."""
CHANGED = 1e-3
"""A solve has converged when its next step promises to lower the cost by less than this share."""


@dataclass(frozen=True)
class SheetEstimate:
    """The most probable field on a sheet, and what follows from it."""

    cause: str
    """"wind" or "force"."""
    velocity: np.ndarray
    """(T, V, 3) field at the vertices: wind [m/s], or, for a force without a drag law, acceleration [m/s²]."""
    deviation: np.ndarray
    """(T, V, 3) posterior standard deviation of the field, see `valley`."""
    mean: np.ndarray
    """(3,) mean of the field."""
    force: np.ndarray
    """(T, V, 3) force on the vertices in the middle of each frame [N]."""
    force_deviation: np.ndarray
    """(T, V, 3) standard deviation of the force [N]."""
    x: np.ndarray
    """(T+1, V, 3) path of the simulation that follows the sheet [m]."""
    unexplained: float
    """Norm of the whitened residual with the field, relative to the norm without it."""
    evidence: float
    """Natural logarithm."""
    iterations: int
    converged: bool
    law: float
    """Error of the cause's law, relative to its force."""
    reliability: float = 1.0
    """Share of the mean square force on the path seen that is not due to the path's errors, see `attenuation`."""

    @property
    def uncertain(self) -> float:
        """Deviation of the field, in the field's unit: median over vertices and frames."""
        return float(np.median(np.linalg.norm(self.deviation, axis=-1)))

    @property
    def doubt(self) -> float:
        """Deviation of the field, relative to its size: median over vertices and frames."""
        size = np.linalg.norm(self.velocity, axis=-1)
        return float(np.median(np.linalg.norm(self.deviation, axis=-1) / np.maximum(size, 1e-300)))

    def cause_of(self, shell: Shell) -> Cause:
        """The cause by which the field loads a sheet."""
        return Air(shell) if self.cause == "wind" else Push(shell)


def follower_of(shell: Shell, seen: Observed, gravity: Sequence[float], cause: Cause) -> Follower:
    """The simulation that follows an observed sheet; gravity: (3,) [m/s²]."""
    return Follower(shell, seen, np.asarray(gravity, np.float64), cause)


def field_of(follower: Follower, mean: float, progress: Progress = NoProgress(), journal: Journal = Journal()) -> SheetEstimate:
    """The most probable field of the follower's cause.

    Args:
        mean: prior standard deviation of each component of the field's mean.
        journal: keeps intermediate results, so that the solve can resume.

    Raises:
        SimulationError: when the sheet cannot be simulated even while pulled towards where it was seen. Cancelled: when the user asked to
            stop.
    """
    frames, mass = follower.seen.frames, follower.shell.mass * ~follower.shell.pinned
    progress.update(0.0, "the forces on the sheet, and a first wind")
    balance, basis = balance_of(follower.shell, follower.seen, follower.gravity), spatial_basis(follower.seen.rest, mass, MODES)
    spacing = max(SPACING, math.ceil(frames / MOST_KNOTS))
    problem = SheetProblem(balance, follower.cause, basis, hats(frames, spacing), factor_of(balance, balance.seen), check=progress.check)
    problem = problem.before(np.zeros(problem.unknowns))
    theta = journal.array("start", lambda: _start(problem, mean))
    problem = problem.before(theta)

    def run(name: str, theta: np.ndarray, part: Progress) -> _Run:
        gust = max(GUST * float(np.linalg.norm(theta[-3:])), 0.05 * mean)
        prior = Prior(Kernel(gust**2 * np.eye(3)), places_of(basis, follower.seen.x, spacing), np.full(3, mean))
        return _run(problem, prior, theta, follower.seen, journal, name, part)

    runs = [run("", theta, progress.part(0.2, 0.5))]
    if not runs[0].posterior.known:
        for number, wind in enumerate(_others(theta[-3:], follower)):
            begin = np.concatenate([np.zeros(len(theta) - 3), wind])
            runs.append(run(f", start {number}", begin, progress.part(*(0.5 + 0.2 * (number + side) for side in (0, 1)))))
    progress.update(0.9, "a simulation that follows the sheet")
    return _estimate_from(runs, follower)


@dataclass(frozen=True)
class _Run:
    """The result of the solve from one start."""

    problem: SheetProblem
    prior: Prior
    solution: Solution
    posterior: Posterior
    evidence: float
    iterations: int

    def in_every_frame(self) -> _Run:
        """The same with a knot in each frame."""
        before = self.problem.hats
        return replace(self, problem=replace(self.problem, hats=np.eye(len(before))), posterior=self.posterior.between_knots(before))


def _run(
    problem: SheetProblem, prior: Prior, theta: np.ndarray, seen: Observed, journal: Journal, name: str, progress: Progress
) -> _Run:
    """Solve from the unknowns theta (n,).

    If a camera saw the sheet, the size, length and time of the gusts are not learnt: folds hide parts of the sheet, and the error of their
    path, which is not noise, would be attributed to short gusts.
    """
    used, solution = 0, None
    for number in range(ROUNDS):
        part = progress.part(*((number + side) / ROUNDS for side in (0, 1)))
        if solution is not None:
            problem = problem.with_errors(theta)
            if seen.measured is None:
                problem, prior, theta = learn(problem, prior, theta, seen.x)
            else:
                problem = likeliest(problem, prior, theta, "noise", NOISES)
                problem = replace(problem, reliability=reliability_of(problem, theta, seen))
        solution = journal.once(f"round {number}{name}", Solution, partial(_solved, problem, prior, theta, part))
        theta, used = solution.theta, used + solution.iterations
    assert solution is not None
    posterior = posterior_of(problem, prior, theta, problem.check)
    return _Run(problem, prior, solution, posterior, log_evidence(problem, prior, posterior.theta), used)


def _others(wind: np.ndarray, follower: Follower) -> list[np.ndarray]:
    """Further steady winds (3,) to start from: the component of the first, `wind`, along the sheet's mean normal, and its mirror image."""
    seen = follower.seen
    normal = area_normals(seen.x, seen.faces).sum(axis=(0, 1))
    normal /= max(float(np.linalg.norm(normal)), 1e-300)
    across = (wind @ normal) * normal
    return [across, 2.0 * across - wind]


def _start(problem: SheetProblem, mean: float) -> np.ndarray:
    """theta (n,) to start from: no field if the cause is a force, otherwise the most probable steady and uniform wind."""
    if isinstance(problem.cause, Push):
        return np.zeros(problem.unknowns)

    def whole(wind: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros(problem.unknowns - 3), wind])

    def missed(wind: np.ndarray) -> np.ndarray:
        return np.concatenate([problem.residual(whole(wind)), wind / mean])

    ways = [sign * 0.5 * mean * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    fits = [least_squares(missed, way, max_nfev=STEPS) for way in ways]
    costs = [float(fit.cost) for fit in fits]
    return whole(np.asarray(fits[int(np.argmin(costs))].x))


def _solved(problem: SheetProblem, prior: Prior, theta: np.ndarray, progress: Progress) -> Solution:
    def report(iteration: int, residual: np.ndarray) -> None:
        progress.update(iteration / (ITERATIONS + 1), "finding the wind")

    return solve(
        theta, np.zeros(len(theta)), prior.precision(), lambda trials: np.stack([problem.residual(one) for one in trials]),
        problem.linearise, ITERATIONS, report, tolerance=CHANGED,
    )  # fmt: skip


def _estimate_from(runs: Sequence[_Run], follower: Follower) -> SheetEstimate:
    if len({one.problem.hats.shape for one in runs}) > 1:
        runs = [one.in_every_frame() for one in runs]
    best = max(runs, key=lambda one: one.evidence)
    posterior, problem = mixed([one.posterior for one in runs], [one.evidence for one in runs]), best.problem
    theta = posterior.theta
    fields = problem.fields(theta)
    path = follower.path(fields, problem.check)
    corrected = problem.reliability**-0.5 - 1.0  # forces grow with the square of the speed
    deviation = np.hypot(deviation_of(posterior.covariance, problem.hats, problem.basis), UNSURE * corrected * np.abs(fields))
    force, slopes = _forces(follower, fields, path)
    force_deviation = np.sqrt(np.einsum("atvi,tva->tvi", slopes**2, deviation**2))
    missed, still = (float(np.linalg.norm(problem.residual(one))) for one in (theta, np.zeros_like(theta)))
    return SheetEstimate(
        cause="force" if isinstance(follower.cause, Push) else "wind",
        velocity=fields,
        deviation=deviation,
        mean=theta[-3:],
        force=force,
        force_deviation=force_deviation,
        x=path,
        unexplained=missed / max(still, 1e-300),
        evidence=best.evidence,
        iterations=sum(one.iterations for one in runs),
        converged=best.solution.converged,
        law=problem.law,
        reliability=problem.reliability,
    )


def _forces(follower: Follower, fields: np.ndarray, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces (T, V, 3) [N] in the middle of each frame, and their derivatives (3, T, V, 3) by each component of the field."""
    v = np.diff(path, axis=0) * follower.seen.fps
    middle = 0.5 * (path[1:] + path[:-1])
    force = np.stack([follower.cause.force(*one) for one in zip(fields, middle, v, strict=True)])
    step = 1e-3 * max(float(np.abs(fields).max()), 1e-6)
    moved = [[follower.cause.force(f + step * axis, x, u) for f, x, u in zip(fields, middle, v, strict=True)] for axis in np.eye(3)]
    return force, (np.array(moved) - force) / step
