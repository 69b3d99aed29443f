"""The least-squares problem of one solve: the whitened residuals under a force, and their derivatives by the force."""

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
    """The problem in the k active ones of the n unknowns theta; candidates (B, k) contain only those."""

    forward: Forward
    objective: Objective
    """The targets in the frames of `forward`."""
    prior: Prior
    theta: np.ndarray
    """(n,) start of the solve; unknowns that are not active keep these values."""
    active: np.ndarray
    """(n,) bool: which unknowns are solved for."""

    def whole(self, candidates: np.ndarray) -> np.ndarray:
        """Candidates (B, k) with the unknowns that are not active filled in, (B, n)."""
        full = np.repeat(self.theta[None], len(candidates), axis=0)
        full[:, self.active] = candidates
        return full

    def belief(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (k,) and precision (k, k) of the active unknowns' prior, conditional on the others."""
        precision, active = self.prior.precision(), self.active
        inner = precision[np.ix_(active, active)]
        return -np.linalg.solve(inner, precision[np.ix_(active, ~active)] @ self.theta[~active]), inner

    def residuals(self, candidates: np.ndarray) -> np.ndarray:
        """Whitened residuals (B, m) of candidates (B, k), infinite where the simulation broke down."""
        work = partial(whitened, self.forward, self.objective, self.whole(candidates))
        return self.forward.journal.array("trial", work, candidates)

    def linearise(self, candidate: np.ndarray) -> Linearisation:
        """Whitened residuals and their Jacobian at one candidate (k,). Raises SimulationError when a simulation breaks down."""
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
