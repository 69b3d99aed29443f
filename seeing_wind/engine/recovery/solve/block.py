"""The solve over one block of the clip, coarse to fine, because a body that turns makes the problem curved.

Follow the targets with a receding horizon, solve with few modes and sparse knots, learn the prior's sizes, then solve with all modes
that the field is expected to have and the data can tell apart (Gauss-Newton through the simulator), learn again, and settle. A body
that the first field loses is followed again, finely (`first_field`). Where the body's stiffness is free (`stiffness`), each solve is
followed by steps of both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ...errors import SimulationError
from ...mpm.model import Model
from ...mpm.state import State, Trajectory
from ...progress import Journal, Progress
from ...records import Particles
from ..prior.basis import SpatialBasis, knots_between, velocity_basis
from ..prior.constants import PRIOR
from ..prior.kernel import Prior, knots_for_variance, modes_for_variance
from ..prior.learning import Expected, learn_hyperparameters, learn_kernel, prior_along, track_misfit
from ..targets.objective import Objective
from ..targets.tracks import TrackChannels, wild_frames
from .constants import PACE
from .first_field import FINELY, FLOWING, USUAL, Pace, follow, strayed
from .forward import Forward
from .gauss_newton import Linearisation, Solution, cost_of
from .gauss_newton import solve as gauss_newton
from .onward import Onward, continue_block
from .problem import Problem, whitened
from .stiffness import Joint, Stiffness, shortened, stiffest


@dataclass(frozen=True)
class Found:
    """A block's solution."""

    forward: Forward
    prior: Prior
    last: Solution
    trajectory: Trajectory
    iterations: int
    """Jacobians used."""
    stiffness: Stiffness
    joint: Joint | None
    """How the force hangs together with a stiffness that was free."""
    wild: np.ndarray
    """(T,) bool, see `wild_frames`."""


@dataclass
class BlockSolver:
    """One block on its way from a rough start to the final solve."""

    particles: Particles
    model: Model
    """With the stiffness given."""
    objective: Objective
    """Of the block alone."""
    basis: SpatialBasis
    """All modes that the data can tell apart."""
    expected: Expected
    start: State | None
    """The body at the block's first frame; None is at rest in its built shape with an unknown velocity."""
    iterations: int
    progress: Progress
    tell: Callable[[float, str, float | None], None]
    """Told the fraction done, what is being done, and the misfit in the observations' standard deviations (root mean square)."""
    still: np.ndarray
    """(T,) bool: the block's frames without a force."""
    stiffness: Stiffness = field(default_factory=partial(Stiffness, free=False))
    joint: Joint | None = None
    """Of the last solve with the stiffness free."""
    before: Onward | None = None
    """What the block before knows of this one."""
    journal: Journal = Journal()
    """Keeps what is found on the way."""

    def run(self) -> Found:
        """All parts in order; where one iteration is all that is allowed, without the fine one."""
        carried = continue_block(self, self.before) if self.before is not None else None
        if carried is not None:
            forward, prior, found, used = carried
            most, draft = min(max(0, self.iterations - used), USUAL.last_iterations), False
        else:
            forward, prior, found, used, most, draft = self._from_the_start()
        prior, point, self.objective = learn_hyperparameters(
            prior, forward, found, self.objective, self.expected, self.progress.check, self.journal
        )
        last = self.solve(
            forward, prior, found.theta, most, (0.8, 0.98), "Solving with what was learnt",
            point=point, tolerance=PACE.last_tolerance, per_unknown=PACE.last_per_unknown,
        )  # fmt: skip
        last = replace(last, converged=last.converged and not draft)
        path, wild = forward.trajectory(last.theta), wild_frames(self.objective)
        return Found(forward, prior, last, path, used + last.iterations, self.stiffness, self.joint, wild)

    def _from_the_start(self) -> tuple[Forward, Prior, Solution, int, int, bool]:
        """Forward model, prior and solution of a block that knows nothing beforehand, the Jacobians used and those left to the last
        solve, and whether there were none for the fine one."""
        pace, forward, prior, found, used = self._coarse_solution()
        left = max(0, self.iterations - found.iterations)
        rounds = min(left, PACE.stiffness_coarse_rounds)
        forward, found, more = self._with_stiffness(forward, prior, found, rounds, 0.45, PACE.coarse_tolerance)
        left, used = max(0, left - more), used + more
        if not left:
            return replace(forward, model=self._model()), prior, found, used, 0, True
        forward, prior, found, more = self._finely(forward, prior, found, min(left, pace.fine_iterations), left)
        return forward, prior, found, used + more, min(max(0, left - more), pace.last_iterations), False

    def _coarse_solution(self) -> tuple[Pace, Forward, Prior, Solution, int]:
        """A coarse solution of the whole block, found at the usual pace, or finely where that one strays and finely it does less.

        Returns the pace, forward model, prior, solution, and the Jacobians used.
        """
        pace = FLOWING if self._flows() else USUAL
        best, least, used = None, math.inf, 0
        for one, (begin, solving, end) in ((pace, (0.02, 0.15, 0.2)), (FINELY, (0.2, 0.4, 0.45))):
            most = min(max(1, self.iterations - 1), one.coarse_iterations)
            try:
                first = follow(self, one, (begin, solving))
                found = self.solve(
                    first.forward, first.prior, first.theta, most, (solving, end), "Solving coarsely", tolerance=PACE.coarse_tolerance
                )
            except SimulationError:
                if best is None:
                    raise
                break  # what the usual pace found stands
            used += first.iterations + found.iterations
            off = strayed(self, first, found)
            if best is None or off < least:
                best, least = (one, first.forward, first.prior, found), off
            if off < 1.0 or pace is FLOWING or self.iterations == 1:
                break
        assert best is not None
        return *best, used

    def _finely(self, coarse: Forward, prior: Prior, first: Solution, most: int, left: int) -> tuple[Forward, Prior, Solution, int]:
        """From the coarse solve on with as many modes and knots as the field is worth, which the coarse solve tells.

        Returns forward model, prior, solution, and the Jacobians used.
        """
        kernel = learn_kernel(prior, first.point.normal, first.pull, self.expected, self.progress.check, self.journal)
        path = coarse.trajectory(first.theta)
        self.objective = self.objective.reweighted(self.objective.residual(path.x[None])[0])
        worth = modes_for_variance(kernel, self.basis, self.particles.x, PRIOR.unexpected)
        basis = self.basis.first(max(coarse.shape[1], worth))
        knot = knots_for_variance(kernel, basis, path.x, PACE.knot, PRIOR.between_knots)
        fine = self.forward(basis, self.knot(knot), self.objective.frames)
        theta = fine.pack(coarse.per_frame(first.theta), first.theta[coarse.size :])
        prior = prior_along(kernel, fine, path, self.expected, self.objective)
        second = self.solve(fine, prior, theta, most, (0.45, 0.8), "Solving finely")
        left = max(0, left - second.iterations)
        fine, second, more = self._with_stiffness(fine, prior, second, min(left, PACE.stiffness_fine_rounds), 0.8, PACE.tolerance)
        return fine, prior, second, second.iterations + more

    def _with_stiffness(
        self, forward: Forward, prior: Prior, solution: Solution, rounds: int, done: float, tolerance: float
    ) -> tuple[Forward, Solution, int]:
        """Steps of the force and the stiffness together, each with a solve for the force after it.

        A stiffness that the clip does not tell goes back to the one given. Returns the forward model with the stiffness that was found,
        the solution, and the Jacobians used on the way.
        """
        used, self.joint, linearised = 0, None, self.stiffness.q
        if not self.stiffness.free or track_misfit(self.objective, self.basis.up_to(2).phi, solution.residual) > PACE.stiffness_lost:
            rounds = 0
        for _ in range(rounds):
            before = self.stiffness
            about = partial(Joint.about, forward, self.particles, self.objective, prior.precision(), solution, before)
            joint = self.journal.once("joint", Joint, about, solution.theta, before)
            known = before.at(before.q, joint.covariance).known
            after = before.q + shortened(joint.step()) if known else before.expected.copy()
            after[0] = min(after[0], stiffest(self.model))
            changed = self._towards(after - before.q, forward, prior, solution, joint, PACE.stiffness_shares if known else (1.0,))
            if changed is None:
                # Nothing lowers the cost: far from a minimum the clip says nothing of the stiffness, at one it has been said.
                begun = before.s == before.expected[0]
                if begun and known and abs(after[0] - before.s) > math.sqrt(joint.covariance[0, 0]):
                    break
                self.stiffness, self.joint = before.at(before.q, joint.covariance), joint
                break
            self.stiffness, forward, theta = changed
            self.joint = joint
            kept = np.all(np.abs(self.stiffness.q - linearised) <= PACE.stiffness_kept * np.array(PACE.stiffness_steps))
            point = solution.point if kept else None
            solution = self.solve(forward, prior, theta, 1, (done, done), "Finding the stiffness", point=point, tolerance=tolerance)
            linearised = self.stiffness.q if solution.iterations else linearised
            used += solution.iterations
            wanted = after - before.q  # not what was taken of it: a step cut short says that more is to come
            if wanted @ np.linalg.solve(joint.covariance, wanted) < PACE.stiffness_settled**2 or not known:
                break
        return forward, solution, used

    def _towards(
        self, dq: np.ndarray, forward: Forward, prior: Prior, solution: Solution, joint: Joint, shares: tuple[float, ...]
    ) -> tuple[Stiffness, Forward, np.ndarray] | None:
        """The first of these shares of the joint step by dq (4,) that lowers the cost (any, if there is one share only that does not break
        down): stiffness, forward model and theta there. None when none does."""
        before = self.stiffness
        most = solution.cost + before.penalty() if len(shares) > 1 else np.inf
        for share in shares if dq.any() else ():
            there = before.at(before.q + share * dq, joint.covariance)
            changed = replace(forward, model=there.of(self.model, self.particles), rough=self._rough(there))
            theta = solution.theta + share * joint.follow(dq)
            for _ in range(PACE.stiffness_following):
                white = self.journal.array("trial", partial(whitened, changed, self.objective, theta[None]), theta)
                if not np.isfinite(white).all():
                    break
                if float(cost_of(white, theta[None], prior.precision())[0]) + there.penalty() < most:
                    return there, changed, theta
                theta = theta + joint.chord(theta, white[0], solution.point.jacobian, prior.precision())
        return None

    def _model(self) -> Model:
        return self.stiffness.of(self.model, self.particles)

    def _rough(self, stiffness: Stiffness | None = None) -> Model:
        model = (stiffness or self.stiffness).of(self.model, self.particles)
        return replace(model, substeps=math.ceil(PACE.rough * model.substeps / model.refined))

    def _flows(self) -> bool:
        return self.model.plastic and any(isinstance(one, TrackChannels) for one in self.objective.channels)

    def knot(self, wanted: float) -> float:
        """Frames between knots: `wanted`, or a power of two times it, so that a field on coarse knots is one on finer too.

        Sparser than wanted when the dense solve would become too large; finer where still air says that the force ends at once.
        """
        affordable = 3.0 * self.basis.phi.shape[1] * np.count_nonzero(~self.still) / PACE.unknowns
        knot = max(1.0, 0.5 * wanted) if self.still.any() else wanted
        while knot < affordable:
            knot *= 2.0
        return knot

    def early_model(self) -> Model:
        """The body before the fine solve: rough, unless it is held, and so judged by how it answers, or flows, which hangs on substeps."""
        return self._model() if self.particles.pinned.any() or self.model.plastic else self._rough()

    def forward(self, basis: SpatialBasis, knot: float, frames: int, model: Model | None = None) -> Forward:
        """Simulations of the block's first `frames` with these modes, and the fine model of the stiffness so far unless told otherwise."""
        velocity, gradient = velocity_basis(self.particles.x, basis, self.particles.pinned)
        if self.start is not None:
            velocity, gradient = velocity[:0], gradient[:0]
        x = self.particles.x
        model, when = model or self._model(), knots_between(self.still[:frames], knot)
        return Forward(model, self._rough(), x, basis, when, velocity, gradient, self.progress, self.start, self.journal)

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
        """Gauss-Newton from theta over the frames that `forward` has; unknowns that are not `active` stay, and the solution lacks them
        but for its theta, which is whole."""
        active = np.ones(len(theta), bool) if active is None else active
        problem = Problem(forward, self.objective.until(len(forward.hats)), prior, theta, active)
        misfit: float | None = None

        def linearise(candidate: np.ndarray) -> Linearisation:
            nonlocal misfit
            found = problem.linearise(candidate)
            misfit = problem.objective.misfit(found.residual)
            return found

        def report(iteration: int, cost: float) -> None:
            done = share[0] + (share[1] - share[0]) * max(iteration - 1, 0) / max(iterations, 1)
            self.tell(done, f"{what}, iteration {iteration}", misfit)

        work = partial(
            gauss_newton, theta[active], *problem.belief(), problem.residuals, linearise, iterations, report, point, tolerance,
            per_unknown,
        )  # fmt: skip
        solution = self.journal.once("solve", Solution, work, theta, active, prior.precision(), iterations)
        return replace(solution, theta=problem.whole(solution.theta[None])[0])
