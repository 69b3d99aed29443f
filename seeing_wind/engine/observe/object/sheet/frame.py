"""The shape of a sheet in one frame: the vertices that match what the cameras saw, keep the sheet's lengths and continue its motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix, identity

from .banded import Banded
from .mesh import SheetMesh
from .template import LOOSEST, TIGHTEST, Allowed, Template
from .view import OUTLIER, View

HELD = 1e-3
"""Standard deviation of a held vertex from its place, in units of the mean edge."""
STEPS = 30
"""Largest number of Gauss-Newton steps in a frame."""
FAR, NARROWED = 0.99, 0.6
"""Fraction of the tracks within the outlier threshold at a frame's start, and the factor by which it shrinks in each step, so that a corner
which appears from behind a fold, far from its expected place, is pulled in (graduated non-convexity, Blake and Zisserman 1987)."""
DAMPING = (1e-4, 1.0)
"""Least and largest Levenberg damping, in units of the Hessian's mean diagonal."""
SETTLED = 3e-3
"""Relative decrease of the cost below which the steps end."""
PROBES = 24
"""Number of random vectors that estimate the uncertainty."""


@dataclass(frozen=True)
class Prior:
    """The Gaussian prior of a frame's vertices that the rest of the path gives."""

    x: np.ndarray
    """(V, 3) mean [m]."""
    precision: csr_matrix
    """(3V, 3V) [1/m²]."""

    def cost(self, x: np.ndarray) -> float:
        """Negative log probability of vertices at x (V, 3) [m], up to a constant."""
        off = (x - self.x).ravel()
        return 0.5 * float(off @ (self.precision @ off))


class FrameSolver:
    """Solves for a sheet's vertices in single frames of T+1."""

    def __init__(self, mesh: SheetMesh, views: Sequence[View]) -> None:
        self.mesh, self.views = mesh, views
        self.template, self._banded = Template(mesh), Banded(mesh.flat)
        self.allowed = [LOOSEST] * len(views[0].sight.xy)
        """Per frame, what its shape is allowed."""
        held = np.repeat(np.where(mesh.pinned, 1.0 / (HELD * mesh.spacing) ** 2, 0.0), 3)
        self._held, self._identity = csr_matrix((held, (np.arange(held.size),) * 2)), identity(held.size, format="csr")

    def prior(self, frame: int, x: np.ndarray, precision: float) -> Prior:
        """The prior round x (V, 3) [m] with that precision [1/m²] of a coordinate, and round x's bends: unseen parts keep their shape."""
        return Prior(x, precision * self._identity + self.template.bends / self.allowed[frame].curvature**2)

    def best(self, frame: int, starts: Sequence[np.ndarray], prior: Prior) -> np.ndarray:
        """The vertices (V, 3) [m] that match the frame best, of the solutions from several starts (V, 3).

        The motion does not take part in the choice: while other frames are wrong, it is on their side.
        """
        solutions = [self.solve(frame, start, prior) for start in starts]
        return min(solutions, key=lambda x: self._seen(frame, x, OUTLIER) + self.template.cost(x, self.allowed[frame]))

    def solve(self, frame: int, start: np.ndarray, prior: Prior) -> np.ndarray:
        """Vertices (V, 3) [m] of a frame that minimise the cost, from the start (V, 3)."""
        x, damping, wide = start, 0.0, self._widest(frame, start)
        for _ in range(STEPS):
            scale, wide = max(wide, self.outlier(frame, x)), NARROWED * wide
            cost = self._cost(frame, x, prior, scale)
            hessian, gradient = self.linearise(frame, x, prior, scale)
            size = float(hessian.diagonal().mean())
            while True:
                step = self.solve_linear(hessian + damping * size * self._identity, -gradient).reshape(-1, 3)
                new = self._cost(frame, x + step, prior, scale)
                if new <= cost:
                    break
                damping = max(10.0 * damping, DAMPING[0])
                if damping > DAMPING[1]:
                    return x
            x, damping = x + step, 0.1 * damping if damping > DAMPING[0] else 0.0
            if cost - new < SETTLED * cost and wide < scale:
                break
        return x

    def learn(self, frame: int, x: np.ndarray, prior: Prior) -> float:
        """Set what a frame's shape is allowed from its solution x (V, 3) [m]; return the new curvature over the old one.

        If the curvature were left too large, noise would crumple the sheet, which then seems shorter, and so nearer to the camera. This is
        a step of expectation maximisation: the mean square of the bends is that of the solution plus, estimated with random signs, that of
        its uncertainty.
        """
        bends, before, signs = self.template.bends, self.allowed[frame], random_signs(frame, x.size)
        hessian = self.linearise(frame, x, prior, self.outlier(frame, x))[0]
        unknown = float(((bends @ signs) * self.solve_linear(hessian, signs)).sum()) / PROBES
        curvature = math.sqrt((float(x.ravel() @ (bends @ x.ravel())) + unknown) / len(self.template.hinges))
        self.allowed[frame] = Allowed(curvature, self.template.shortening(x)).within(TIGHTEST, LOOSEST)
        return self.allowed[frame].curvature / before.curvature

    def _cost(self, frame: int, x: np.ndarray, prior: Prior, scale: float) -> float:
        held = 0.5 * float(((x - self.mesh.x).ravel() ** 2 * self._held.diagonal()).sum())
        return self._seen(frame, x, scale) + self.template.cost(x, self.allowed[frame]) + prior.cost(x) + held

    def _seen(self, frame: int, x: np.ndarray, scale: float) -> float:
        return sum(view.cost(frame, x, scale) for view in self.views)

    def outlier(self, frame: int, x: np.ndarray) -> float:
        """The residual from which a track is an outlier [standard deviations]."""
        missed = np.concatenate([view.missed(frame, x) for view in self.views])
        return max(OUTLIER, 2.0 * float(np.median(missed)) if missed.size else 0.0)

    def _widest(self, frame: int, x: np.ndarray) -> float:
        """The same at a start, where the sheet is not yet in its place and many residuals may be large: hardly any track is an outlier."""
        missed = np.concatenate([view.missed(frame, x) for view in self.views])
        return float(np.quantile(missed, FAR)) if missed.size else OUTLIER

    def solve_linear(self, hessian: csr_matrix, right: np.ndarray) -> np.ndarray:
        """The solution (3V,) or (3V, K) of a Gauss-Newton system."""
        return self._banded.solve(hessian, right)

    def linearise(self, frame: int, x: np.ndarray, prior: Prior, scale: float) -> tuple[csr_matrix, np.ndarray]:
        """Gauss-Newton Hessian (3V, 3V) and gradient (3V,) of the cost."""
        hessian, gradient = self.template.linearise(x, self.allowed[frame])
        hessian, gradient = hessian + self._held, gradient + self._held @ (x - self.mesh.x).ravel()
        for view in self.views:
            own, slope = view.linearise(frame, x, scale)
            hessian, gradient = hessian + own, gradient + slope
        return hessian + prior.precision, gradient + prior.precision @ (x - prior.x).ravel()


def random_signs(frame: int, size: int) -> np.ndarray:
    """(size, PROBES) random signs, always the same for a frame."""
    return np.random.default_rng(frame).choice([-1.0, 1.0], (size, PROBES))
