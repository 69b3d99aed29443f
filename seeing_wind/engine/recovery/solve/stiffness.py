"""The stiffness of a held body and the place of its clamp, as further unknowns of the solve.

How far a force bends a held body depends on its stiffness, which is never known well: it grows with the cube of a thickness that was
guessed from frames, and a grid of a few cells across the body adds an error of its own, also if the targets are 3D points. Near resonance
the effect is larger: a post 13 % too stiff led to forces 37 % off. But the body's free motion shows its stiffness, which is therefore
found together with the force. Where the body is held is seen to a few millimetres only, and a clamp that reaches too far up makes the body
stiffer, but not equally in every mode of swinging. So the clamp's depth is found, too, and the distribution of stiffness over the section
(`section`). With r the whitened residuals, J (n, m) their derivatives by the other unknowns theta, P the precision of theta's prior, and

    q = (s, d, a, b)    s = log(E / E given) ~ N(0, stiffness_spread²)      d ~ N(0, clamp_spread²), cells by which the clamp begins deeper
                        a, b ~ N(0, section_spread² or section_seen²), amplitudes of the section's two shapes
    C = dr/dq           (m, 4), finite differences through the simulator
    Q                   precision of q's prior: diagonal, or the posterior from another clip of the same body (`known_body`)

a joint Gauss-Newton step is

    [ J J' + P   J C      ] [d theta]       [ J r + P theta ]
    [ (J C)'     C'C + Q  ] [d q    ]  =  - [ C'r + Q (q - E q) ]

After it, theta alone is solved for again. s scales both of Lamé's parameters and the viscosity, so that Poisson's ratio and the retardation
time stay as they are. The damping is the material's: as a further unknown it did not reduce the errors (docs/notebook/held_bodies.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ...conventions import in_units
from ...materials import LIMITS
from ...mpm.model import Model
from ...mpm.model_for import with_clamp_depth
from ...records import Particles
from ...settings import RecoverSettings
from ..prior.constants import PRIOR
from ..targets.objective import Objective
from .constants import PACE
from .forward import Forward
from .gauss_newton import Solution
from .section import section_shapes

LEAST_SHIFT = 5e-5
"""Least distance between the clamp and the given border that a note states [m]."""


def prior_covariance(section: float = PRIOR.section_spread) -> np.ndarray:
    """(4, 4) covariance of q before any clip is seen, with the standard deviation `section` for a and b."""
    return np.diag([PRIOR.stiffness_spread, PRIOR.clamp_spread, section, section]) ** 2


@dataclass(frozen=True)
class Stiffness:
    """What is known of q = (s, d, a, b)."""

    free: bool
    """True while q is an unknown of the solve; False if it keeps its value."""
    q: np.ndarray = field(default_factory=lambda: np.zeros(4))
    """(4,) s, d [grid cells], a and b."""
    covariance: np.ndarray = field(default_factory=prior_covariance)
    """(4, 4) posterior covariance of q."""
    expected: np.ndarray = field(default_factory=lambda: np.zeros(4))
    """(4,) mean of q's prior."""
    precision: np.ndarray = field(default_factory=lambda: np.linalg.inv(prior_covariance()))
    """(4, 4) precision of q's prior."""

    @staticmethod
    def unknown(free: bool, seen: bool) -> Stiffness:
        """The state before any clip is seen; `seen`: whether the body's particles are points that were followed."""
        covariance = prior_covariance(PRIOR.section_seen if seen else PRIOR.section_spread)
        return Stiffness(free, covariance=covariance, precision=np.linalg.inv(covariance))

    @staticmethod
    def of_another_clip(expected: np.ndarray, covariance: np.ndarray, free: bool) -> Stiffness:
        """The state after another clip of the same body, which gave q's mean (4,) and covariance (4, 4)."""
        return Stiffness(free, expected, covariance, expected, np.linalg.inv(covariance))

    @property
    def s(self) -> float:
        """log(E / E given)."""
        return float(self.q[0])

    @property
    def deeper(self) -> float:
        """d [grid cells]."""
        return float(self.q[1])

    @property
    def deviation(self) -> float:
        """Standard deviation of s."""
        return math.sqrt(self.covariance[0, 0])

    @property
    def known(self) -> bool:
        """Whether this clip, or an earlier one, determines the stiffness."""
        return self.deviation <= PRIOR.stiffness_told * PRIOR.stiffness_spread

    def at(self, q: np.ndarray, covariance: np.ndarray) -> Stiffness:
        """The same with other values q (4,) and their covariance (4, 4)."""
        return replace(self, q=q, covariance=covariance)

    def settled(self) -> Stiffness:
        """The same, no longer free."""
        return replace(self, free=False)

    def of(self, model: Model, body: Particles) -> Model:
        """The given model with this stiffness and this place of the clamp."""
        factor, model = self.spread(body), scaled(model, self.s)
        if factor is not None:
            model = with_substeps_for(stiffer(model, factor), float(factor.max()))
        return with_clamp_depth(model, body, model.clamp_depth + self.deeper)

    def spread(self, body: Particles) -> np.ndarray | None:
        """(N,) factor on the particles' stiffness in addition to e^s; None if it is 1 everywhere."""
        return np.exp(self.q[2:] @ section_shapes(body)) if self.q[2:].any() else None

    def penalty(self) -> float:
        """The part of the cost due to q: twice the negative logarithm of its prior, up to an additive constant."""
        off = self.q - self.expected
        return float(off @ self.precision @ off)


def is_free(particles: Particles, settings: RecoverSettings) -> bool:
    """Whether the stiffness is an unknown: it is if the body is held somewhere, unless the settings forbid it.

    The motion of a free body hardly depends on its stiffness. The yield stress of a body that flows stays as given.
    """
    return settings.stiffness == "free" and bool(particles.pinned.any())


def scaled(model: Model, s: float) -> Model:
    """The body with e^s times the stiffness, with more substeps if its waves become faster."""
    if s == 0.0:
        return model
    factor = math.exp(s)
    return with_substeps_for(stiffer(model, factor), factor)


def with_substeps_for(model: Model, factor: float) -> Model:
    """The model with as many more substeps as its waves need if its stiffness was multiplied by at most `factor`."""
    return replace(model, substeps=math.ceil(model.substeps * max(1.0, math.sqrt(factor))))


def stiffer(model: Model, factor: float | np.ndarray) -> Model:
    """The body of `model` with `factor` times the stiffness, a number or (N,), and the same retardation time."""
    return replace(model, mu=factor * model.mu, lam=factor * model.lam, viscosity=factor * model.viscosity)


def stiffest(model: Model) -> float:
    """Largest s for which the substeps that a held body may have suffice."""
    return max(0.0, 2.0 * math.log(LIMITS.max_substeps_held / model.substeps))


def youngs_modulus(model: Model, body: Particles, s: float = 0.0) -> float:
    """E [Pa] of the material of a body with e^s times the stiffness of `model`."""
    i = 0 if body.stiffness is None else int(np.argmax(body.stiffness))
    mu, lam = float(model.mu[i]), float(model.lam[i])
    factor = 1.0 if body.stiffness is None else float(body.stiffness[i])
    factor *= 1.0 if body.mixture is None else float(body.mixture.youngs_modulus[i])
    return math.exp(s) * mu * (3.0 * lam + 2.0 * mu) / (lam + mu) / factor


def remark(stiffness: Stiffness, model: Model, body: Particles) -> list[str]:
    """Notes for the user on a stiffness that was free."""
    given = youngs_modulus(model, body)
    if stiffness.known:
        percent, found = round(100.0 * math.expm1(stiffness.s)), youngs_modulus(model, body, stiffness.s)
        beside = f"{abs(percent)} % {'above' if percent > 0 else 'below'} the given {in_units(given, 'Pa')}" if percent else "as given"
        away = stiffness.deeper * model.dx
        side = "inside" if away > 0.0 else "outside"
        where = f"{in_units(abs(away), 'm', 2)} {side}" if abs(away) >= LEAST_SHIFT else "at"
        return [
            f"The motion fits a Young's modulus of {in_units(found, 'Pa')} ({beside}, ±{100.0 * stiffness.deviation:.2g} %), and a clamp "
            f"that begins {where} the border of what is marked as held. The forces are those on such a body; with --stiffness given, the "
            "modulus and the border stay as given."
        ]
    if stiffness.free and stiffness.deviation < PRIOR.stiffness_spread:
        return [f"The motion does not show how stiff the held body is: {in_units(given, 'Pa')} was kept, and the forces grow with it."]
    return []


@dataclass(frozen=True)
class Joint:
    """The normal equations of theta and q around a solution."""

    normal: np.ndarray
    """(n, n) J J' + P."""
    coupling: np.ndarray
    """(n, 4) J C."""
    own: np.ndarray
    """(4, 4) C'C + Q."""
    gradient: np.ndarray
    """(n + 4,) half the gradient of the cost, minus the right side of the normal equations."""
    prior: np.ndarray
    """(4, 4) Q."""

    @staticmethod
    def about(
        forward: Forward, body: Particles, objective: Objective, precision: np.ndarray, solution: Solution, there: Stiffness
    ) -> Joint:
        """The equations at theta of `solution` and the body of `forward`, whose stiffness and clamp are `there`; precision: P (n, n)."""

        def white(dq: np.ndarray) -> np.ndarray:
            return forward.journal.array("white", partial(_white, forward, body, objective, solution.theta, dq), solution.theta, dq)

        here = solution.residual.astype(np.float64)
        C = np.stack([(white(step) - here) / step.sum() for step in np.diag(PACE.stiffness_offsets)], axis=1)
        jacobian = solution.point.jacobian.astype(np.float64)
        pull = np.concatenate([jacobian @ here + precision @ solution.theta, C.T @ here + there.precision @ (there.q - there.expected)])
        return Joint(solution.point.normal + precision, jacobian @ C, C.T @ C + there.precision, pull, there.precision)

    @property
    def _count(self) -> int:
        return len(self.normal)

    @property
    def covariance(self) -> np.ndarray:
        """(4, 4) marginal posterior covariance of q, when theta is unknown."""
        # The Schur complement of `normal` is positive definite but for rounding, and at least the precision of q's prior.
        left: np.ndarray = self.own - self.coupling.T @ np.linalg.solve(self.normal, self.coupling)
        values, vectors = np.linalg.eigh(0.5 * (left + left.T) - self.prior)
        return np.linalg.inv((vectors * np.maximum(values, 0.0)) @ vectors.T + self.prior)

    def step(self) -> np.ndarray:
        """(4,) the joint Gauss-Newton step of q."""
        followed = self.coupling.T @ np.linalg.solve(self.normal, self.gradient[: self._count])
        return -self.covariance @ (self.gradient[self._count :] - followed)

    def follow(self, dq: np.ndarray) -> np.ndarray:
        """(n,) the best step of theta, given a step dq (4,) of q."""
        return -np.linalg.solve(self.normal, self.gradient[: self._count] + self.coupling @ dq)

    def chord(self, theta: np.ndarray, residual: np.ndarray, jacobian: np.ndarray, precision: np.ndarray) -> np.ndarray:
        """(n,) a Gauss-Newton step of theta (n,) alone, with whitened residuals (m,) at theta and the Jacobian (n, m) of the solution."""
        return -np.linalg.solve(self.normal, jacobian @ residual + precision @ theta)


def shortened(step: np.ndarray) -> np.ndarray:
    """The step (4,) of q, scaled down where it exceeds the largest step allowed at a time."""
    return step / max(1.0, *(np.abs(step) / PACE.stiffness_steps))


def covariance_with(normal: np.ndarray, joint: Joint | None) -> np.ndarray:
    """(n, n) posterior covariance of theta: for a known q the inverse of `normal` (n, n); a `joint` adds the uncertainty of its q."""
    covariance = np.linalg.inv(normal)
    if joint is None:
        return covariance
    along = covariance @ joint.coupling
    return covariance + along @ joint.covariance @ along.T


def _white(forward: Forward, body: Particles, objective: Objective, theta: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """(m,) whitened residuals with q changed by dq (4,). The substeps stay the same, or they would contribute to the difference."""
    factor = np.exp(dq[0] + dq[2:] @ section_shapes(body))
    model = with_clamp_depth(forward.model, body, forward.model.clamp_depth + float(dq[1]))
    other = replace(forward, model=stiffer(model, factor))
    return objective.whiten(objective.residual(other.positions(theta[None])))[0].astype(np.float64)
