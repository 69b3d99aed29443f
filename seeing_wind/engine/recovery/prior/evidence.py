"""Hyperparameters of the prior by type-II maximum likelihood on the linearised problem.

With unknowns ~ N(0, K), K the prior's covariance, and whitened residuals linear in them, J'J = R'R and z = R^-T J'(J theta - r), z is
N(0, I + R K R'), so

    -2 log evidence = log |I + R K R'| + z' (I + R K R')^-1 z + constant

(MacKay 1992, "Bayesian interpolation"; Rasmussen and Williams 2006, section 5.4.1). Weak hyperpriors keep the hyperparameters finite
where the clip does not determine them. The size of the force has no hyperprior, and for a body that does not move it would go to zero; it
is kept large enough for the clip to distinguish it from zero (`_resolved`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, reduce
from typing import Any

import numpy as np
import torch
from scipy.linalg import cho_factor, cho_solve, eigh
from scipy.optimize import brentq

from ...field.optimisers import LBFGS
from ...field.torch_threads import torch_threads
from ...mpm.compiler.device import cores
from ..solve.constants import PACE
from ..solve.gauss_newton import Linearisation
from ..targets.objective import Objective
from .constants import PRIOR
from .kernel import Kernel, Prior

ITERATIONS = 25
HYPERPRIORS = {
    "length": (PRIOR.length, PRIOR.length_spread),
    "duration": (PRIOR.duration, PRIOR.duration_spread),
    "uniform": (PRIOR.uniform, PRIOR.part_spread),
    "slope": (PRIOR.slope, PRIOR.part_spread),
}
"""Log-normal hyperpriors: median, and standard deviation of the logarithm."""
ROUNDING = 1e-11
"""Added to the diagonal of a covariance, relative to its mean, to keep it positive definite in double precision."""
LOG_LIMIT = 30.0
"""Largest absolute logarithm of a hyperparameter that the line search may try."""
MISMATCH_SCALES = tuple(2.0**power for power in range(-9, 4))
"""Factors on the standard deviation of the mismatch of 3D points, of which the evidence chooses one."""
COARSE_STRIDE = 3
"""Only every n-th of the mismatch factors is tried first, then those near the best."""
PARALLEL_FROM = 250
"""Number of data directions above which torch uses all cores; below, starting the threads costs more than it saves."""
INFORMATIVE = 1e-4
"""Directions of the whitened data in which the prior variance is less than this, relative to the noise, are left out."""
UNTOLD = 1.0
"""Where a clip shows no force, a force of the learnt size must lose at least this much evidence against none [nats]: the clip could not
distinguish a smaller one from none, and so does not justify a smaller uncertainty."""
SMALLEST = 1e-12
"""Added to the diagonal of J'J, relative to its largest entry, as J'J is singular where the data do not separate unknowns."""


def maximise_evidence(
    prior: Prior, normal: np.ndarray, pull: np.ndarray, component: np.ndarray | None = None, check: Callable[[], None] = lambda: None
) -> Kernel:
    """The hyperparameters of greatest evidence, by L-BFGS.

    Args:
        prior: the starting point. Its stretch penalty is ignored: it would shrink the force's size, and a smaller size would strengthen it.
        normal: (n, n) J'J of the whitened residuals.
        pull: (n,) J'(J theta - r) at the linearisation point theta.
        component: (3, 3) expected shape of the covariance of the force's components; None for isotropic.
        check: called at each evaluation; raises to cancel.
    """
    size = len(normal) - len(prior.velocity)
    R, z = _informative_directions(prior, normal, pull)
    if not len(z):
        return prior.kernel
    velocity = R[:, size:] @ torch.diag(torch.from_numpy(prior.velocity**2)) @ R[:, size:].T
    by_component = R[:, :size].reshape(len(R), -1, 3)
    shape = np.eye(3) if component is None else component
    root = torch.from_numpy(np.linalg.cholesky(shape))
    parameters = _pack(prior.kernel, root.numpy()).requires_grad_(True)
    begin = parameters.detach().clone()
    optimiser = LBFGS(
        [parameters], max_iter=ITERATIONS, history_size=8, line_search_fn="strong_wolfe", tolerance_change=PACE.evidence_tolerance
    )

    def of_field(factor: torch.Tensor, sizes: tuple[torch.Tensor, ...]) -> torch.Tensor:
        """(k, k) contribution of the field to the covariance of z."""
        correlation = prior.places.correlation(*sizes)
        turned = (by_component @ (root @ factor)).unbind(dim=2)
        return reduce(torch.add, (part @ correlation @ part.T for part in turned))

    def objective() -> torch.Tensor:
        """Penalty minus log evidence; also computes the derivative."""
        check()
        optimiser.zero_grad()
        value = _penalty(parameters) - log_evidence(of_field(*_unpack(parameters)) + velocity, z)
        value.backward()
        return value

    with torch_threads(cores() if len(z) > PARALLEL_FROM else 1):
        optimiser.step(objective)
    found = parameters.detach() if bool(torch.isfinite(parameters).all()) else begin
    factor, sizes = _unpack(found)
    covariance = _resolved(of_field(factor, sizes).numpy(), velocity.numpy()) * (root @ factor @ factor.T @ root.T).numpy()
    covariance += PRIOR.component_floor * np.trace(covariance) / np.trace(shape) * shape
    return Kernel(covariance, *(float(value) for value in sizes))


def _resolved(field: np.ndarray, velocity: np.ndarray) -> float:
    """Factor >= 1 on the variance of the field, so that the clip can distinguish a field of this size from none.

    Args:
        field, velocity: (k, k) contributions of the field and of the initial velocity to the covariance of z, in units of the noise.
    """
    size, axes = eigh(velocity)  # the largest is far beyond the noise, so rounding may make the smallest negative
    axes /= np.sqrt(1.0 + np.maximum(size, 0.0))
    shown = np.maximum(eigh(axes.T @ field @ axes, eigvals_only=True), 0.0)
    if not shown.any():
        return 1.0

    def short(log_factor: float) -> float:
        return UNTOLD - 0.5 * float(np.log1p(math.exp(log_factor) * shown).sum())

    # With this factor, the most visible direction would be enough by itself.
    most = math.log(math.expm1(2.0 * UNTOLD) / shown.max())
    return math.exp(brentq(short, 0.0, most)) if most > 0.0 and short(0.0) > 0.0 else 1.0


def _informative_directions(prior: Prior, normal: np.ndarray, pull: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    """R (k, n) and z (k,), restricted to the directions in which the prior variance is not small compared with the noise."""
    floor = SMALLEST * float(normal.diagonal().max())
    root = torch.linalg.cholesky(torch.from_numpy(normal + floor * np.eye(len(normal))))
    z = torch.linalg.solve_triangular(root, torch.from_numpy(pull)[:, None], upper=False)[:, 0]
    R, size = root.T.numpy(), len(normal) - len(prior.velocity)
    field = R[:, :size] @ np.kron(prior.places.covariance(prior.kernel), prior.kernel.covariance) @ R[:, :size].T
    signal, turn = torch.linalg.eigh(torch.from_numpy(field + (R[:, size:] * prior.velocity**2) @ R[:, size:].T))
    informative = turn[:, signal > INFORMATIVE].T
    return informative @ root.T, informative @ z


def _pack(kernel: Kernel, root: np.ndarray) -> torch.Tensor:
    """The parameters: log L, log tau, log u, log w; then of the factor A in C = root A A' root' the log diagonal, and the rest over it."""
    factor = np.linalg.solve(root, np.linalg.cholesky(kernel.covariance))
    diagonal = np.diag(factor)
    below = (factor / diagonal)[np.tril_indices(3, -1)]
    sizes = [kernel.length, kernel.duration, kernel.uniform, kernel.slope]
    return torch.from_numpy(np.concatenate([np.log(sizes), np.log(diagonal), below]))


def _unpack(parameters: torch.Tensor) -> tuple[torch.Tensor, tuple[torch.Tensor, ...]]:
    """The factor A (3, 3), and L, tau, u, w, from the parameters."""
    count = len(HYPERPRIORS)
    sizes = torch.exp(parameters[: count + 3].clamp(-LOG_LIMIT, LOG_LIMIT))
    below = torch.zeros(3, 3, dtype=parameters.dtype).index_put(tuple(torch.tril_indices(3, 3, -1)), parameters[count + 3 :])
    factor = (torch.eye(3, dtype=parameters.dtype) + below) @ torch.diag(sizes[count:])
    return factor, sizes[:count].unbind()


def _penalty(parameters: torch.Tensor) -> torch.Tensor:
    """Negative log hyperprior. It keeps the shape of C near root root' and leaves its scale free."""
    total = torch.zeros((), dtype=parameters.dtype)
    for value, (median, spread) in zip(parameters, HYPERPRIORS.values()):
        total = total + 0.5 * ((value - math.log(median)) / spread) ** 2
    diagonal, below = parameters[len(HYPERPRIORS) :].split((3, 3))
    return total + 0.5 * (((diagonal - diagonal.mean()) ** 2).sum() + (below**2).sum()) / PRIOR.component_spread**2


class _LogEvidence(torch.autograd.Function):
    """Log density of z (n,) under N(0, S), without the constant. The derivative by S is computed as (S^-1 z z' S^-1 - S^-1) / 2, at the
    cost of one inverse; automatic differentiation of the individual steps would cost several."""

    @staticmethod
    def forward(context: Any, S: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
        factor = torch.linalg.cholesky(S)
        inverse = torch.cholesky_inverse(factor)
        solved = torch.cholesky_solve(z[:, None], factor)[:, 0]
        context.save_for_backward(inverse, solved)
        return -torch.log(torch.diagonal(factor)).sum() - 0.5 * (z @ solved)

    @staticmethod
    def backward(context: Any, *gradients: Any) -> Any:
        inverse, solved = context.saved_tensors
        return 0.5 * gradients[0] * (torch.outer(solved, solved) - inverse), None


def log_evidence(covariance: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    """Log density of z (k,) under N(0, I + `covariance` (k, k)), without the constant; differentiable."""
    # A line search may try variances so large that the unit matrix is lost in rounding.
    floor = 1.0 + ROUNDING * torch.diagonal(covariance).mean()
    value: torch.Tensor = _LogEvidence.apply(covariance + floor * torch.eye(len(z), dtype=z.dtype), z)
    return value


def mismatch_scale(prior: Prior, objective: Objective, point: Linearisation) -> float:
    """The one of `MISMATCH_SCALES` with the greatest evidence.

    Args:
        prior: the prior with learnt hyperparameters.
        objective: the objective that whitened the residuals of `point`.
    """
    raw = objective.unwhitened(np.concatenate([point.jacobian, (point.jacobian.T @ point.theta - point.residual)[None]]))
    precision = prior.precision()

    @cache
    def evidence(index: int) -> float:
        other = objective.mismatched(MISMATCH_SCALES[index])
        white = other.whiten(raw).astype(np.float64)
        jacobian, data = white[:-1], white[-1]
        pull = torch.from_numpy(jacobian @ data)
        factor = torch.linalg.cholesky(torch.from_numpy(precision + jacobian @ jacobian.T))
        explained = float(pull @ torch.cholesky_solve(pull[:, None], factor)[:, 0])
        volume = float(torch.log(torch.diagonal(factor)).sum()) - other.log_volume
        return 0.5 * (explained - float(data @ data)) - volume

    best = max(range(0, len(MISMATCH_SCALES), COARSE_STRIDE), key=evidence)
    while True:  # climb from the best of the few that were tried
        better = max((index for index in (best - 1, best, best + 1) if 0 <= index < len(MISMATCH_SCALES)), key=evidence)
        if better == best:
            return MISMATCH_SCALES[best]
        best = better


def linearised_evidence(point: Linearisation, precision: np.ndarray) -> float:
    """Log evidence of the data under a prior (Laplace's approximation), without the constant and the volume of the whitening."""
    data = point.jacobian.T @ point.theta - point.residual
    pull = point.jacobian @ data
    total = cho_factor(point.normal + precision, lower=True)
    volume = np.log(np.diag(total[0])).sum() - 0.5 * np.linalg.slogdet(precision)[1]
    return float(0.5 * (pull @ cho_solve(total, pull) - data @ data) - volume)


def prefer_belief(belief: Prior, other: Prior, point: Linearisation, odds: float = PRIOR.stretch_log_odds) -> Prior:
    """The prior `belief`, unless the evidence at `point` favours `other` by more than the log odds `odds`."""
    pull, evidence = point.pull, []
    for prior in (belief, other):
        precision = prior.precision()
        total = precision + point.normal
        volume = np.linalg.slogdet(precision)[1] - np.linalg.slogdet(total)[1]
        evidence.append(0.5 * float(volume + pull @ np.linalg.solve(total, pull)))
    return belief if evidence[0] > evidence[1] - odds else other
