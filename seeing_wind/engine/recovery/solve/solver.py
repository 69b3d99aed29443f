"""What the first field of a block (`first_field`) asks of the solver that it is found for (`block.BlockSolver`)."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ...mpm.model import Model
from ...mpm.state import State
from ...progress import Journal
from ...records import Particles
from ..prior.basis import SpatialBasis
from ..prior.kernel import Prior
from ..prior.learning import Expected
from ..targets.objective import Objective
from .constants import PACE
from .forward import Forward
from .gauss_newton import Solution


class Solver(Protocol):
    """One block of a clip, with what is observed in it and what is believed of its force."""

    particles: Particles
    objective: Objective
    """Of the block alone."""
    basis: SpatialBasis
    """All modes that the data can tell apart."""
    expected: Expected
    start: State | None
    """The body at the block's first frame; None is at rest in its built shape with an unknown velocity."""
    iterations: int
    """Jacobians that a solve may use at most."""
    journal: Journal
    """Keeps what is found on the way."""

    def tell(self, fraction: float, what: str, misfit: float | None, /) -> None:
        """Report the fraction done, what is being done, and the misfit in the observations' standard deviations."""

    def knot(self, wanted: float) -> float:
        """Frames between knots: `wanted`, or sparser where the dense solve would become too large."""

    def early_model(self) -> Model:
        """The body before the fine solve."""

    def forward(self, basis: SpatialBasis, knot: float, frames: int, model: Model | None = None) -> Forward:
        """Simulations of the block's first `frames` with these modes."""

    def solve(
        self,
        forward: Forward,
        prior: Prior,
        theta: np.ndarray,
        iterations: int,
        share: tuple[float, float],
        what: str,
        active: np.ndarray | None = None,
        *,
        tolerance: float = PACE.tolerance,
    ) -> Solution:
        """Gauss-Newton from theta over the frames that `forward` has, of the unknowns that are `active`."""
