"""The damped dense solve."""


import numpy as np

from seeing_wind.engine.recovery.solve.gauss_newton import Linearisation, solve


def test_gauss_newton_finds_the_minimum_of_a_curved_problem_and_steps_round_breakdowns():
    precision, truth = np.eye(2), np.array([1.2, 0.7])

    def values(theta):
        return np.stack([theta[:, 0] + theta[:, 1] ** 3, np.exp(theta[:, 0]) - theta[:, 1], 3 * theta[:, 1]], axis=1)

    observed = values(truth[None])[0]

    def residuals(theta):
        out = 100.0 * (values(theta) - observed)
        out[theta[:, 0] > 2.0] = np.inf  # as a simulation that bursts
        return out

    def linearise(theta):
        step = 1e-6
        base = residuals(theta[None])[0]
        return Linearisation.at(theta, base, np.stack([(residuals((theta + step * e)[None])[0] - base) / step for e in np.eye(2)]))

    found = solve(np.zeros(2), np.zeros(2), precision, residuals, linearise, 20)
    np.testing.assert_allclose(found.theta, truth, atol=2e-3)
    assert found.converged and found.iterations < 20
