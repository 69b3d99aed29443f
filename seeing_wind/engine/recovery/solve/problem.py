"""The least-squares problem of one solve: what is observed under a force, whitened, and how it changes with the force."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ..prior.kernel import Prior
from ..targets.objective import Objective
from .forward import Forward
from .gauss_newton import Linearisation


@dataclass(frozen=True)
class Problem:
    """For the unknowns that are active; candidates are of these alone, (B, k) of theta (n,)."""

    forward: Forward
    objective: Objective
    """Of the frames that `forward` has."""
    prior: Prior
    theta: np.ndarray
    """(n,) where the solve begins; unknowns that are not active stay so."""
    active: np.ndarray
    """(n,) bool."""

    def whole(self, candidates: np.ndarray) -> np.ndarray:
        """Candidates (B, k) with those that stay, (B, n)."""
        full = np.repeat(self.theta[None], len(candidates), axis=0)
        full[:, self.active] = candidates
        return full

    def belief(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (k,) and precision (k, k) of the prior, given the unknowns that stay."""
        precision, active = self.prior.precision(), self.active
        inner = precision[np.ix_(active, active)]
        return -np.linalg.solve(inner, precision[np.ix_(active, ~active)] @ self.theta[~active]), inner

    def residuals(self, candidates: np.ndarray) -> np.ndarray:
        """As `whitened`, (B, m)."""
        work = partial(whitened, self.forward, self.objective, self.whole(candidates))
        return self.forward.journal.array("trial", work, candidates)

    def linearise(self, candidate: np.ndarray) -> Linearisation:
        """Residuals and their Jacobian at one candidate (k,). Raises SimulationError when a simulation breaks down."""
        return self.forward.journal.once("linearise", Linearisation, partial(self._linearised, candidate), candidate)

    def _linearised(self, candidate: np.ndarray) -> Linearisation:
        raw = self.forward.jacobian(self.whole(candidate[None])[0], self.active, self.objective, self.prior.deviation())
        return Linearisation.at(candidate, self.residuals(candidate[None])[0], self.objective.whiten(raw))


def whitened(forward: Forward, objective: Objective, theta: np.ndarray) -> np.ndarray:
    """Whitened residuals (B, m) under theta (B, n), infinite where the simulation broke down."""
    positions = forward.positions(theta)
    broken = ~np.isfinite(positions).all(axis=(1, 2, 3))
    white = objective.whiten(objective.residual(np.where(broken[:, None, None, None], forward.x, positions)))
    white[broken] = np.inf
    return white
