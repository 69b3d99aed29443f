"""The first field of a block: a field that keeps the simulation near the targets from the first frame to the last.

The followed part of the block grows a segment at a time: the receding horizon (`warm_start`) continues the simulation into the segment,
then the knots in the segment and shortly before it are solved for. The pace sets how finely. Few modes, sparse knots and a smooth field
are enough for most bodies. A soft sheet that ripples in gusts shorter than itself strays with them: what the smooth field cannot explain
is attributed to a motion along the view, and no later solve recovers from that. Such a body is followed again at a finer pace. A free
body that only moves faster than the sparse knots allow is not far off, so denser knots are tried first, from where it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...mpm.state import Trajectory
from ..prior.basis import SpatialBasis
from ..prior.constants import PRIOR
from ..prior.kernel import Kernel, Prior
from ..prior.learning import prior_along, track_misfit
from .constants import PACE
from .forward import Forward
from .gauss_newton import Solution
from .solver import Solver
from .warm_start import WarmStart, warm_start


@dataclass(frozen=True)
class Pace:
    """How finely a block is followed, and solved afterwards."""

    degree: int | None
    """Highest degree of the modes; None for all modes."""
    knot: float
    """Frames between knots."""
    segment: int
    """Frames by which the followed part of the block grows."""
    behind: float
    """Knots up to this long before a segment are solved again with it [frames]."""
    leads_on: bool
    """Whether the force at a segment's end is the first guess for the next segment. The response of a body that flows changes so much
    between segments that the guess would be misleading."""
    segment_iterations: int
    """Most Jacobians per segment; each serves several chord steps."""
    coarse_iterations: int
    """Most Jacobians of the coarse solve, which has these modes and knots."""
    fine_iterations: int
    """Most Jacobians of the fine solve, which has as many modes and knots as the field requires."""
    last_iterations: int = 1
    """Most Jacobians of the last solve, after the hyperparameters were learnt."""
    length: float = PRIOR.length
    """Correlation length of the field before its hyperparameters are learnt [body radii]."""
    duration: float = PRIOR.duration
    """Correlation time of the field before its hyperparameters are learnt [frames]."""

    def modes(self, basis: SpatialBasis) -> SpatialBasis:
        """The modes of `basis` that this pace uses."""
        return basis if self.degree is None else basis.up_to(self.degree)


USUAL = Pace(degree=2, knot=4.0, segment=16, behind=8.0, leads_on=True, segment_iterations=1, coarse_iterations=1, fine_iterations=2)
FLOWING = Pace(degree=2, knot=4.0, segment=5, behind=2.5, leads_on=False, segment_iterations=1, coarse_iterations=4, fine_iterations=3)
"""For a body that flows and is seen in pixels: at the end of 16 frames a plastic ball was off by 5 px if followed in one piece, and by 1 px
in segments."""
FINELY = Pace(
    degree=None, knot=2.0, segment=6, behind=12.0, leads_on=True, segment_iterations=5, coarse_iterations=3, fine_iterations=6,
    last_iterations=4, length=0.5, duration=4.0,
)  # fmt: skip
"""For a body that strayed at the usual pace."""
DENSELY = replace(USUAL, knot=FINELY.knot, coarse_iterations=FINELY.coarse_iterations, duration=FINELY.duration)
"""For a free body that strayed at the usual pace, before that one: force and motion of a flower that sways to and fro within eight frames
cannot be written with a knot in every fourth."""


@dataclass(frozen=True)
class FirstField:
    """The start of the solve of a whole block."""

    forward: Forward
    prior: Prior
    theta: np.ndarray
    """(n,) unknowns that track the block."""
    iterations: int
    """Jacobians used."""
    misfit: float
    """Misfit of the motion found by the look-ahead, which a successful solve lowers [standard deviations]."""


def follow(solver: Solver, pace: Pace, share: tuple[float, float]) -> FirstField:
    """A first field under which the simulation tracks the whole block.

    Args:
        share: fractions of the block's progress at which this begins and ends.

    Raises:
        SimulationError: when the body breaks down.
    """
    what = "Following the object again, finely" if pace is FINELY else "Following the object"
    objective, expected = solver.objective, solver.expected
    frames, size = objective.frames, expected.size * np.sqrt(np.diag(expected.component))
    affine = solver.basis.up_to(1)
    modes = pace.modes(solver.basis)
    knot = solver.knot(pace.knot)
    parts = math.ceil(frames / pace.segment)
    ends = [round(frames * (part + 1) / parts) for part in range(parts)]
    early = solver.early_model()
    unmoved = _unmoved(solver, pace)
    if unmoved is not None:
        return unmoved
    leader, found, used = solver.forward(affine, 1.0, frames, early), np.zeros((0, modes.phi.shape[1], 3)), 0
    forward, theta, velocity = solver.forward(modes, knot, frames, early), np.zeros(0), np.zeros(0)
    for part, end in enumerate(ends):
        begin, done = len(found), share[0] + (share[1] - share[0]) * part / parts
        solver.tell(done, f"{what}, frame {begin} to {end} of {frames}", None)
        solved = forward.trajectory(theta) if begin else None
        state = solved.state(begin) if solved else solver.start
        last = forward.per_frame(theta)[-1][: affine.phi.shape[1]] if begin and pace.leads_on else None
        lead = partial(warm_start, leader, objective, size, expected.speed, state, begin, end, last)
        led = solver.journal.once("lead", WarmStart, lead, begin, end, theta)
        velocity = velocity if begin else led.velocity
        fresh = np.zeros((end - begin, *found.shape[1:]))
        fresh[:, : affine.phi.shape[1]] = led.coefficients
        found = np.concatenate([found, fresh])
        forward = solver.forward(modes, knot, end, early)
        theta = forward.pack(found, velocity)
        kernel = _kernel(solver, pace, found)
        way = [solved.state(t) for t in range(begin)] if solved else []
        path = Trajectory.of(way + [led.path.state(t) for t in range(end - begin + 1)])
        prior = prior_along(kernel, forward, path, expected, objective)
        if end < frames:
            settled = begin - pace.behind
            open_knots = np.repeat(forward.knots.at >= settled, forward.size // forward.shape[0])
            active = np.concatenate([open_knots, np.full(len(velocity), settled <= 0)])
            if not active.any():  # no knots to solve for: the air has been still for longer than `behind`
                continue
            most = min(pace.segment_iterations, solver.iterations)
            part_solved = solver.solve(forward, prior, theta, most, (done, done), what, active)
            theta, used = part_solved.theta, used + part_solved.iterations
            found, velocity = forward.per_frame(theta), theta[forward.size :]
    return FirstField(forward, prior, theta, used, objective.misfit(objective.whiten(objective.residual(path.x[None]))))


def at_pace(solver: Solver, pace: Pace, forward: Forward, theta: np.ndarray) -> tuple[Forward, Prior, np.ndarray]:
    """Forward model, prior and unknowns of a pace with denser knots or more modes, for the field and motion of `forward` under theta (n,).

    Raises:
        SimulationError: when the body breaks down.
    """
    denser = solver.forward(pace.modes(solver.basis), solver.knot(pace.knot), solver.objective.frames, solver.early_model())
    field, path = forward.per_frame(theta), forward.trajectory(theta)
    prior = prior_along(_kernel(solver, pace, field), denser, path, solver.expected, solver.objective)
    return denser, prior, denser.pack(field, theta[forward.size :])


def _kernel(solver: Solver, pace: Pace, field: np.ndarray) -> Kernel:
    """Hyperparameters before they are learnt, for a field of about the size of these coefficients (T, modes, 3) [m/s²]."""
    size = max(rms(field[:, 0]), 0.05 * solver.expected.size)
    return Kernel(size**2 * solver.expected.component / 3.0, pace.length, pace.duration)


def _unmoved(solver: Solver, pace: Pace) -> FirstField | None:
    """A zero field, if the body is seen to stay where it is and does so without a force; otherwise None."""
    place = solver.particles.x if solver.start is None else solver.start.x
    forward = solver.forward(pace.modes(solver.basis), solver.knot(pace.knot), solver.objective.frames, solver.early_model())
    theta = np.zeros(forward.size + len(forward.velocity))

    def missed(path: np.ndarray) -> np.ndarray:
        return solver.objective.whiten(solver.objective.residual(path[None]))[0]

    def explained(path: np.ndarray) -> bool:
        """Whether the misfit is smaller than the least improvement for which a solve takes a step."""
        return float((missed(path) ** 2).sum()) < PACE.tolerance_per_unknown * len(theta)

    if not explained(np.broadcast_to(place, (solver.objective.frames + 1, *place.shape))):  # first, as it needs no simulation
        return None
    path = forward.trajectory(theta)
    if not explained(path.x):
        return None
    kernel = Kernel(solver.expected.size**2 * solver.expected.component / 3.0, pace.length, pace.duration)
    prior = prior_along(kernel, forward, path, solver.expected, solver.objective)
    return FirstField(forward, prior, theta, 0, solver.objective.misfit(missed(path.x)))


def strayed(solver: Solver, led: float, found: Solution) -> float:
    """Misfit of the solution `found` relative to the misfit above which a body is lost: the larger for a motion that the look-ahead left
    with a misfit of `led` [standard deviations]."""
    of_tracks = track_misfit(solver.objective, solver.basis.up_to(2).phi, found.residual) / PACE.refollow_misfit
    return max(of_tracks, solver.objective.misfit(found.residual) / max(PACE.refollow_misfit, PACE.refollow_worse * led))


def rms(values: np.ndarray) -> float:
    """Root mean square length of vectors (..., 3)."""
    return float(np.sqrt((values**2).sum(axis=-1).mean()))
