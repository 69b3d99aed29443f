"""What the solve of a sheet learns by evidence between its linearised solves: errors, hyperparameters and knots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...prior.evidence import linearised_evidence, maximise_evidence
from ...prior.kernel import Prior
from ..estimate import places_of
from .problem import SheetProblem

SPACING = 2.0
"""Frames between the field's knots; more in clips that would have more than `MOST_KNOTS`. In shorter clips there is a knot in every frame
if that is more probable."""
MOST_KNOTS = 60
LAWS = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Candidate relative errors of the cause's law; the evidence chooses. No two engines' simulations of cloth agree better than the first."""
NOISES = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Candidate factors on the errors estimated from a camera's images: where folds hide parts, the error of the hidden parts is larger."""


def learn(problem: SheetProblem, prior: Prior, theta: np.ndarray, path: np.ndarray) -> tuple[SheetProblem, Prior, np.ndarray]:
    """Problem and prior with the law's error, the hyperparameters and the knots of greatest evidence, chosen in this order at theta (n,).

    The third result is theta on the chosen knots.
    """
    problem = likeliest(problem, prior, theta, "law", LAWS)
    prior = _with_kernel(problem, prior, theta)
    frames, knots = problem.hats.shape
    if knots == frames or frames > SPACING * MOST_KNOTS:
        return problem, prior, theta
    finer = _knotted(problem, prior, theta, path)
    return max(((problem, prior, theta), finer), key=lambda one: log_evidence(*one))


def _with_kernel(problem: SheetProblem, prior: Prior, theta: np.ndarray) -> Prior:
    """The prior with the hyperparameters of greatest evidence, linearised at theta (n,)."""
    point = problem.linearise(theta)
    return replace(prior, kernel=maximise_evidence(prior, point.normal, point.pull, check=problem.check))


def likeliest(problem: SheetProblem, prior: Prior, theta: np.ndarray, kind: str, several: Sequence[float]) -> SheetProblem:
    """The problem with one of its errors, `law` or `noise`, chosen from `several` sizes by climbing in evidence from the present one."""
    best, evidence = problem, log_evidence(problem, prior, theta)
    for ahead in (1, -1):
        place = several.index(getattr(best, kind)) + ahead
        while 0 <= place < len(several):
            problem.check()
            trial = problem.with_errors(theta, **{kind: several[place]})
            reached = log_evidence(trial, prior, theta)
            if reached <= evidence:
                break
            best, evidence, place = trial, reached, place + ahead
        if best is not problem:  # climbing: sizes the other way are less likely
            break
    return best


def _knotted(problem: SheetProblem, prior: Prior, theta: np.ndarray, path: np.ndarray) -> tuple[SheetProblem, Prior, np.ndarray]:
    """The same with a knot in every frame of the path (T+1, V, 3) [m]: falling fast through a steady wind, a sheet feels quick changes."""
    gusts = problem.hats @ theta[:-3].reshape(problem.hats.shape[1], -1)
    theta = np.concatenate([gusts.ravel(), theta[-3:]])
    problem = replace(problem, hats=np.eye(len(problem.hats)))
    return problem, _with_kernel(problem, replace(prior, places=places_of(problem.basis, path, 1.0)), theta), theta


def log_evidence(problem: SheetProblem, prior: Prior, theta: np.ndarray) -> float:
    """Log evidence of the data, up to an additive constant, with the problem linearised at theta."""
    return float(linearised_evidence(problem.linearise(theta), prior.precision()) - np.log(np.diag(problem.factor)).sum())
