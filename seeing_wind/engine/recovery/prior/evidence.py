"""Hyperparameters of the prior by type-II maximum likelihood on the linearised problem.

With unknowns ~ N(0, K), K the prior's covariance, and whitened residuals linear in them, J'J = R'R and z = R^-T J'(J theta - r), z is
N(0, I + R K R'), so

    -2 log evidence = log |I + R K R'| + z' (I + R K R')^-1 z + constant

(MacKay 1992, "Bayesian interpolation"; Rasmussen and Williams 2006, section 5.4.1). Weak hyperpriors
keep the hyperparameters finite where the clip does not determine them. The force's size has none, and of a body that does not move it
would go to zero: it stops where the clip no longer tells it from zero (`_resolved`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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
COARSE_STRIDE = 3
"""Every so many of the mismatch factors are tried first, then those near the best."""
PARALLEL_FROM = 250
"""Number of data directions above which torch uses all cores; below, starting the threads costs more than it saves."""
INFORMATIVE = 1e-4
"""Directions of the whitened data to which the prior gives less variance than this, relative to the noise, are left out."""
UNTOLD = 1.0
"""Nats of evidence that a force of the size learnt loses against none where a clip shows none, at least: a smaller one it could not tell
from none, so it is no reason to say that the force is known better."""
SMALLEST = 1e-12
"""Added to the diagonal of J'J, relative to its largest entry, as J'J is singular where the data do not separate unknowns."""


def maximise_evidence(
    prior: Prior, normal: np.ndarray, pull: np.ndarray, component: np.ndarray | None = None, check: Callable[[], None] = lambda: None
) -> Kernel:
    """The hyperparameters of greatest evidence, by L-BFGS.

    Args:
        prior: the starting point. Its stretch penalty is ignored: it would shrink the sizes, and smaller sizes would strengthen it.
        normal: (n, n) J'J of the whitened residuals.
        pull: (n,) J'(J theta - r) at the linearisation point theta.
        component: (3, 3) expected shape of the covariance of the force's components; None for isotropic.
        check: called at every evaluation; may raise to cancel.
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
        """(k, k) what the field adds to the covariance of z."""
        correlation = prior.places.correlation(*sizes)
        turned = (by_component @ (root @ factor)).unbind(dim=2)
        return reduce(torch.add, (part @ correlation @ part.T for part in turned))

    def objective() -> torch.Tensor:
        """Penalty minus the logarithm of the evidence, with its derivative."""
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
    """Factor >= 1 on the variance of a field with which the clip tells it from none.

    Args:
        field, velocity: (k, k) what the field and the initial velocity add to the covariance of z, noise being 1.
    """
    size, axes = eigh(velocity)  # the largest is far beyond the noise, so rounding may make the smallest negative
    axes /= np.sqrt(1.0 + np.maximum(size, 0.0))
    shown = np.maximum(eigh(axes.T @ field @ axes, eigvals_only=True), 0.0)
    if not shown.any():
        return 1.0

    def short(log_factor: float) -> float:
        return UNTOLD - 0.5 * float(np.log1p(math.exp(log_factor) * shown).sum())

    # With this factor, the direction that shows most would do alone.
    most = math.log(math.expm1(2.0 * UNTOLD) / shown.max())
    return math.exp(brentq(short, 0.0, most)) if most > 0.0 and short(0.0) > 0.0 else 1.0


def _informative_directions(prior: Prior, normal: np.ndarray, pull: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    """R (k, n) and z (k,), restricted to the directions in which the prior is not small against the noise."""
    floor = SMALLEST * float(normal.diagonal().max())
    root = torch.linalg.cholesky(torch.from_numpy(normal + floor * np.eye(len(normal))))
    z = torch.linalg.solve_triangular(root, torch.from_numpy(pull)[:, None], upper=False)[:, 0]
    R, size = root.T.numpy(), len(normal) - len(prior.velocity)
    field = R[:, :size] @ np.kron(prior.places.covariance(prior.kernel), prior.kernel.covariance) @ R[:, :size].T
    signal, turn = torch.linalg.eigh(torch.from_numpy(field + (R[:, size:] * prior.velocity**2) @ R[:, size:].T))
    informative = turn[:, signal > INFORMATIVE].T
    return informative @ root.T, informative @ z


def _pack(kernel: Kernel, root: np.ndarray) -> torch.Tensor:
    """log L, log tau, log u, log w, and of the factor A of C = root A A' root' the logarithms of its diagonal, then the rest over it."""
    factor = np.linalg.solve(root, np.linalg.cholesky(kernel.covariance))
    diagonal = np.diag(factor)
    below = (factor / diagonal)[np.tril_indices(3, -1)]
    sizes = [kernel.length, kernel.duration, kernel.uniform, kernel.slope]
    return torch.from_numpy(np.concatenate([np.log(sizes), np.log(diagonal), below]))


def _unpack(parameters: torch.Tensor) -> tuple[torch.Tensor, tuple[torch.Tensor, ...]]:
    """A, and L, tau, u, w."""
    count = len(HYPERPRIORS)
    sizes = torch.exp(parameters[: count + 3].clamp(-LOG_LIMIT, LOG_LIMIT))
    below = torch.zeros(3, 3, dtype=parameters.dtype).index_put(tuple(torch.tril_indices(3, 3, -1)), parameters[count + 3 :])
    factor = (torch.eye(3, dtype=parameters.dtype) + below) @ torch.diag(sizes[count:])
    return factor, sizes[:count].unbind()


def _penalty(parameters: torch.Tensor) -> torch.Tensor:
    """Negative log hyperprior. Of C it constrains the shape, root root', but not the scale."""
    total = torch.zeros((), dtype=parameters.dtype)
    for value, (median, spread) in zip(parameters, HYPERPRIORS.values()):
        total = total + 0.5 * ((value - math.log(median)) / spread) ** 2
    diagonal, below = parameters[len(HYPERPRIORS) :].split((3, 3))
    return total + 0.5 * (((diagonal - diagonal.mean()) ** 2).sum() + (below**2).sum()) / PRIOR.component_spread**2


class _LogEvidence(torch.autograd.Function):
    """Of z (n,) under N(0, S), without the constant. Its derivative by S, (S^-1 z z' S^-1 - S^-1) / 2, costs one inverse; that of the
    steps on the way, which automatic differentiation would take, several."""

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
    # A line search may try sizes so large that the unit matrix is lost in rounding.
    floor = 1.0 + ROUNDING * torch.diagonal(covariance).mean()
    value: torch.Tensor = _LogEvidence.apply(covariance + floor * torch.eye(len(z), dtype=z.dtype), z)
    return value


def mismatch_scale(prior: Prior, objective: Objective, point: Linearisation, scales: Sequence[float]) -> float:
    """The factor on the mismatch's standard deviation that has the greatest evidence.

    Args:
        prior: with its hyperparameters learnt.
        objective: that whitened the residuals of `point`.
        scales: factors to choose from, in order.
    """
    raw = objective.unwhitened(np.concatenate([point.jacobian, (point.jacobian.T @ point.theta - point.residual)[None]]))
    precision = prior.precision()

    @cache
    def evidence(index: int) -> float:
        other = objective.mismatched(scales[index])
        white = other.whiten(raw).astype(np.float64)
        jacobian, data = white[:-1], white[-1]
        pull = torch.from_numpy(jacobian @ data)
        factor = torch.linalg.cholesky(torch.from_numpy(precision + jacobian @ jacobian.T))
        explained = float(pull @ torch.cholesky_solve(pull[:, None], factor)[:, 0])
        volume = float(torch.log(torch.diagonal(factor)).sum()) - other.log_volume
        return 0.5 * (explained - float(data @ data)) - volume

    best = max(range(0, len(scales), COARSE_STRIDE), key=evidence)
    while True:  # uphill from the best of a few
        better = max((index for index in (best - 1, best, best + 1) if 0 <= index < len(scales)), key=evidence)
        if better == best:
            return scales[best]
        best = better


def linearised_evidence(point: Linearisation, precision: np.ndarray) -> float:
    """Logarithm of the evidence of the data under a prior (Laplace's approximation), but for their constant and the whitening's volume."""
    data = point.jacobian.T @ point.theta - point.residual
    pull = point.jacobian @ data
    total = cho_factor(point.normal + precision, lower=True)
    volume = np.log(np.diag(total[0])).sum() - 0.5 * np.linalg.slogdet(precision)[1]
    return float(0.5 * (pull @ cho_solve(total, pull) - data @ data) - volume)


def prefer_belief(belief: Prior, other: Prior, point: Linearisation, odds: float = PRIOR.stretch_log_odds) -> Prior:
    """`belief`, unless the evidence at `point` favours the other prior by more than the log odds `odds`."""
    pull, evidence = point.pull, []
    for prior in (belief, other):
        precision = prior.precision()
        total = precision + point.normal
        volume = np.linalg.slogdet(precision)[1] - np.linalg.slogdet(total)[1]
        evidence.append(0.5 * float(volume + pull @ np.linalg.solve(total, pull)))
    return belief if evidence[0] > evidence[1] - odds else other
