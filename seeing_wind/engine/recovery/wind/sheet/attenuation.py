"""How much errors in a filmed sheet's path weaken the fitted wind, and the factor on the forces that corrects for it.

On a path x + e with errors e, the forces of the air are F(x + e). They differ from the true F(x) by errors that hardly correlate with F(x),
since normals and velocities are wrong in either direction. A least-squares fit of forces with such errors is attenuated: the wind comes out
too weak (errors in variables). With the reliability ratio (Fuller 1987, Measurement Error Models, section 1.1)

    lambda = F² / (F² + E (F(x + e) - F(x))²)

the expected true force is lambda F(x + e) (regression calibration: Carroll et al. 2006, Measurement Error in Nonlinear Models, chapter 4),
and the balance of forces is compared with that. The ratio is estimated by adding random errors to the followed path. As the forces on that
path already contain its own errors, F² is overestimated, and the correction is a little too small.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....records import Measured
from .balance import Moments
from .observed import Observed
from .problem import SheetProblem

LASTS = 2.3
"""Correlation length [frames] of the errors of a followed path, for a Matern 3/2 kernel: correlations of 0.83, 0.56, 0.34 and 0.20 at lags
of 1 to 4 frames. Measured means over five filmed flags and three falling sheets: 0.79, 0.54, 0.35 and 0.23 (docs/notebook/wind.md)."""
DRAWS = 4
"""Number of random errors of the path; each is used with both signs."""


def reliability_of(problem: SheetProblem, theta: np.ndarray, seen: Observed) -> float:
    """Reliability ratio lambda at the unknowns theta (n,), between 0 and 1.

    It is 1 for points in 3D, whose errors are small, and for forces that do not depend on the path.
    """
    if seen.measured is None:
        return 1.0
    forces = problem.forces_on(problem.balance.at, theta)
    size, error = float((forces**2).mean()), 0.0
    for drawn in _path_errors(seen.measured, np.random.default_rng(0)):
        problem.check()
        for sign in (1.0, -1.0):
            moved = np.where(seen.pinned[:, None], seen.x, seen.x + sign * problem.noise * drawn)
            off = problem.forces_on(Moments.of(replace(seen, x=moved)), theta) - forces
            error += float((off**2).mean()) / (2 * DRAWS)
    return size / (size + error) if error else 1.0


def _path_errors(measured: Measured, random: np.random.Generator) -> np.ndarray:
    """Random errors (`DRAWS`, T+1, V, 3) [m] of a path, with each frame's stated covariance, but correlated in time.

    The factor on the stated errors is learnt from second differences in time (`balance`), as if errors were independent from frame to
    frame. Errors that are correlated in time have to be larger to give the same second differences.
    """
    count, modes = len(measured.x), measured.modes.shape[1]
    lag = np.sqrt(3.0) * np.abs(np.subtract.outer(np.arange(count), np.arange(count))) / LASTS
    correlation = (1.0 + lag) * np.exp(-lag)
    larger = np.sqrt(6.0 / (6.0 - 8.0 * correlation[0, 1] + 2.0 * correlation[0, 2]))
    in_time = np.linalg.cholesky(correlation + 1e-9 * np.eye(count))
    roots = np.stack([_root(one.reshape(3 * modes, 3 * modes)) for one in measured.covariance])
    draws = in_time @ random.standard_normal((DRAWS, count, 3 * modes))
    coefficients = larger * np.einsum("tij,dtj->dti", roots, draws).reshape(DRAWS, count, modes, 3)
    return np.einsum("vr,dtri->dtvi", measured.modes, coefficients)


def _root(covariance: np.ndarray) -> np.ndarray:
    """A matrix R with R R^T = covariance (N, N), which may be singular."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return vectors * np.sqrt(np.maximum(values, 0.0))
