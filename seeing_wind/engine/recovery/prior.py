"""What is believed of the field before the clip is seen: a Gaussian over the coefficients, smooth in time and in space.

    cov(c) = time (knots) x space (modes, one variance per polynomial degree) x component (3 x 3, trace 3)

The sizes are learnt from the clip itself by expectation maximisation on the linearised problem: a fixed isotropic prior shrinks the force
along directions that the motion does not show (stiff in-plane stretch) towards zero, wrongly once the body has turned.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .basis import SpatialBasis, knots
from .stretch import stretch_precision, stretch_rows

TAU = 8.0
"""Correlation time of the Matérn part [frames]; 16 ruins a gusty scene."""
CONSTANT_SHARE = 0.5
"""Variance of the part that never changes, relative to the changing part's."""
LENGTH = 2.0
"""Correlation length over the body's radius before anything is learnt; degree d starts with a size of LENGTH**-d."""
COMPONENT_FLOOR = 0.02
"""Added to the learnt component covariance (trace 3) so that no direction is ruled out."""
STEEPEST = 2.0
"""Largest variance of a degree relative to the uniform part's; a field with waves shorter than the body measures about that."""
DIVERGENCE, STRETCH = 0.2, 0.1
"""Standard deviation of the field's divergence, and under one camera of its whole symmetric gradient, relative to what the rest of the
prior implies."""
EM_ITERATIONS = 20


@dataclass(frozen=True)
class Prior:
    """Zero-mean Gaussian over coefficients c (knots, modes, 3) [m/s²] and initial velocities (V,) [m/s]."""

    time: np.ndarray
    """(knots, knots) covariance over time, unit variance."""
    degree: np.ndarray
    """(modes,) degree of each mode: modes of one degree share their scale."""
    shape: np.ndarray
    """(modes,) variance of each mode relative to its degree's scale."""
    scale: np.ndarray
    """(degrees,) variance per degree [m²/s⁴]."""
    component: np.ndarray
    """(3, 3) covariance of the force's components, trace 3."""
    velocity: np.ndarray
    """(V,) standard deviation of the initial velocities [m/s]."""
    stretch: np.ndarray | None = None
    """(knots modes 3,) squared: precision against fields that only stretch the body, see `stretch`; None believes nothing of them.

    It does not follow the sizes while these are learnt: what it holds down would make them look small, and they it, without end."""

    @property
    def space(self) -> np.ndarray:
        """(modes,) variance of each mode [m²/s⁴]."""
        return self.shape * self.scale[self.degree]

    @property
    def count(self) -> int:
        """Number of unknowns: coefficients and initial velocities."""
        return len(self.time) * len(self.degree) * 3 + len(self.velocity)

    def deviation(self) -> np.ndarray:
        """(n,) standard deviations of the unknowns."""
        field = np.einsum("k,m,i->kmi", np.ones(len(self.time)), np.sqrt(self.space), np.sqrt(np.diag(self.component)))
        return np.concatenate([field.ravel(), self.velocity])

    def precision(self) -> np.ndarray:
        """Inverse covariance of all unknowns, (n, n)."""
        field = np.kron(np.linalg.inv(self.time), np.kron(np.diag(1.0 / self.space), np.linalg.inv(self.component)))
        if self.stretch is not None:
            field = field + self.stretch
        full = np.zeros((self.count, self.count))
        full[: len(field), : len(field)] = field
        full[range(len(field), self.count), range(len(field), self.count)] = 1.0 / self.velocity**2
        return full

    def learnt(self, mean: np.ndarray, covariance: np.ndarray, component: bool = True) -> Prior:
        """One maximisation step: the scales and the component covariance that fit a posterior best.

        Args:
            mean: (n,) posterior mean of the unknowns.
            covariance: (n, n) posterior covariance.
            component: False keeps the component covariance as it is.
        """
        number, modes = len(self.time), len(self.degree)
        size = number * modes * 3
        second = covariance[:size, :size] + np.outer(mean[:size], mean[:size])
        moments = second.reshape(number, modes, 3, number, modes, 3)
        over_time = np.einsum("kl,kmilmj->mij", np.linalg.inv(self.time), moments) / number  # (modes, 3, 3)
        new = self.component
        if component:
            new = np.einsum("mij,m->ij", over_time, 1.0 / self.space) / modes
            new = 3.0 * new / np.trace(new) + COMPONENT_FLOOR * np.eye(3)
            new *= 3.0 / np.trace(new)
        energy = np.einsum("mij,ji->m", over_time, np.linalg.inv(new)) / 3.0
        scale = self.scale.copy()
        for order in np.unique(self.degree):
            mine = self.degree == order
            scale[order] = np.mean(energy[mine] / self.shape[mine])
        # No degree is ruled out for good (a variance of zero would stay zero), and none outgrows a field of short waves: stiff stretch
        # is invisible, so what the model cannot explain would otherwise be explained by ever larger forces that only stretch.
        scale = np.clip(scale, 1e-6 * scale.max(), STEEPEST * scale[0])
        return replace(self, scale=scale, component=new)

    def turning(self, basis: SpatialBasis, x: np.ndarray, F: np.ndarray, spacing: float, one_camera: bool) -> Prior:
        """The same beliefs, and that the field turns a body x (N, 3) deformed by F (T+1, N, 3, 3) rather than stretches it."""
        rows = stretch_rows(basis, x, F, spacing, divergence_only=not one_camera)
        share = STRETCH if one_camera else DIVERGENCE
        return replace(self, stretch=stretch_precision(rows, self.time, self.space, self.component, share))

    def reshaped(self, basis: SpatialBasis, frames: int, spacing: float) -> Prior:
        """The same beliefs for other modes and knots; degrees that were not there continue the fall of the last two."""
        scale = self.scale[np.unique(self.degree)]
        fall = min(1.0, scale[-1] / scale[-2]) if len(scale) > 1 else LENGTH**-2
        needed = int(basis.degree.max()) + 1
        extended = list(scale[:needed])
        while len(extended) < needed:
            extended.append(extended[-1] * fall)
        time = time_covariance(frames, spacing)
        return replace(self, time=time, degree=basis.degree, shape=basis.size**2, scale=np.array(extended), stretch=None)


def time_covariance(frames: int, spacing: float) -> np.ndarray:
    """Constant plus Matérn-5/2 over the knots, unit variance, (knots, knots)."""
    at = knots(frames, spacing)
    lag = np.sqrt(5.0) * np.abs(at[:, None] - at[None, :]) / TAU
    matern = (1.0 + lag + lag**2 / 3.0) * np.exp(-lag)
    return (CONSTANT_SHARE + matern) / (1.0 + CONSTANT_SHARE) + 1e-9 * np.eye(len(at))


def first_prior(basis: SpatialBasis, frames: int, spacing: float, size: float, velocities: int, speed: float | np.ndarray = 1.0) -> Prior:
    """The prior before anything is learnt: `size` is the field's expected root mean square [m/s²], `speed` the initial velocity's [m/s]."""
    scale = size**2 * LENGTH ** (-2.0 * np.arange(int(basis.degree.max()) + 1))
    speeds = np.resize(speed, velocities).astype(float)
    return Prior(time_covariance(frames, spacing), basis.degree, basis.size**2, scale, np.eye(3), speeds)


def learn(
    prior: Prior, normal: np.ndarray, pull: np.ndarray, iterations: int = EM_ITERATIONS, component: bool = True
) -> tuple[Prior, np.ndarray]:
    """Expectation maximisation on the linearised problem.

    Args:
        prior: where to start.
        normal: (n, n) J'J of the whitened residuals.
        pull: (n,) J'(J theta - r) at the linearisation point theta, so that the posterior mean solves (normal + precision) mean = pull.

    Returns:
        The prior learnt and the posterior mean (n,) under it.
    """
    for _ in range(iterations):
        covariance = np.linalg.inv(normal + prior.precision())
        prior = prior.learnt(covariance @ pull, covariance, component)
    return prior, np.linalg.solve(normal + prior.precision(), pull)
