"""How stiff a held body is, how it is damped, and where it is held, as more unknowns of the solve.

How far a force bends a held body is a matter of its stiffness, and nobody knows that well: it grows with the cube of a thickness that
was guessed from pictures, and a grid of a few cells across the body has its own, which points in 3D meet too. A body that swings near
its resonance is worse: a post 13 % too stiff asked for forces 37 % off. But what it does by itself tells, so its stiffness is found with
the force. Where it is held is seen to a few millimetres only, and a clamp that reaches too far up makes it stiffer, but not in the same
way to every swing: so that is found, too, and how the stiffness is spread over the section (`section`). What a body loses in every
swing and its model does not would be blown away by a wind that slows it: so the damping is found, too. With r the whitened residuals,
J (n, m) their derivatives by the other unknowns theta, P the precision of theta's prior, and

    q = (s, d, a, b, l)    s = log(E / E given) ~ N(0, SPREAD²)      d ~ N(0, DEPTH_SPREAD²), cells by which the clamp begins deeper
                           a, b ~ N(0, SECTION_SPREAD²), sizes of the section's two shapes
                           l ~ N(0, LOSS_SPREAD²), loss factor less the material's; their sum is not below zero
    C = dr/dq              (m, 5), differences through the simulator
    Q                      the diagonal matrix of these priors' precisions

a Gauss-Newton step for all

    [ J J' + P   J C      ] [d theta]       [ J r + P theta ]
    [ (J C)'     C'C + Q  ] [d q    ]  =  - [ C'r + Q q     ]

and after it theta alone is solved for again. s scales both of Lamé's parameters: Poisson's ratio stays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...materials import LOSS_FREQUENCY, loss_factor, retardation_time
from ...mpm.damping import DAMPED_SUBSTEPS, longest_retardation, retardation_of, substeps_for, with_retardation
from ...mpm.model import Model
from ...mpm.model_for import MAX_SUBSTEPS_HELD, with_clamp_depth
from ...records import Particles
from ...settings import RecoverSettings
from ..targets.objective import Objective
from .forward import Forward
from .gauss_newton import Solution
from .section import section_shapes

SPREAD = 0.3
"""Standard deviation of s before the clip is seen: a guessed thickness alone makes as much."""
DEPTH_SPREAD = 0.5
"""Standard deviation of d before the clip is seen [grid cells]: what is painted as held is uncertain by about a particle."""
FIXED = 0.5
"""The clip tells the stiffness when it leaves at most this share of SPREAD. Otherwise the one given stays."""
SECTION_SPREAD = 0.2
"""Standard deviation of a and b before the clip is seen: a square with one side 8 % longer than the other has an a of as much."""
LOSS_SPREAD = 0.05
"""Standard deviation of l before the clip is seen: loss factors of stems, branches and soft plastics lie between hundredths and tenths."""
OFFSETS = (0.02, 0.05, 0.03, 0.03, 1e-3)
"""Half the central difference's step of s, d, a, b and l."""
LEAST_WIDTH = 0.2
"""Of a difference over its offset, below which rounding would show."""
STEPS = (0.4, 0.5, 0.2, 0.2, 0.02)
"""Largest step of each at a time."""
SHARES = (1.0, 0.5, 0.25, 0.125)
"""Of a joint step, tried in turn until one lowers the cost: where a body buckles it is far from what the step takes it for."""
SETTLED = 0.25
"""Steps of s below this many standard deviations need no other after them."""
COARSE_ROUNDS, FINE_ROUNDS = 5, 2
"""Joint steps at most, each with a solve for theta after it."""


@dataclass(frozen=True)
class Stiffness:
    """What is held to be true of s, d, a, b and l."""

    free: bool
    """Still to be found; else they stay."""
    s: float = 0.0
    deviation: float = SPREAD
    """Standard deviation of s, by the fit itself."""
    deeper: float = 0.0
    """d [grid cells]."""
    uneven: tuple[float, float] = (0.0, 0.0)
    """a and b."""
    loss: float = 0.0
    """l."""
    loss_deviation: float = LOSS_SPREAD
    """Standard deviation of l, by the fit itself."""

    @property
    def known(self) -> bool:
        """Whether the clip tells it."""
        return self.deviation <= FIXED * SPREAD

    @property
    def q(self) -> np.ndarray:
        """(5,) s, d, a, b and l."""
        return np.array([self.s, self.deeper, *self.uneven, self.loss])

    def at(self, q: np.ndarray, covariance: np.ndarray) -> Stiffness:
        """The same with other values (5,), known as well as their covariance (5, 5) says."""
        s, deeper, a, b, loss = q.tolist()
        deviation, loss_deviation = np.sqrt(np.diag(covariance))[[0, 4]].tolist()
        return Stiffness(self.free, s, deviation, deeper, (a, b), loss, loss_deviation)

    def settled(self) -> Stiffness:
        """The same from now on."""
        return replace(self, free=False)

    def of(self, model: Model, body: Particles) -> Model:
        """The model given with this stiffness, held where this says."""
        factor, retardation = self.spread(body), retardation_of(model) + retardation_time(self.loss)
        model = stiffer(scaled(model, self.s), 1.0 if factor is None else factor)
        model = with_clamp_depth(model, body, model.clamp_depth + self.deeper)
        if not self.loss:
            return model
        substeps = min(substeps_for(model, retardation), damped_substeps(model))
        return with_retardation(replace(model, substeps=substeps), retardation)

    def spread(self, body: Particles) -> np.ndarray | None:
        """(N,) factor on the particles' stiffness besides e^s; None where it is even."""
        return np.exp(np.array(self.uneven) @ section_shapes(body)) if any(self.uneven) else None

    def changes(self, model: Model) -> tuple[float, float]:
        """By how much l may change at least and at most, where `model` has the material given: to no damping, to what substeps carry."""
        stiff = scaled(model, self.s)
        most = longest_retardation(replace(stiff, substeps=damped_substeps(stiff)))
        return -self.loss_factor(model), max(0.0, loss_factor(most) - self.loss_factor(model))

    def loss_factor(self, model: Model) -> float:
        """Of the body, where `model` has the material given."""
        return max(0.0, loss_factor(retardation_of(model)) + self.loss)

    def penalty(self) -> float:
        """What q adds to the cost, twice their negative log prior."""
        return float(self.q @ _PRECISION @ self.q)


_PRECISION = np.diag(np.array([SPREAD, DEPTH_SPREAD, SECTION_SPREAD, SECTION_SPREAD, LOSS_SPREAD]) ** -2.0)


def is_free(particles: Particles, model: Model, settings: RecoverSettings) -> bool:
    """Whether the stiffness is an unknown: of an elastic body that is held somewhere, unless the settings forbid it.

    A free body hardly moves differently when it is stiffer. One that flows bends by its yield stress.
    """
    return settings.stiffness == "free" and bool(particles.pinned.any()) and not model.plastic


def scaled(model: Model, s: float) -> Model:
    """The body with e^s times the stiffness, and as many more substeps as faster waves need."""
    if s == 0.0:
        return model
    factor = math.exp(s)
    return replace(stiffer(model, factor), substeps=math.ceil(model.substeps * max(1.0, math.sqrt(factor))))


def stiffer(model: Model, factor: float | np.ndarray) -> Model:
    """The body of `model` with `factor` times the stiffness, one or (N,), and the same retardation time."""
    return replace(model, mu=factor * model.mu, lam=factor * model.lam, viscosity=factor * model.viscosity)


def damped_substeps(model: Model) -> int:
    """Most substeps per frame that the damping of a held body of `model` may ask for."""
    return max(model.substeps, min(MAX_SUBSTEPS_HELD, int(DAMPED_SUBSTEPS * model.substeps)))


def stiffest(model: Model) -> float:
    """Largest s that the substeps allowed to a held body carry."""
    return max(0.0, 2.0 * math.log(MAX_SUBSTEPS_HELD / model.substeps))


def youngs_modulus(model: Model, s: float = 0.0) -> float:
    """E [Pa] of the stiffest part of a body with e^s times the stiffness of `model`."""
    mu, lam = float(model.mu.max()), float(model.lam.max())
    return math.exp(s) * mu * (3.0 * lam + 2.0 * mu) / (lam + mu)


def remark(stiffness: Stiffness, model: Model) -> list[str]:
    """What the user should know of a stiffness that was free."""
    given = youngs_modulus(model)
    if stiffness.known:
        percent, found = 100.0 * math.expm1(stiffness.s), youngs_modulus(model, stiffness.s)
        beside = f"{abs(percent):.0f} % {'above' if percent > 0.0 else 'below'} the given {given:.3g} Pa"
        away = 1000.0 * stiffness.deeper * model.dx
        return [
            f"The motion fits a Young's modulus of {found:.3g} Pa ({beside}, +-{100.0 * stiffness.deviation:.2g} %) on a body held from "
            f"{abs(away):.1f} mm {'inside' if away > 0.0 else 'outside'} the border given: the forces are those on such a body. "
            f"--stiffness given keeps what was given.",
            f"It fits a loss factor of {stiffness.loss_factor(model):.2g} +-{stiffness.loss_deviation:.2g} at {LOSS_FREQUENCY:g} Hz, "
            f"besides what the solver loses of itself.",
        ]
    if stiffness.free and stiffness.deviation < SPREAD:
        return [f"The motion does not tell how stiff the held body is: {given:.3g} Pa was kept, and its forces grow with that."]
    return []


@dataclass(frozen=True)
class Joint:
    """The normal equations of theta and q about a solution."""

    normal: np.ndarray
    """(n, n) J J' + P."""
    coupling: np.ndarray
    """(n, 5) J C."""
    own: np.ndarray
    """(5, 5) C'C + Q."""
    gradient: np.ndarray
    """(n + 5,) right side, its sign turned."""

    @staticmethod
    def about(
        forward: Forward, body: Particles, objective: Objective, precision: np.ndarray, solution: Solution, there: Stiffness
    ) -> Joint:
        """About theta of `solution` and the body of `forward`, which has the stiffness and clamp of `there`. precision: P (n, n)."""

        def white(dq: np.ndarray) -> np.ndarray:
            return forward.journal.array("white", partial(_white, forward, body, objective, solution.theta, dq), solution.theta, dq)

        here = white(np.zeros(len(there.q)))
        sides = [(step, -step) for step in np.diag(OFFSETS)]
        now, most = (loss_factor(of(forward.model)) for of in (retardation_of, longest_retardation))
        sides[-1] = tuple(np.clip(side, -now, max(most - now, 0.0)) for side in sides[-1])
        C = np.zeros((len(here), len(sides)))
        for column, (ahead, behind) in enumerate(sides):
            width = (ahead - behind).sum()
            if width > LEAST_WIDTH * OFFSETS[column]:  # substeps that carry no damping tell nothing of it
                C[:, column] = (white(ahead) - white(behind)) / width
        jacobian = solution.point.jacobian.astype(np.float64)
        pull = np.concatenate([jacobian @ here + precision @ solution.theta, C.T @ here + _PRECISION @ there.q])
        return Joint(solution.point.normal + precision, jacobian @ C, C.T @ C + _PRECISION, pull)

    @property
    def _count(self) -> int:
        return len(self.normal)

    @property
    def covariance(self) -> np.ndarray:
        """(5, 5) of q when nothing but the priors is known of theta."""
        # What theta's freedom leaves of `own` is positive definite but for rounding, and no less than the prior.
        left: np.ndarray = self.own - self.coupling.T @ np.linalg.solve(self.normal, self.coupling)
        values, vectors = np.linalg.eigh(0.5 * (left + left.T) - _PRECISION)
        return np.linalg.inv((vectors * np.maximum(values, 0.0)) @ vectors.T + _PRECISION)

    def step(self, least: float = -math.inf, most: float = math.inf) -> np.ndarray:
        """(5,) the Gauss-Newton step of q, of which the last is kept between these bounds."""
        followed = self.coupling.T @ np.linalg.solve(self.normal, self.gradient[: self._count])
        covariance = self.covariance
        free = -covariance @ (self.gradient[self._count :] - followed)
        return free + covariance[-1] * ((min(max(free[-1], least), most) - free[-1]) / covariance[-1, -1])

    def follow(self, dq: np.ndarray) -> np.ndarray:
        """(n,) the step of theta that goes best with a step (5,) of q."""
        return -np.linalg.solve(self.normal, self.gradient[: self._count] + self.coupling @ dq)

    def chord(self, theta: np.ndarray, residual: np.ndarray, jacobian: np.ndarray, precision: np.ndarray) -> np.ndarray:
        """(n,) a Gauss-Newton step of theta (n,) alone, from whitened residuals (m,) there, with the Jacobian (n, m) of the solution."""
        return -np.linalg.solve(self.normal, jacobian @ residual + precision @ theta)


def shortened(step: np.ndarray) -> np.ndarray:
    """The step (5,) of q, or as much of it as is taken at a time."""
    return step / max(1.0, *(np.abs(step) / STEPS))


def covariance_with(normal: np.ndarray, joint: Joint | None) -> np.ndarray:
    """(n, n) posterior covariance of theta, its precision `normal` if q were known, with q not known better than by `joint`."""
    covariance = np.linalg.inv(normal)
    if joint is None:
        return covariance
    along = covariance @ joint.coupling
    return covariance + along @ joint.covariance @ along.T


def _white(forward: Forward, body: Particles, objective: Objective, theta: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """(m,) whitened residuals a step dq (5,) away. The substeps stay, or the difference would be one of substeps too."""
    factor = np.exp(dq[0] + dq[2:4] @ section_shapes(body))
    model = with_clamp_depth(forward.model, body, forward.model.clamp_depth + float(dq[1]))
    damped = with_retardation(model, retardation_of(model) + retardation_time(float(dq[4])))
    other = replace(forward, model=stiffer(damped, factor))
    return objective.whiten(objective.residual(other.positions(theta[None])))[0].astype(np.float64)
