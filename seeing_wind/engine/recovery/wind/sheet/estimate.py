"""The most probable field on a sheet: Gauss-Newton through the following simulation, with the prior of greatest evidence.

The prior is that of any body's wind (`wind.estimate`): a mean, and gusts that are a Gaussian process over the places and times that the
sheet passes. What the sheet does not feel, such as wind along it, stays as the prior has it, with a large deviation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ....errors import SimulationError
from ....mpm.shell import Shell
from ....mpm.shell.tangent import FaceSlopes
from ....progress import Journal, NoProgress, Progress
from ...prior.basis import hats, spatial_basis
from ...prior.evidence import maximise_evidence
from ...prior.kernel import Kernel, Prior
from ...solve.gauss_newton import Linearisation, Solution, solve
from ..estimate import GUST, deviation_of, places_of
from .air import Air, Cause, Push
from .following import Follower
from .observed import Observed
from .problem import SheetProblem
from .start import first_winds

MODES, VIEWS = 6, 21
"""Of the field over the sheet: constant, linear and quadratic. Of what is compared: up to degree five."""
SPACING = 2.0
"""Frames between the field's knots; longer for clips of more than `MOST_KNOTS`."""
MOST_KNOTS = 60
SHARE = 0.1
"""Least error of sheet and drag law, as a part of what the air does in each mode: another simulator's sheet, or a real one, differs so
much at least, and evidence, which takes errors to be independent from frame to frame, would put the difference down to gusts."""
NOISE = 0.5
"""Of the points' noise in a mode, what is left in the following simulation."""
DAMPING, CHORD_STEPS = ((0.0,), (10.0,), (100.0,), (1e3,), (1e4,)), 2
"""As in `gauss_newton`, for a simulation that takes long."""
ROUNDS = ((2, 5.0), (3, 1.0), (2, 1.0))
"""Linearisations at most, and factors on the errors: large ones hold the first steps, from a wind that may be far off, near to the prior.
Hyperparameters are learnt before the last round."""
FACTORS = (1.0, 2.0, 3.0)
"""On the first winds: a sheet that its tension holds shows less of the wind than a free one."""
SCALES = 3
"""Times that errors and hyperparameters are learnt in turn."""


@dataclass(frozen=True)
class SheetEstimate:
    """What was found."""

    cause: str
    """"wind" or "force"."""
    velocity: np.ndarray
    """(T, V, 3) at the vertices: wind [m/s]; of a force of its own the acceleration [m/s²]."""
    deviation: np.ndarray
    """(T, V) posterior standard deviation of a component."""
    mean: np.ndarray
    """(3,)."""
    force: np.ndarray
    """(T, V, 3) on the vertices, mean over each frame's ends [N]."""
    force_deviation: np.ndarray
    """(T, V) [N] of a component."""
    x: np.ndarray
    """(T+1, V, 3) where the simulation went that followed the sheet [m]."""
    unexplained: float
    """Of what the sheet is off without the field, along its normals, the part that is left with it."""
    evidence: float
    """Natural logarithm."""
    iterations: int
    converged: bool

    def cause_of(self, shell: Shell) -> Cause:
        """What the field does to a sheet."""
        return Air(shell) if self.cause == "wind" else Push(shell)


def follower_of(shell: Shell, seen: Observed, gravity: Sequence[float], cause: Cause) -> Follower:
    """The simulation that follows a sheet."""
    return Follower(shell, seen, np.asarray(gravity, np.float64), cause, FaceSlopes(shell))


def field_of(follower: Follower, mean: float, progress: Progress | None = None, journal: Journal = Journal()) -> SheetEstimate:
    """The most probable field of the follower's cause.

    Args:
        mean: standard deviation of a component of the field's mean before anything is seen.
        journal: keeps what is found on the way.

    Raises:
        SimulationError: when the sheet cannot be simulated even near where it was seen. Cancelled: when the user asked to stop.
    """
    progress = progress or NoProgress()
    frames, mass = follower.seen.frames, follower.shell.mass * ~follower.shell.pinned
    basis, views = (spatial_basis(follower.seen.rest, mass, count) for count in (MODES, VIEWS))
    spacing = max(SPACING, math.ceil(frames / MOST_KNOTS))
    weight = mass / mass.sum()
    noise = NOISE * follower.seen.noise * float(np.sqrt((weight**2).sum()))
    problem = SheetProblem(follower, basis, views, weight, hats(frames, spacing), np.ones(0), check=progress.check)
    problem = replace(problem, least=np.ones(len(problem.across)))
    still = replace(follower, cause=Push(follower.shell))
    progress.update(0.0, "the sheet without air")
    without = journal.array("still", lambda: problem.off(still.path(np.zeros((frames, len(mass), 3)), progress.check)))
    size = np.sqrt((without**2).mean(axis=0))
    problem = replace(problem, least=np.hypot(noise, SHARE * np.maximum(size, 0.1 * size.max())))
    theta = _start(problem, without, journal, progress)
    gust = max(GUST * float(np.linalg.norm(theta[-3:])), 0.05 * mean)
    prior = Prior(Kernel(gust**2 * np.eye(3)), places_of(basis, follower.seen.x, spacing), np.full(3, mean))
    used, solution, point = 0, None, None
    for number, (most, factor) in enumerate(ROUNDS):
        part = progress.part(*(0.1 + 0.9 * (number + side) / len(ROUNDS) for side in (0, 1)))
        if number + 1 < len(ROUNDS):
            problem = replace(problem, more=(factor, factor))
        else:
            assert solution is not None
            problem, prior, point = _learnt(problem, prior, solution, progress.check)
        solve_it = partial(_solved, problem, prior, theta, most, part, point)
        solution = journal.once(f"round {number}", Solution, solve_it)
        theta, used = solution.theta, used + solution.iterations
    assert solution is not None
    return _told(problem, prior, solution, without, used)


def _start(problem: SheetProblem, without: np.ndarray, journal: Journal, progress: Progress) -> np.ndarray:
    """theta (n,) to begin with: no field, or the steady wind that explains most."""
    count = 3 * problem.hats.shape[1] * problem.basis.phi.shape[1] + 3
    if isinstance(problem.follower.cause, Push):
        return np.zeros(count)
    progress.update(0.05, "a first wind")

    def best() -> np.ndarray:
        winds = [factor * wind for wind in first_winds(problem, without) for factor in FACTORS]
        starts = [np.concatenate([np.zeros(count - 3), wind]) for wind in winds]
        costs = [float((_residual(problem, one) ** 2).sum()) for one in starts]
        return starts[int(np.argmin(costs))]

    return journal.array("start", best)


def _residual(problem: SheetProblem, theta: np.ndarray) -> np.ndarray:
    """Infinite where the simulation breaks down."""
    try:
        return problem.residual(theta)
    except SimulationError:
        return np.full(problem.hats.shape[0] * len(problem.across), np.inf)


def _solved(
    problem: SheetProblem, prior: Prior, theta: np.ndarray, most: int, progress: Progress, point: Linearisation | None
) -> Solution:
    def report(iteration: int, cost: float) -> None:
        progress.update(iteration / (most + 1), "finding the wind", cost=cost)

    return solve(
        theta, np.zeros(len(theta)), prior.precision(), lambda trials: np.stack([_residual(problem, one) for one in trials]),
        problem.linearise, most, report, point, damping=DAMPING, chord_steps=CHORD_STEPS,
    )  # fmt: skip


def _learnt(
    problem: SheetProblem, prior: Prior, solution: Solution, check: Callable[[], None]
) -> tuple[SheetProblem, Prior, Linearisation]:
    """Errors and hyperparameters of greatest evidence, one after the other, and the linearisation with these errors."""
    point, residual = solution.point, solution.residual
    theta = solution.theta
    for _ in range(SCALES):
        problem, other = problem.reweighed(point, residual, prior.precision())
        residual = other.residual
        point = Linearisation(point.theta, residual, other.jacobian, other.normal)
        pull = point.normal @ theta - point.jacobian @ residual
        prior = replace(prior, kernel=maximise_evidence(prior, point.normal, pull, None, check))
    return problem, prior, point


def _told(problem: SheetProblem, prior: Prior, solution: Solution, without: np.ndarray, used: int) -> SheetEstimate:
    follower, fields = problem.follower, problem.fields(solution.theta)
    path = follower.path(fields, problem.check)
    off, precision = problem.off(path)[:, problem.across], solution.point.normal + prior.precision()
    deviation = deviation_of(precision, problem.hats, problem.basis)
    force, slope = _forces(follower, fields, path)
    left = float(np.sqrt((off**2).sum() / max((without[:, problem.across] ** 2).sum(), 1e-300)))
    cause = "force" if isinstance(follower.cause, Push) else "wind"
    return SheetEstimate(
        cause, fields, deviation, solution.theta[-3:], force, slope * deviation, path, left, _log_evidence(problem, prior, solution), used,
        solution.converged,
    )  # fmt: skip


def _forces(follower: Follower, fields: np.ndarray, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces (T, V, 3) [N] in the middle of each frame, and (T, V) how much a component changes with one of the field."""
    v = np.diff(path, axis=0) * follower.seen.fps
    middle = 0.5 * (path[1:] + path[:-1])
    force = np.stack([follower.cause.force(*one) for one in zip(fields, middle, v, strict=True)])
    step = 1e-3 * max(float(np.abs(fields).max()), 1e-6)
    moved = [[follower.cause.force(f + step * axis, x, u) for f, x, u in zip(fields, middle, v, strict=True)] for axis in np.eye(3)]
    change = (np.array(moved) - force) / step
    return force, np.sqrt((change**2).sum(axis=(0, -1)) / 3.0)


def _log_evidence(problem: SheetProblem, prior: Prior, solution: Solution) -> float:
    """Of the data, linearised (Laplace's approximation)."""
    point, precision = solution.point, prior.precision()
    data = point.jacobian.T @ solution.theta - solution.residual
    pull = point.jacobian @ data
    total = cho_factor(point.normal + precision, lower=True)
    volume = np.log(np.diag(total[0])).sum() - 0.5 * np.linalg.slogdet(precision)[1]
    return float(0.5 * (pull @ cho_solve(total, pull) - data @ data) - volume - len(problem.hats) * np.log(problem.sigma).sum())
