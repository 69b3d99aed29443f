"""Hyperparameters of the prior by type-II maximum likelihood on the linearised problem.

With unknowns theta ~ N(0, K), K the prior's covariance, whitened residuals linear in them, N = J'J and b = J'(J theta - r),

    2 log evidence = log |K^-1| - log |K^-1 + N| + b' m + constant        m = (K^-1 + N)^-1 b, the posterior's mean

(MacKay 1992, "Bayesian interpolation"; Rasmussen and Williams 2006, section 5.4.1). With P = (K^-1 + N)^-1 and alpha = K^-1 m, it changes
along dK by half of

    tr (K^-1 (P + m m') K^-1 - K^-1) dK

K is a Kronecker product of the modes' correlation at the knots and the components' covariance C, and so is its inverse: all that is as
large as the unknowns is one Cholesky factor and one inverse. Newton's steps are taken with the *average information*, the mean of the
observed and the expected one (Gilmour, Thompson and Cullis 1995),

    alpha' dK_i (N - N P N) dK_j alpha / 2

which takes no more than products with vectors, and with weak hyperpriors, which keep the hyperparameters finite where the clip does not
determine them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg import cho_solve, lapack

from ..solve.constants import PACE
from ..solve.gauss_newton import Linearisation
from ..targets.objective import Objective
from .constants import PRIOR
from .kernel import Kernel, Places, Prior

ITERATIONS = 25
HYPERPRIORS = {
    "length": (PRIOR.length, PRIOR.length_spread),
    "duration": (PRIOR.duration, PRIOR.duration_spread),
    "uniform": (PRIOR.uniform, PRIOR.part_spread),
    "slope": (PRIOR.slope, PRIOR.part_spread),
}
"""Log-normal hyperpriors: median, and standard deviation of the logarithm."""
LONGEST = 2.0
"""Step of any one logarithm at a time: beyond, the information at its beginning says nothing of its end."""
SHORTER = 0.1
"""Share of a step, at least, that is tried after one that gains nothing."""
COARSE_STRIDE = 3
"""Every so many of the mismatch factors are tried first, then those near the best."""
INFORMATIVE = 1e-4
"""Variance that the prior gives to the whitened data in all, relative to the noise, below which they tell nothing of its sizes."""
SMALLEST = 1e-12
"""Added to the diagonal of J'J, relative to its largest entry: rounding may have left it none where the data do not separate unknowns."""


@dataclass(frozen=True)
class Evidence:
    """What the linearised problem says of the hyperparameters. The prior's stretch penalty is no part of it."""

    places: Places
    velocity: np.ndarray
    """(V,) standard deviations of the initial velocities [m/s]."""
    normal: np.ndarray
    """(n, n) J'J of the whitened residuals."""
    pull: np.ndarray
    """(n,) J'(J theta - r) at the linearisation point theta."""

    def tells(self, kernel: Kernel) -> bool:
        """Whether the data depend on the unknowns at all, if these are as large as the hyperparameters say."""
        size = 3 * self.places.count
        field = np.kron(self.places.covariance(kernel), kernel.covariance)
        velocities = self.normal.diagonal()[size:] @ self.velocity**2
        return float((self.normal[:size, :size] * field).sum() + velocities) > INFORMATIVE

    def log(self, kernel: Kernel) -> float:
        """The logarithm of the evidence, without the constant."""
        return self.along(kernel, np.zeros((0, 3, 3)))[0]

    def along(self, kernel: Kernel, directions: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """`log`, its derivatives (4 + D,) and the average information (4 + D, 4 + D), by log L, log tau, log u, log w and along
        directions (D, 3, 3) of C."""
        count, size = self.places.count, 3 * self.places.count
        correlation, slopes = self.places.with_slopes(kernel)
        modes, log_modes, _ = _inverse(correlation)
        components, log_components, _ = _inverse(kernel.covariance)
        precision = self.normal + SMALLEST * float(self.normal.diagonal().max()) * np.eye(len(self.normal))
        precision[:size, :size] += np.kron(modes, components)
        precision[range(size, len(precision)), range(size, len(precision))] += 1.0 / self.velocity**2
        posterior, log_precision, upper = _inverse(precision)
        mean = cho_solve((upper, False), self.pull)
        value = 0.5 * (float(self.pull @ mean) - log_precision - 3.0 * log_modes - count * log_components)

        field = mean[:size].reshape(count, 3)
        second = posterior[:size, :size].reshape(count, 3, count, 3) + np.multiply.outer(field, field)
        by_modes = modes @ np.einsum("iajb,ab->ij", second, components, optimize=True) @ modes - 3.0 * modes
        by_components = components @ np.einsum("iajb,ij->ab", second, modes) @ components - count * components
        gradient = 0.5 * np.concatenate([np.tensordot(slopes, by_modes, 2), np.tensordot(directions, by_components, 2)])

        alpha = modes @ field @ components
        moved = np.concatenate([slopes @ alpha @ kernel.covariance, correlation @ alpha @ directions]).reshape(-1, size)
        seen = self.normal[:, :size] @ moved.T
        information = 0.5 * (moved @ seen[:size] - seen.T @ cho_solve((upper, False), seen))
        return value, gradient, 0.5 * (information + information.T)


def _inverse(matrix: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Of a symmetric positive definite matrix (n, n) its inverse, the logarithm of its determinant, and its upper Cholesky factor."""
    upper = np.linalg.cholesky(matrix).T  # in the order of Fortran, as LAPACK wants it
    inverse, failed = lapack.dpotri(upper, lower=0)
    assert not failed, "what has a Cholesky factor has an inverse"
    inverse = np.triu(inverse)
    inverse += np.triu(inverse, 1).T
    return inverse, 2.0 * float(np.log(upper.diagonal()).sum()), upper


@dataclass(frozen=True)
class _Sizes:
    """The hyperparameters as numbers without bounds: log L, log tau, log u, log w, and of the factor A of C = root A A' root' the
    logarithms of its diagonal, then the rest over it."""

    root: np.ndarray
    """(3, 3)."""

    def of(self, kernel: Kernel) -> np.ndarray:
        """(10,)."""
        factor = np.linalg.solve(self.root, np.linalg.cholesky(kernel.covariance))
        diagonal = np.diag(factor)
        below = (factor / diagonal)[BELOW]
        return np.concatenate([np.log([kernel.length, kernel.duration, kernel.uniform, kernel.slope]), np.log(diagonal), below])

    def kernel(self, sizes: np.ndarray) -> Kernel:
        """From (10,)."""
        factor = self.root @ _factor(sizes)
        return Kernel(factor @ factor.T, *np.exp(sizes[:4]).tolist())

    def directions(self, sizes: np.ndarray) -> np.ndarray:
        """(6, 3, 3) in which C changes with the last six."""
        factor, changed = _factor(sizes), np.zeros((6, 3, 3))
        for axis in range(3):
            changed[axis, :, axis] = factor[:, axis]
        for number, (row, column) in enumerate(zip(*BELOW)):
            changed[3 + number, row, column] = factor[column, column]
        half = self.root @ changed @ (self.root @ factor).T
        return half + half.transpose(0, 2, 1)


BELOW = np.tril_indices(3, -1)


def _factor(sizes: np.ndarray) -> np.ndarray:
    """A (3, 3) of `_Sizes`."""
    factor = np.eye(3)
    factor[BELOW] = sizes[7:]
    return factor * np.exp(sizes[4:7])


def _hyperprior() -> tuple[np.ndarray, np.ndarray]:
    """Mean (10,) and precision (10, 10) of `_Sizes`. Of C it constrains the shape, root root', but not the scale."""
    medians, spreads = np.array(list(HYPERPRIORS.values())).T
    mean, precision = np.concatenate([np.log(medians), np.zeros(6)]), np.zeros((10, 10))
    precision[range(4), range(4)] = spreads**-2
    precision[4:7, 4:7] = (np.eye(3) - 1.0 / 3.0) / PRIOR.component_spread**2
    precision[7:, 7:] = np.eye(3) / PRIOR.component_spread**2
    return mean, precision


def _corrected(curvature: np.ndarray, step: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """A curvature (n, n) by which a step (n,) changes the gradient by `turned` (n,), as it did: the update of Broyden, Fletcher, Goldfarb
    and Shanno. The average information alone overshoots, as it knows nothing of how the covariance bends with its sizes."""
    if not step @ turned > 0.0:
        return curvature
    along = curvature @ step
    corrected: np.ndarray = curvature + np.outer(turned, turned) / (step @ turned) - np.outer(along, along) / (step @ along)
    return corrected


def maximise_evidence(
    prior: Prior, normal: np.ndarray, pull: np.ndarray, component: np.ndarray | None = None, check: Callable[[], None] = lambda: None
) -> Kernel:
    """The hyperparameters of greatest evidence, by damped Newton steps.

    Args:
        prior: the starting point. Its stretch penalty is ignored: it would shrink the sizes, and smaller sizes would strengthen it.
        normal: (n, n) J'J of the whitened residuals.
        pull: (n,) J'(J theta - r) at the linearisation point theta.
        component: (3, 3) expected shape of the covariance of the force's components; None for isotropic.
        check: called at every evaluation; may raise to cancel.
    """
    evidence = Evidence(prior.places, prior.velocity, normal, pull)
    if not evidence.tells(prior.kernel):
        return prior.kernel
    shape = np.eye(3) if component is None else component
    as_numbers, (expected, precision) = _Sizes(np.linalg.cholesky(shape)), _hyperprior()

    def cost(sizes: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Penalty minus the logarithm of the evidence, its gradient (10,) and curvature (10, 10)."""
        check()
        value, gradient, information = evidence.along(as_numbers.kernel(sizes), as_numbers.directions(sizes))
        held = precision @ (sizes - expected)
        return 0.5 * float((sizes - expected) @ held) - value, held - gradient, information + precision

    sizes = as_numbers.of(prior.kernel)
    value, gradient, curvature = cost(sizes)
    for _ in range(ITERATIONS):
        step = -np.linalg.solve(curvature, gradient)
        if -0.5 * gradient @ step < PACE.evidence_tolerance:
            break
        step /= max(1.0, float(np.abs(step).max()) / LONGEST)
        found = cost(sizes + step)
        while not found[0] < value and -gradient @ step > PACE.evidence_tolerance:
            slope = gradient @ step  # to the lowest point of the parabola through both values, or some of the way
            step *= max(SHORTER, -0.5 * slope / (found[0] - value - slope))
            found = cost(sizes + step)
        if not found[0] < value:
            break
        turned = found[1] - gradient
        sizes, (value, gradient, curvature) = sizes + step, found
        curvature = _corrected(curvature, step, turned)
    kernel = as_numbers.kernel(sizes)
    return replace(kernel, covariance=kernel.covariance + PRIOR.component_floor * np.trace(kernel.covariance) / np.trace(shape) * shape)


def mismatch_scale(prior: Prior, objective: Objective, point: Linearisation, scales: Sequence[float]) -> float:
    """The factor on the mismatch's standard deviation that has the greatest evidence.

    Args:
        prior: with its hyperparameters learnt.
        objective: that whitened the residuals of `point`.
        point: the linearisation.
        scales: factors to choose from, in order.
    """
    raw = objective.unwhitened(np.concatenate([point.jacobian, (point.jacobian.T @ point.theta - point.residual)[None]]))
    precision = prior.precision()

    @cache
    def evidence(index: int) -> float:
        other = objective.mismatched(scales[index])
        white = other.whiten(raw).astype(np.float64)
        jacobian, data = white[:-1], white[-1]
        pull, root = jacobian @ data, np.linalg.cholesky(precision + jacobian @ jacobian.T)
        explained = float(pull @ cho_solve((root.T, False), pull))
        volume = float(np.log(root.diagonal()).sum()) - other.log_volume
        return 0.5 * (explained - float(data @ data)) - volume

    best = max(range(0, len(scales), COARSE_STRIDE), key=evidence)
    while True:  # uphill from the best of a few
        better = max((index for index in (best - 1, best, best + 1) if 0 <= index < len(scales)), key=evidence)
        if better == best:
            return scales[best]
        best = better


def prefer_belief(belief: Prior, other: Prior, point: Linearisation, odds: float = PRIOR.stretch_log_odds) -> Prior:
    """`belief`, unless the evidence at `point` favours the other prior by more than the log odds `odds`."""
    pull = point.normal @ point.theta - point.jacobian @ point.residual
    evidence = []
    for prior in (belief, other):
        precision = prior.precision()
        total = precision + point.normal
        volume = np.linalg.slogdet(precision)[1] - np.linalg.slogdet(total)[1]
        evidence.append(0.5 * float(volume + pull @ np.linalg.solve(total, pull)))
    return belief if evidence[0] > evidence[1] - odds else other
