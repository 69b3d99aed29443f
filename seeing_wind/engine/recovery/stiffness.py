"""The stiffness of a held body as one more unknown of the solve.

How far a force bends a held body is a matter of its stiffness, and pictures do not show that: it grows with the cube of a thickness that
was guessed. A body that swings near its resonance is worse: a post 13 % too stiff asked for forces 37 % off. But what it does by itself
tells, so its stiffness is found with the force. With r the whitened residuals, J (n, m) their derivatives by the other unknowns theta, P
the precision of theta's prior, and

    s = log(E / E given) ~ N(0, SPREAD²)            c = dr/ds, a central difference through the simulator

a Gauss-Newton step for both solves

    [ J J' + P    J c             ] [d theta]       [ J r + P theta       ]
    [ (J c)'      c'c + 1/SPREAD² ] [ds     ]  =  - [ c'r + s / SPREAD²   ]

and after it theta alone is solved for again. s scales both of Lamé's parameters: Poisson's ratio stays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..mpm.model import MAX_SUBSTEPS_HELD, Model
from ..records import Particles, PointTargets, TrackTargets
from ..settings import RecoverSettings
from .forward import Forward
from .gauss_newton import Solution
from .objective import Objective

SPREAD = 0.3
"""Standard deviation of s before the clip is seen: a guessed thickness alone makes as much."""
FIXED = 0.5
"""The clip tells the stiffness when it leaves at most this share of SPREAD. Otherwise the one given stays."""
OFFSET = 0.02
"""Half the central difference's step of s."""
STEP = 0.4
"""Largest step of s at a time."""
SHARES = (1.0, 0.5, 0.25, 0.125)
"""Of a joint step, tried in turn until one lowers the cost: where a body buckles it is far from what the step takes it for."""
SETTLED = 0.25
"""Steps of s below this many standard deviations need no other after them."""
COARSE_ROUNDS, FINE_ROUNDS = 3, 1
"""Joint steps at most, each with a solve for theta after it."""


@dataclass(frozen=True)
class Stiffness:
    """What is held to be true of s."""

    free: bool
    """Still to be found; else it stays."""
    s: float = 0.0
    deviation: float = SPREAD
    """Standard deviation of s, by the fit itself."""

    @property
    def known(self) -> bool:
        """Whether the clip tells it."""
        return self.deviation <= FIXED * SPREAD

    def settled(self) -> Stiffness:
        """The same from now on."""
        return replace(self, free=False)


def is_free(particles: Particles, model: Model, targets: Sequence[PointTargets | TrackTargets], settings: RecoverSettings) -> bool:
    """Whether the stiffness is an unknown: of an elastic body that is held somewhere and seen in pictures, unless the settings forbid it.

    A free body hardly moves differently when it is stiffer. One that flows bends by its yield stress. Points in 3D come with a shape that
    is not guessed; there the error of the clamp would be taken for one of the stiffness (on a post 11 % of error became 15 %).
    """
    in_pictures = all(isinstance(one, TrackTargets) for one in targets)
    return settings.stiffness == "free" and in_pictures and bool(particles.pinned.any()) and not model.plastic


def scaled(model: Model, s: float) -> Model:
    """The body with e^s times the stiffness, and as many more substeps as faster waves need."""
    if s == 0.0:
        return model
    factor = math.exp(s)
    return replace(model, mu=factor * model.mu, lam=factor * model.lam, substeps=math.ceil(model.substeps * max(1.0, math.sqrt(factor))))


def stiffest(model: Model) -> float:
    """Largest s that the substeps allowed to a held body carry."""
    return max(0.0, 2.0 * math.log(MAX_SUBSTEPS_HELD / model.substeps))


def youngs_modulus(model: Model, s: float = 0.0) -> float:
    """E [Pa] of the stiffest part of a body with e^s times the stiffness of `model`."""
    mu, lam = float(model.mu.max()), float(model.lam.max())
    return math.exp(s) * mu * (3.0 * lam + 2.0 * mu) / (lam + mu)


def penalty(s: float) -> float:
    """What s adds to the cost, twice its negative log prior."""
    return (s / SPREAD) ** 2


def remark(stiffness: Stiffness, model: Model) -> list[str]:
    """What the user should know of a stiffness that was free."""
    given = youngs_modulus(model)
    if stiffness.known:
        percent, found = 100.0 * math.expm1(stiffness.s), youngs_modulus(model, stiffness.s)
        beside = f"{abs(percent):.0f} % {'above' if percent > 0.0 else 'below'} the given {given:.3g} Pa"
        return [
            f"The motion fits a Young's modulus of {found:.3g} Pa ({beside}, +-{100.0 * stiffness.deviation:.2g} %): "
            f"the forces are those on such a body. --stiffness given keeps the given one."
        ]
    if stiffness.free and stiffness.deviation < SPREAD:
        return [f"The motion does not tell how stiff the held body is: {given:.3g} Pa was kept, and its forces grow with that."]
    return []


@dataclass(frozen=True)
class Joint:
    """The normal equations of theta and s about a solution."""

    normal: np.ndarray
    """(n, n) J J' + P."""
    coupling: np.ndarray
    """(n,) J c."""
    own: float
    """c'c + 1/SPREAD²."""
    gradient: np.ndarray
    """(n + 1,) right side, its sign turned."""

    @staticmethod
    def about(forward: Forward, objective: Objective, precision: np.ndarray, solution: Solution, s: float) -> Joint:
        """About theta of `solution` and the body of `forward`, which has e^s times the stiffness given. precision: P (n, n)."""
        less, here, more = (_white(forward, objective, solution.theta, offset) for offset in (-OFFSET, 0.0, OFFSET))
        column = (more - less) / (2.0 * OFFSET)
        jacobian = solution.point.jacobian.astype(np.float64)
        pull = np.append(jacobian @ here + precision @ solution.theta, column @ here + s / SPREAD**2)
        return Joint(solution.point.normal + precision, jacobian @ column, float(column @ column) + 1.0 / SPREAD**2, pull)

    @property
    def deviation(self) -> float:
        """Standard deviation of s when nothing but the priors is known of theta."""
        return 1.0 / math.sqrt(self._left())

    def step(self) -> float:
        """The Gauss-Newton step of s."""
        return -float(self.gradient[-1] - self.coupling @ np.linalg.solve(self.normal, self.gradient[:-1])) / self._left()

    def follow(self, ds: float) -> np.ndarray:
        """(n,) the step of theta that goes best with a step of s."""
        return -np.linalg.solve(self.normal, self.gradient[:-1] + ds * self.coupling)

    def _left(self) -> float:
        """Precision of s that theta's freedom leaves of `own`; positive, but for rounding."""
        return max(self.own - float(self.coupling @ np.linalg.solve(self.normal, self.coupling)), 1.0 / SPREAD**2)


def covariance_with(normal: np.ndarray, joint: Joint | None) -> np.ndarray:
    """(n, n) posterior covariance of theta, its precision `normal` if the stiffness were known, with s not known better than by `joint`."""
    covariance = np.linalg.inv(normal)
    if joint is None:
        return covariance
    along = covariance @ joint.coupling
    return covariance + np.outer(along, along) * joint.deviation**2


def _white(forward: Forward, objective: Objective, theta: np.ndarray, ds: float) -> np.ndarray:
    """(m,) whitened residuals with e^ds times the stiffness. The substeps stay, or the difference would be one of substeps too."""
    factor = math.exp(ds)
    other = replace(forward, model=replace(forward.model, mu=factor * forward.model.mu, lam=factor * forward.model.lam))
    return objective.whiten(objective.residual(other.positions(theta[None])))[0].astype(np.float64)
