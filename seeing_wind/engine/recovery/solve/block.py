"""The solve over one block of the clip, coarse to fine, because a body that turns makes the problem nonlinear.

Follow the targets with a receding horizon; solve with few modes and sparse knots; learn the hyperparameters; solve with all modes that the
field is expected to have and the data can tell apart (Gauss-Newton through the simulator); learn again; and solve once more. A body that
strays from the targets in the first field is followed again at a finer pace (`first_field`). If the body's stiffness is free (`stiffness`),
the coarse and the fine solve are each followed by joint steps of force and stiffness.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...errors import SimulationError
from ...mpm.state import Trajectory
from ..prior.constants import PRIOR
from ..prior.kernel import Prior, knots_for_variance, modes_for_variance
from ..prior.learning import learn_hyperparameters, learn_kernel, prior_along, track_misfit
from ..targets.tracks import TrackChannels
from .constants import PACE
from .first_field import FINELY, FLOWING, USUAL, Pace, follow, strayed
from .forward import Forward
from .gauss_newton import Solution, cost_of
from .onward import Onward, astray, continue_block, lead_on, missed_by
from .problem import whitened
from .solver import Solver
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
    """Joint normal equations of the force and the stiffness; None if the stiffness was not free, or no such step was tried."""
    wild: np.ndarray
    """(T,) bool, see `Objective.wild_frames`."""
    misfit: float
    """Misfit before the mismatch was learnt, see `onward.missed_by`."""


@dataclass
class BlockSolver(Solver):
    """Solves one block, from a rough start to the final solve."""

    joint: Joint | None = None
    """Joint normal equations of the last solve with a free stiffness."""
    before: Onward | None = None
    """What the block before hands on to this one."""

    def run(self) -> Found:
        """Run all solves in order; the fine solve is left out if no iterations are left for it.

        Raises:
            SimulationError: when the body breaks down in every attempt.
        """
        held = bool(self.particles.pinned.any())
        carried = continue_block(self, self.before) if self.before is not None and held else None
        if carried is not None:
            forward, prior, found, used = carried
            most, draft = min(max(0, self.iterations - used), FINELY.last_iterations), False
        else:
            forward, prior, found, used, most, draft = self._from_the_start()
        misfit = missed_by(self, found)
        prior, point, self.objective = learn_hyperparameters(
            prior, forward, found, self.objective, self.expected, self.progress.check, self.journal
        )
        last = self.solve(
            forward, prior, found.theta, most, (0.8, 0.98), "Solving with what was learnt",
            point=point, tolerance=PACE.last_tolerance, per_unknown=PACE.last_per_unknown,
        )  # fmt: skip
        last = replace(last, converged=last.converged and not draft)
        path, wild = forward.trajectory(last.theta), self.objective.wild_frames()
        return Found(forward, prior, last, path, used + last.iterations, self.stiffness, self.joint, wild, misfit)

    def _from_the_start(self) -> tuple[Forward, Prior, Solution, int, int, bool]:
        """Coarse and fine solution of a block.

        Returns forward model, prior, solution, the Jacobians used, the Jacobians left for the last solve, and whether none were left for
        the fine solve.
        """
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
        """A coarse solution of the whole block: continued from the block before if possible, else found at the usual pace; if that strays,
        the better one of that and a solution at the fine pace.

        Returns the pace, forward model, prior, solution, and the Jacobians used.
        """
        pace = FLOWING if self._flows() else USUAL
        best, least, used = None, math.inf, 0
        if self.before is not None and not self.particles.pinned.any():
            with contextlib.suppress(SimulationError):  # the block is then followed from its start
                forward, prior, led = lead_on(self, self.before)
                if not astray(self, self.before, led):
                    return pace, forward, prior, led, led.iterations
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
                break  # keep what was found at the usual pace
            used += first.iterations + found.iterations
            off = strayed(self, first, found)
            if best is None or off < least:
                best, least = (one, first.forward, first.prior, found), off
            if off < 1.0 or pace is FLOWING or self.iterations == 1:
                break
        assert best is not None
        return *best, used

    def _finely(self, coarse: Forward, prior: Prior, first: Solution, most: int, left: int) -> tuple[Forward, Prior, Solution, int]:
        """The fine solve from the coarse one, with as many modes and knots as the hyperparameters learnt from the coarse solve require.

        Returns forward model, prior, solution, and the Jacobians used.
        """
        if first.cost < PACE.tolerance_per_unknown * len(first.theta):  # as with a body at rest: no fine step could lower the cost enough
            return replace(coarse, model=self._model()), prior, first, 0
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
        """Joint steps of force and stiffness, each followed by a solve for the force alone.

        A stiffness that the clip does not determine goes back to its expected value. Returns the forward model with the stiffness found,
        the solution, and the Jacobians used.
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
                # No step lowers the cost. At a minimum the stiffness has been found; far from one the clip does not determine it.
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
            wanted = after - before.q  # the whole step, not the share taken: a step that was cut short needs another one
            if wanted @ np.linalg.solve(joint.covariance, wanted) < PACE.stiffness_settled**2 or not known:
                break
        return forward, solution, used

    def _towards(
        self, dq: np.ndarray, forward: Forward, prior: Prior, solution: Solution, joint: Joint, shares: tuple[float, ...]
    ) -> tuple[Stiffness, Forward, np.ndarray] | None:
        """Take the first of these shares of the joint step by dq (4,) that lowers the cost; a single share need only not break down.

        Returns stiffness, forward model and theta there; None if no share does.
        """
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

    def _flows(self) -> bool:
        return self.model.plastic and any(isinstance(one, TrackChannels) for one in self.objective.channels)
