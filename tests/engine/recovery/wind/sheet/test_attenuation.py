"""The effect of errors in a followed path on the forces of the air and on the fitted wind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.materials import Sheet
from seeing_wind.engine.mpm.shell import shell_of
from seeing_wind.engine.records import Measured
from seeing_wind.engine.recovery.prior.basis import hats, spatial_basis
from seeing_wind.engine.recovery.wind.sheet.air import Air, Push
from seeing_wind.engine.recovery.wind.sheet.attenuation import reliability_of
from seeing_wind.engine.recovery.wind.sheet.balance import Moments, balance_of
from seeing_wind.engine.recovery.wind.sheet.observed import observe_sheet
from seeing_wind.engine.recovery.wind.sheet.problem import SheetProblem
from tests.engine.recovery.wind.blown_sheet import AREAL, FPS, GRAVITY, THICKNESS, E, mesh

FRAMES, WIND = 30, np.array([4.0, 0.5, 0.0])


def flag():
    """A flag in FRAMES + 1 frames, with waves of 4 cm that run along its length, and its shell."""
    rest, faces = mesh(12, 4)
    held = rest[:, 0] < 1e-9
    time = np.arange(FRAMES + 1)[:, None] / FPS
    path = np.repeat(rest[None], FRAMES + 1, axis=0)
    path[..., 1] = 0.04 * (rest[:, 0] / 0.8) * np.sin(8.0 * rest[:, 0] + 2.0 * rest[:, 2] - 9.0 * time)
    shell = shell_of(rest, faces, Sheet(AREAL, THICKNESS, E * THICKNESS, E * THICKNESS**3 / 12.0, 0.1), pinned=held)
    return path, observe_sheet(path, shell.surface.faces, held, FPS, 1e-4), shell


def problem_of(shell, seen, cause):
    basis = spatial_basis(seen.rest, shell.mass * ~shell.pinned, 6)
    return SheetProblem(balance_of(shell, seen, GRAVITY), cause, basis, hats(FRAMES, 1.0), np.eye(1))


def steady(problem):
    """The unknowns theta for the steady wind WIND."""
    return np.concatenate([np.zeros(problem.unknowns - 3), WIND])


def lasting_errors(rest, size, random):
    """Errors (T+1, V, 3) [m] in waves over the sheet, correlated over a few frames; the waves (V, R); and the variance of independent
    errors with the same second differences."""
    along, across = np.pi * rest[:, 0] / 1.6, np.pi * rest[:, 2] / 0.5
    waves = np.stack([np.sin(k * along) * np.cos(m * across) for k in (1, 3, 5) for m in (0, 1)], axis=1)
    lag = np.sqrt(3.0) * np.abs(np.subtract.outer(np.arange(FRAMES + 1), np.arange(FRAMES + 1))) / 2.3
    in_time = size * np.linalg.cholesky((1.0 + lag) * np.exp(-lag) + 1e-10 * np.eye(FRAMES + 1))
    draw = (in_time @ random.standard_normal((FRAMES + 1, 3 * waves.shape[1]))).reshape(FRAMES + 1, -1, 3)
    one = in_time @ in_time.T
    return np.einsum("vr,tri->tvi", waves, draw), waves, (6.0 * one[0, 0] - 8.0 * one[0, 1] + 2.0 * one[0, 2]) / 6.0


def stated(seen, waves, variance):
    """What is seen, with errors of that variance in each of the waves, independent from frame to frame."""
    count = 3 * waves.shape[1]
    covariance = np.broadcast_to(variance * np.eye(count), (FRAMES + 1, count, count)).reshape(FRAMES + 1, count // 3, 3, count // 3, 3)
    return replace(seen, measured=Measured(seen.x, waves, covariance))


@pytest.mark.parametrize("size", [0.007, 0.012])
def test_the_factor_is_what_errors_do_to_a_fit(size):
    """It is the slope of a least-squares fit of the true forces to those on paths with errors. It is measured on these paths, whose forces
    are larger than the true ones, and so corrects a little too little."""
    path, exact, shell = flag()
    problem = problem_of(shell, exact, Air(shell))
    theta = steady(problem)
    true = problem.forces(theta)
    slopes, factors = [], []
    for seed in range(8):
        error, waves, variance = lasting_errors(exact.rest, size, np.random.default_rng(100 + seed))
        seen = stated(replace(exact, x=path + np.where(exact.pinned[:, None], 0.0, error)), waves, variance)
        forces = problem.forces_on(Moments.of(seen), theta)
        slopes.append((true * forces).sum() / (forces**2).sum())
        factors.append(reliability_of(replace(problem, balance=replace(problem.balance, at=Moments.of(seen))), theta, seen))
    assert np.mean(slopes) < 0.88
    assert -0.02 < np.mean(factors) - np.mean(slopes) < 0.11


def test_points_and_plain_forces_are_not_attenuated():
    """Points in 3D have no covariance from a camera, and a force of its own does not depend on where the sheet is."""
    _, exact, shell = flag()
    problem = problem_of(shell, exact, Air(shell))
    assert reliability_of(problem, steady(problem), exact) == 1.0
    _, waves, variance = lasting_errors(exact.rest, 0.01, np.random.default_rng(0))
    seen = stated(exact, waves, variance)
    assert reliability_of(problem, steady(problem), seen) < 0.9
    push = problem_of(shell, exact, Push(shell))
    assert reliability_of(push, steady(push), seen) == 1.0


def test_forces_and_their_derivative_have_the_factor():
    _, exact, shell = flag()
    problem = problem_of(shell, exact, Air(shell))
    theta, way = steady(problem), np.random.default_rng(1).standard_normal(problem.unknowns)
    half = replace(problem.before(theta), reliability=0.5)
    np.testing.assert_allclose(half.forces(theta), 0.5 * problem.forces(theta))
    slope = (half.residual(theta + 1e-5 * way) - half.residual(theta - 1e-5 * way)) / 2e-5
    np.testing.assert_allclose(way @ half.linearise(theta).jacobian, slope, atol=1e-6 * np.abs(slope).max())
