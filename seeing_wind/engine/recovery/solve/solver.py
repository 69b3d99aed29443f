"""A block of a clip with all that its solves need: the body, its targets and prior, its simulations, and one Gauss-Newton solve.

`block` runs the solves in order; `first_field` and `onward` run some of their own to start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ...mpm.model import Model
from ...mpm.state import State
from ...progress import Journal, Progress
from ...records import Particles
from ..prior.basis import SpatialBasis, knots_between, velocity_basis
from ..prior.kernel import Prior
from ..prior.learning import Expected
from ..targets.objective import Objective
from .constants import PACE
from .forward import Forward
from .gauss_newton import Linearisation, Solution
from .gauss_newton import solve as gauss_newton
from .problem import Problem
from .stiffness import Stiffness


@dataclass
class Solver:
    """A block, its body, and what is known of both."""

    particles: Particles
    model: Model
    """The body with the stiffness as given."""
    objective: Objective
    """The targets of this block alone."""
    basis: SpatialBasis
    """All modes that the data can tell apart."""
    expected: Expected
    """Sizes of the field and of the initial velocity that are expected before the solve."""
    start: State | None
    """The body at the block's first frame; None if it starts in its built shape with an unknown velocity."""
    iterations: int
    """Most Jacobians that a solve may use."""
    progress: Progress
    tell: Callable[[float, str, float | None], None]
    """Called with the fraction done, the current activity, and the distance of the simulation from the targets, see
    `Objective.median_distance`."""
    still: np.ndarray
    """(T,) bool: the block's frames without a force."""
    steady: np.ndarray
    """(3,) constant part of the force in the blocks before, zero without any [m/s²]."""
    stiffness: Stiffness = field(default_factory=partial(Stiffness, free=False))
    journal: Journal = Journal()
    """Keeps intermediate results."""

    def _model(self) -> Model:
        return self.stiffness.of(self.model, self.particles)

    def _rough(self, stiffness: Stiffness | None = None) -> Model:
        model = (stiffness or self.stiffness).of(self.model, self.particles)
        return replace(model, substeps=math.ceil(PACE.rough * model.substeps / model.refined))

    def knot(self, wanted: float) -> float:
        """Frames between knots: `wanted` times a power of two, so that the fields on coarse knots are among those on finer knots.

        More frames than wanted if the dense solve would otherwise become too large; fewer if there is still air, where the force ends
        abruptly.
        """
        affordable = 3.0 * self.basis.phi.shape[1] * np.count_nonzero(~self.still) / PACE.unknowns
        knot = max(1.0, 0.5 * wanted) if self.still.any() else wanted
        while knot < affordable:
            knot *= 2.0
        return knot

    def early_model(self) -> Model:
        """The model before the fine solve: the rough one, unless the body is held, and so judged by its response to forces, or flows:
        both depend on the length of the substeps."""
        return self._model() if self.particles.pinned.any() or self.model.plastic else self._rough()

    def forward(self, basis: SpatialBasis, knot: float, frames: int, model: Model | None = None) -> Forward:
        """The forward model of the block's first `frames` with these modes; by default with the fine model and the present stiffness."""
        velocity, gradient = velocity_basis(self.particles.x, basis, self.particles.pinned)
        if self.start is not None:
            velocity, gradient = velocity[:0], gradient[:0]
        x = self.particles.x
        model, when = model or self._model(), knots_between(self.still[:frames], knot)
        lightness = None if self.particles.mixture is None else 1.0 / self.particles.relative_density
        return Forward(
            model, self._rough(), x, basis, when, velocity, gradient, self.progress, self.steady, self.start, self.journal, lightness
        )

    def solve(
        self,
        forward: Forward,
        prior: Prior,
        theta: np.ndarray,
        iterations: int,
        share: tuple[float, float],
        what: str,
        active: np.ndarray | None = None,
        point: Linearisation | None = None,
        tolerance: float = PACE.tolerance,
        per_unknown: float = PACE.tolerance_per_unknown,
    ) -> Solution:
        """Gauss-Newton from theta over the frames of `forward`. Unknowns that are not `active` keep their values; of the solution, only
        theta includes them."""
        active = np.ones(len(theta), bool) if active is None else active
        problem = Problem(forward, self.objective.until(len(forward.hats)), prior, theta, active)

        def report(iteration: int, white: np.ndarray, over: bool = False) -> None:
            part = 1.0 if over else max(iteration - 1, 0) / max(iterations, 1)
            far = problem.objective.median_distance(white)
            self.tell(share[0] + (share[1] - share[0]) * part, f"{what}, iteration {iteration}", far)

        work = partial(
            gauss_newton, theta[active], *problem.belief(), problem.residuals, problem.linearise, iterations, report, point, tolerance,
            per_unknown,
        )  # fmt: skip
        solution = self.journal.once("solve", Solution, work, theta, active, prior.precision(), iterations)
        report(solution.iterations, solution.residual, over=True)
        return replace(solution, theta=problem.whole(solution.theta[None])[0])
