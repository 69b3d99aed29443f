"""The solve over one block of the clip, coarse to fine, because a body that turns makes the problem nonlinear.

Follow the targets with a receding horizon; solve with few modes and sparse knots; learn the hyperparameters; solve with all modes that the
field is expected to have and the data can tell apart (Gauss-Newton through the simulator); learn again; and solve once more. A body that
strays from the targets in the first field is solved again with denser knots or followed again at a finer pace (`first_field`). If the
body's stiffness is free (`stiffness`), the coarse and the fine solve are each followed by joint steps of force and stiffness.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
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
from .first_field import DENSELY, FINELY, FLOWING, USUAL, Pace, at_pace, follow, strayed
from .forward import Forward
from .gauss_newton import Solution, cost_of
from .onward import Onward, astray, continue_block, lead_on, missed_by, pace_after
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
    densely: bool
    """See `Onward.densely`."""


@dataclass(frozen=True)
class Start:
    """A coarse solution of a block."""

    pace: Pace
    forward: Forward
    prior: Prior
    found: Solution
    iterations: int
    """Jacobians used."""
    led: float
    """Misfit of the motion found by the look-ahead [standard deviations]."""
    off: float
    """See `first_field.strayed`."""


def _unheard(fraction: float, pace: Pace) -> None: ...


@dataclass
class BlockSolver(Solver):
    """Solves one block, from a rough start to the final solve."""

    joint: Joint | None = None
    """Joint normal equations of the last solve with a free stiffness."""
    before: Onward | None = None
    """What the block before hands on to this one."""
    lost: Callable[[float, Pace], None] = _unheard
    """Called when the body strays, with the fraction of the block that is done and the pace at which the body is sought next."""
    densely: bool = False
    """See `Onward.densely`; known after the coarse solution."""

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
        return Found(forward, prior, last, path, used + last.iterations, self.stiffness, self.joint, wild, misfit, self.densely)

    def _from_the_start(self) -> tuple[Forward, Prior, Solution, int, int, bool]:
        """Coarse and fine solution of a block.

        Returns forward model, prior, solution, the Jacobians used, the Jacobians left for the last solve, and whether none were left for
        the fine solve.
        """
        start = self._coarse_solution()
        self.densely = not self.particles.pinned.any() and start.pace.knot < USUAL.knot
        forward, prior, found, used = start.forward, start.prior, start.found, start.iterations
        left = max(0, self.iterations - found.iterations)
        rounds = min(left, PACE.stiffness_coarse_rounds)
        forward, found, more = self._with_stiffness(forward, prior, found, rounds, 0.45, PACE.coarse_tolerance)
        left, used = max(0, left - more), used + more
        if not left:
            return replace(forward, model=self._model()), prior, found, used, 0, True
        forward, prior, found, more = self._finely(forward, prior, found, min(left, start.pace.fine_iterations), left)
        return forward, prior, found, used + more, min(max(0, left - more), start.pace.last_iterations), False

    def _coarse_solution(self) -> Start:
        """A coarse solution of the whole block: continued from the block before if possible, else found at the usual pace; if that strays,
        the best one of that, of a free body's with denser knots, and of one followed again at the fine pace."""
        pace, free = FLOWING if self._flows() else pace_after(self.before), not self.particles.pinned.any()
        if self.before is not None and free:
            with contextlib.suppress(SimulationError):  # the block is then followed from its start
                forward, prior, led = lead_on(self, self.before)
                if not astray(self, self.before, led):
                    return Start(pace, forward, prior, led, led.iterations, 0.0, 0.0)
        starts = [self._followed(pace, (0.02, 0.15, 0.2))]
        if starts[0].off < 1.0 or pace is FLOWING or self.iterations == 1:
            return starts[0]
        if free and pace is USUAL:
            self.lost(0.2, DENSELY)
            with contextlib.suppress(SimulationError):  # what was found at the usual pace is kept
                starts.append(self._denser(starts[0], (0.2, 0.25)))
        if starts[-1].off >= 1.0:
            self.lost(0.25, FINELY)
            with contextlib.suppress(SimulationError):  # as above
                starts.append(self._followed(FINELY, (0.25, 0.4, 0.45)))
        best = min(starts, key=lambda one: one.off)
        return replace(best, iterations=sum(one.iterations for one in starts))

    def _followed(self, pace: Pace, share: tuple[float, float, float]) -> Start:
        """A coarse solution at a pace. `share`: fractions of the block's progress at which following, then solving begins, and both end.

        Raises:
            SimulationError: when the body breaks down.
        """
        begin, solving, end = share
        first = follow(self, pace, (begin, solving))
        found = self._coarsely(pace, first.forward, first.prior, first.theta, (solving, end), "Solving coarsely")
        off = strayed(self, first.misfit, found)
        return Start(pace, first.forward, first.prior, found, first.iterations + found.iterations, first.misfit, off)

    def _denser(self, start: Start, share: tuple[float, float]) -> Start:
        """A coarse solution with denser knots, from one that strayed. Raises SimulationError when the body breaks down."""
        forward, prior, theta = at_pace(self, DENSELY, start.forward, start.found.theta)
        found = self._coarsely(DENSELY, forward, prior, theta, share, "Solving again, with denser knots")
        return Start(DENSELY, forward, prior, found, found.iterations, start.led, strayed(self, start.led, found))

    def _coarsely(
        self, pace: Pace, forward: Forward, prior: Prior, theta: np.ndarray, share: tuple[float, float], what: str
    ) -> Solution:
        most = min(max(1, self.iterations - 1), pace.coarse_iterations)
        return self.solve(forward, prior, theta, most, share, what, tolerance=PACE.coarse_tolerance)

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
