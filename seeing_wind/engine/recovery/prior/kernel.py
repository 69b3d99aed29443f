"""The prior of the field: a Gaussian process over the places and times that the body passes.

    cov(a(x, t), a(x', t')) = C  (u + w y.y' + exp(-|x - x'|² / 2 L²)) / (1 + u + w)  (c + M(|t - t'| / tau)) / (1 + c)

with M the Matérn-5/2 function and y the position relative to the body's centre, in body radii: a uniform, a linear and a nonlinear part
with variances of their own. Without the linear part, a squeeze, which has no net force, would require a large and smooth field and thus
allow a large net force, which would then be fitted to the noise. x is a position in the world, not on the body: a gust has its shape in
the air, and a body that turns or travels meets the same gust with another part of itself. A gradient that was measured while the body lay
in one direction is therefore still known after the body has turned to a direction in which its stiffness hides the gradient. The unknowns
of the solve are modes on the body; their covariance is this one, evaluated along a nearby simulation. The hyperparameters C, L, tau, u, w
are learnt from the clip (`evidence`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch

from ...field.confidence import farthest_points
from .basis import SpatialBasis, hats
from .constants import PRIOR
from .stretch import stretch_precision, stretch_rows

SAMPLES_PER_MODE = 3
JITTER = 1e-8
"""Variance that is added to each mode, relative to the mean variance, so that the inverse exists."""


@dataclass(frozen=True)
class Kernel:
    """The hyperparameters of the prior."""

    covariance: np.ndarray
    """C (3, 3) [m²/s⁴]."""
    length: float = PRIOR.length
    """L in body radii."""
    duration: float = PRIOR.duration
    """tau [frames]."""
    uniform: float = PRIOR.uniform
    """u: variance of the uniform part, relative to the nonlinear part."""
    slope: float = PRIOR.slope
    """w: variance of the linear part one body radius from the centre, relative to the nonlinear part."""


@dataclass(frozen=True)
class Places:
    """World positions of sample particles at each knot, from which the covariance of the modes follows."""

    project: np.ndarray
    """(M, S) matrix from values at the sample particles to modes."""
    squared: np.ndarray
    """(K, S, K, S) squared distances [squared body radii]."""
    aligned: np.ndarray
    """(K, S, K, S) products y.y' of positions relative to the body's centre at their time [squared body radii]."""
    at: np.ndarray
    """(K,) times of the knots [frames]."""

    @staticmethod
    def along(basis: SpatialBasis, path: np.ndarray, at: np.ndarray) -> Places:
        """The places on the particles' path (T+1, N, 3) [m] in a simulation near the truth, at the knots' times `at` (K,) [frames]."""
        count = min(len(basis.phi), max(40, SAMPLES_PER_MODE * basis.phi.shape[1]))
        some = farthest_points(path[0], count)
        x = path[np.minimum(np.rint(at).astype(int), len(path) - 1)] / basis.radius
        y = (x - x.mean(axis=1, keepdims=True))[:, some].reshape(-1, 3)
        x = (x[:, some] - x.mean(axis=(0, 1))).reshape(-1, 3)
        squared = np.maximum((x**2).sum(axis=1)[:, None] + (x**2).sum(axis=1)[None, :] - 2.0 * x @ x.T, 0.0)
        shape = (len(at), count, len(at), count)
        return Places(np.linalg.pinv(basis.phi[some]), squared.reshape(shape), (y @ y.T).reshape(shape), at)

    def covariance(self, kernel: Kernel) -> np.ndarray:
        """Covariance (K M, K M) of the modes at the knots, for one component of unit variance; C is not included."""
        sizes = (torch.tensor(size, dtype=torch.float64) for size in (kernel.length, kernel.duration, kernel.uniform, kernel.slope))
        return self.correlation(*sizes).numpy()

    def correlation(self, length: torch.Tensor, duration: torch.Tensor, uniform: torch.Tensor, slope: torch.Tensor) -> torch.Tensor:
        """`covariance`, differentiable by the hyperparameters."""
        project, modes = torch.from_numpy(self.project), len(self.at) * len(self.project)
        bending = torch.exp(-0.5 * torch.from_numpy(self.squared) / length**2)
        in_space = (uniform + slope * torch.from_numpy(self.aligned) + bending) / (1.0 + uniform + slope)
        both = in_space * over_time(self.at, duration)[:, None, :, None]
        matrix = torch.einsum("ms,ksln->kmln", project, both @ project.T).reshape(modes, modes)
        return 0.5 * (matrix + matrix.T) + JITTER * torch.trace(matrix) / modes * torch.eye(modes, dtype=torch.float64)


def over_time(at: np.ndarray, duration: torch.Tensor) -> torch.Tensor:
    """Correlation (K, K) of the field at the times `at` (K,) [frames]."""
    lag = math.sqrt(5.0) * torch.from_numpy(np.abs(at[:, None] - at[None, :])) / duration
    return (PRIOR.steady + (1.0 + lag + lag**2 / 3.0) * torch.exp(-lag)) / (1.0 + PRIOR.steady)


def steady_part(force: np.ndarray, at: np.ndarray, duration: float) -> np.ndarray:
    """Posterior mean (3,) of the part of a force (T, 3) that is constant in time, under the prior; at: (T,) times of the force [frames]."""
    if not len(at):
        return np.zeros(force.shape[1])
    together = over_time(at, torch.tensor(duration, dtype=torch.float64)).numpy() + JITTER * np.eye(len(at))
    constant = np.full(len(at), PRIOR.steady / (1.0 + PRIOR.steady))
    return constant @ np.linalg.solve(together, force)


@dataclass(frozen=True)
class Prior:
    """Zero-mean Gaussian over coefficients c (knots, modes, 3) [m/s²] and initial velocities (V,) [m/s]."""

    kernel: Kernel
    places: Places
    velocity: np.ndarray
    """(V,) standard deviations of the initial velocities [m/s]."""
    stretch: np.ndarray | None = None
    """(n, n), n = knots modes 3: precision that penalises fields which only stretch the body, see `stretch`; None for no penalty."""

    @property
    def count(self) -> int:
        """Number of unknowns: coefficients and initial velocities."""
        return 3 * len(self.places.at) * len(self.places.project) + len(self.velocity)

    def deviation(self) -> np.ndarray:
        """(n,) standard deviations of all unknowns, without the effect of `stretch`."""
        modes = np.diag(self.places.covariance(self.kernel))
        field = np.sqrt(np.outer(modes, np.diag(self.kernel.covariance)))
        return np.concatenate([field.ravel(), self.velocity])

    def precision(self) -> np.ndarray:
        """(n, n) inverse covariance of all unknowns."""
        field = np.kron(np.linalg.inv(self.places.covariance(self.kernel)), np.linalg.inv(self.kernel.covariance))
        if self.stretch is not None:
            field = field + self.stretch
        full = np.zeros((self.count, self.count))
        full[: len(field), : len(field)] = field
        full[range(len(field), self.count), range(len(field), self.count)] = 1.0 / self.velocity**2
        return full

    def with_stretch_penalty(
        self, basis: SpatialBasis, x: np.ndarray, F: np.ndarray, share: float, volume_only: bool = False
    ) -> Prior:
        """The same prior with a penalty on stretching a body with rest positions x (N, 3) [m] and deformation gradients F (T+1, N, 3, 3).

        share: standard deviation that the stretch keeps, relative to that without the penalty; volume_only: only changes of volume.
        """
        rows = stretch_rows(basis, x, F, self.places.at, volume_only)
        count = len(self.places.at)
        modes = self.places.covariance(self.kernel).reshape(count, len(self.places.project), count, -1)
        space = np.einsum("kmkn->kmn", modes)
        time = over_time(self.places.at, torch.tensor(self.kernel.duration, dtype=torch.float64)).numpy()
        extra = stretch_precision(rows, time, space, self.kernel.covariance, share)
        return replace(self, stretch=extra if self.stretch is None else self.stretch + extra)


def knots_for_variance(kernel: Kernel, basis: SpatialBasis, path: np.ndarray, most: float, share: float) -> float:
    """Frames between knots: `most`, halved until straight lines between knots miss at most `share` of the variance that the modes have on
    a body with this path (T+1, N, 3) [m]. A body that turns or travels fast feels quick changes even in a steady field."""
    count, modes, spacing = len(path), basis.phi.shape[1], most
    together = Places.along(basis, path, np.arange(count)).covariance(kernel).reshape(count, modes, count, modes)
    variance = np.einsum("kmlm->kl", together)
    while spacing > 1.0:
        at = np.arange(0, count, int(spacing))
        missed = np.eye(at[-1] + 1)
        missed[:, at] -= hats(len(missed), spacing)
        seen = variance[: len(missed), : len(missed)]
        if np.trace(missed @ seen @ missed.T) <= share * np.trace(seen):
            break
        spacing *= 0.5
    return max(1.0, spacing)


def modes_for_variance(kernel: Kernel, basis: SpatialBasis, x: np.ndarray, share: float) -> int:
    """How many of the first modes contain all but `share` of the field's variance over the body x (N, 3) [m]."""
    variance = np.diag(Places.along(basis, np.stack([x, x]), np.zeros(1)).covariance(kernel))[: basis.phi.shape[1]]
    beyond = variance.sum() - np.cumsum(variance)
    return int(np.argmax(beyond <= share * variance.sum())) + 1
