"""The prior of the field: a Gaussian process over the places and times that the body passes.

    cov(a(x, t), a(x', t')) = C  (u + w y.y' + exp(-|x - x'|² / 2 L²)) / (1 + u + w)  (c + M(|t - t'| / tau)) / (1 + c)

with M the Matérn-5/2 function and y the position relative to the body's centre, in body radii: a uniform, a linear and a nonlinear part
with variances of their own. Without the linear part, a squeeze, which has no net force, would need a large and smooth field, and so a
large net force, which the fit would then take from the noise. x is a position in the world, not on the body: a gust has its shape in the
air, and a body that turns or travels meets the same gust with another part of itself. A gradient measured while the body lies across it
is therefore known when the body has turned along it, where a stiff body hides it. The unknowns of the solve are modes on the body; their
covariance is this one, evaluated along a nearby simulation. The hyperparameters C, L, tau, u, w are learnt from the clip (`evidence`).
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
"""Variance added to every mode, relative to the mean one, so that the inverse exists."""


@dataclass(frozen=True)
class Kernel:
    """The hyperparameters."""

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
    """(M, S): values at sample particles -> modes."""
    squared: np.ndarray
    """(K, S, K, S) squared distances over the body's radius squared."""
    aligned: np.ndarray
    """(K, S, K, S) y.y', products of places as seen from the body's centre at their time, over the body's radius squared."""
    at: np.ndarray
    """(K,) times of the knots [frames]."""

    @staticmethod
    def along(basis: SpatialBasis, path: np.ndarray, at: np.ndarray) -> Places:
        """From the particles' path (T+1, N, 3) [m] in a simulation near the truth, with knots at the times `at` (K,) [frames]."""
        count = min(len(basis.phi), max(40, SAMPLES_PER_MODE * basis.phi.shape[1]))
        some = farthest_points(path[0], count)
        x = path[np.minimum(np.rint(at).astype(int), len(path) - 1)] / basis.radius
        y = (x - x.mean(axis=1, keepdims=True))[:, some].reshape(-1, 3)
        x = (x[:, some] - x.mean(axis=(0, 1))).reshape(-1, 3)
        squared = np.maximum((x**2).sum(axis=1)[:, None] + (x**2).sum(axis=1)[None, :] - 2.0 * x @ x.T, 0.0)
        shape = (len(at), count, len(at), count)
        return Places(np.linalg.pinv(basis.phi[some]), squared.reshape(shape), (y @ y.T).reshape(shape), at)

    def covariance(self, kernel: Kernel) -> np.ndarray:
        """(K M, K M) correlation of the modes at the knots; the components' covariance C is apart."""
        sizes = (torch.tensor(size, dtype=torch.float64) for size in (kernel.length, kernel.duration, kernel.uniform, kernel.slope))
        return self.correlation(*sizes).numpy()

    def correlation(self, length: torch.Tensor, duration: torch.Tensor, uniform: torch.Tensor, slope: torch.Tensor) -> torch.Tensor:
        """`covariance`, differentiable in the sizes."""
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
    """What a force (T, 3) at the times `at` (T,) [frames] tells of its part that is constant in time: its mean under the prior."""
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
    """(V,) standard deviation of the initial velocities [m/s]."""
    stretch: np.ndarray | None = None
    """(knots modes 3,) squared: precision against fields that only stretch the body, see `stretch`; None believes nothing of them."""

    @property
    def count(self) -> int:
        """Number of unknowns: coefficients and initial velocities."""
        return 3 * len(self.places.at) * len(self.places.project) + len(self.velocity)

    def deviation(self) -> np.ndarray:
        """(n,) standard deviations of the unknowns, leaving `stretch` out."""
        modes = np.diag(self.places.covariance(self.kernel))
        field = np.sqrt(np.outer(modes, np.diag(self.kernel.covariance)))
        return np.concatenate([field.ravel(), self.velocity])

    def precision(self) -> np.ndarray:
        """Inverse covariance of all unknowns, (n, n)."""
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
        """The same beliefs, and that the field turns a body x (N, 3) deformed by F (T+1, N, 3, 3) rather than stretches it.

        `volume_only`: or at least that it does not swell it.
        """
        rows = stretch_rows(basis, x, F, self.places.at, volume_only)
        count = len(self.places.at)
        modes = self.places.covariance(self.kernel).reshape(count, len(self.places.project), count, -1)
        space = np.einsum("kmkn->kmn", modes)
        time = over_time(self.places.at, torch.tensor(self.kernel.duration, dtype=torch.float64)).numpy()
        extra = stretch_precision(rows, time, space, self.kernel.covariance, share)
        return replace(self, stretch=extra if self.stretch is None else self.stretch + extra)


def knots_for_variance(kernel: Kernel, basis: SpatialBasis, path: np.ndarray, most: float, share: float) -> float:
    """Frames between knots: `most`, or half of it as often as it takes until straight lines between them miss at most `share` of the
    variance that the modes of a body on this path (T+1, N, 3) [m] have. What turns or travels fast feels a steady field change fast."""
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
    """How many of the first modes hold all but `share` of the variance that the field has over the body x (N, 3) [m]."""
    variance = np.diag(Places.along(basis, np.stack([x, x]), np.zeros(1)).covariance(kernel))[: basis.phi.shape[1]]
    beyond = variance.sum() - np.cumsum(variance)
    return int(np.argmax(beyond <= share * variance.sum())) + 1
