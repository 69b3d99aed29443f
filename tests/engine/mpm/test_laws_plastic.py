"""Plastic flow against closed forms: yield surface, volume, relaxation, steady flow, limits."""

from __future__ import annotations

import numpy as np
import pytest

from tests.engine.mpm.law_kernels import deformations, delicate, flow, rotations, stress, stretched
from tests.reference import mpm as twin

MU, LAM = 3.0, 5.0
DT = 1e-3


def overstress(F, yield_stress):
    """|dev tau| - sqrt(2/3) Y, (n,)."""
    tau = stress("von_mises", F, (MU, LAM))
    deviator = tau - np.trace(tau, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    return np.linalg.norm(deviator, axis=(1, 2)) - np.sqrt(2 / 3) * yield_stress


def tension(strain):
    """Incompressible tension, (3, 3); |dev tau| = sqrt(2/3) 3 MU strain."""
    return np.diag(np.exp(strain * np.array([1.0, -0.5, -0.5])))


def test_a_bar_yields_at_the_yield_stress():
    # Tension with free sides at stress Y has the deviator diag(2, -1, -1) Y / 3, of norm sqrt(2/3) Y.
    Y = 0.4
    at_yield = Y / (3 * MU)
    below, above = tension(0.999 * at_yield)[None], tension(1.5 * at_yield)[None]
    assert np.array_equal(flow("von_mises", below, (MU, Y, 0.0, DT)), below)
    tau = stress("von_mises", flow("von_mises", above, (MU, Y, 0.0, DT)), (MU, LAM))[0]
    assert np.isclose(tau[0, 0] - tau[1, 1], Y, rtol=1e-12)
    assert np.isclose(overstress(flow("von_mises", above, (MU, Y, 0.0, DT)), Y)[0], 0.0, atol=1e-13)


@pytest.mark.parametrize("yield_stress", [1e-3, 0.2, 1.0])
def test_flow_ends_on_the_yield_surface_and_keeps_volume_and_axes(yield_stress):
    rng = np.random.default_rng(0)
    F = np.concatenate([deformations(rng, 30), delicate(rng), stretched(rng, (3.0, 1.0, 0.3)), stretched(rng, (4.0, 0.5, 0.5))])
    after = flow("von_mises", F, (MU, yield_stress, 0.0, DT))
    yields = overstress(F, yield_stress) > 0
    assert yields.any()
    assert np.allclose(overstress(after[yields], yield_stress), 0.0, atol=2e-12)
    assert np.array_equal(after[~yields], F[~yields])
    assert np.allclose(np.linalg.det(after), np.linalg.det(F), rtol=1e-13)
    flowed, elastic = after[yields], F[yields]
    left = flowed @ np.linalg.inv(elastic)  # F = M F_trial with M symmetric, of the same axes as F F^T
    B = elastic @ elastic.swapaxes(1, 2)
    assert np.allclose(left, left.swapaxes(1, 2), atol=1e-13)
    assert np.allclose(left @ B, B @ left, atol=1e-12)


@pytest.mark.parametrize("law, viscosity", [("von_mises", 0.0), ("viscoplastic", 0.02)])
@pytest.mark.parametrize("real, tolerance", [(np.float64, 3e-14), (np.float32, 5e-6)])
def test_flow_matches_its_twin(law, viscosity, real, tolerance):
    rng = np.random.default_rng(3)
    F = np.concatenate(
        [deformations(rng, 40), deformations(rng, 20, 0.08), stretched(rng, (1.2, 1.2, 0.8)), stretched(rng, (2.5, 0.9, 0.6))]
    )
    F = F.astype(real)
    want = np.stack([twin.return_mapping(f, MU, 0.5, viscosity, DT) for f in F.astype(np.float64)])
    assert np.abs(flow(law, F, (MU, 0.5, viscosity, DT), real) - want).max() < tolerance * np.abs(want).max()


@pytest.mark.parametrize("law", ["corotated", "neo_hookean"])
def test_nothing_flows_under_an_elastic_law(law):
    F = deformations(np.random.default_rng(6), 40)
    assert np.array_equal(flow(law, F, (MU, 0.5, 0.002, DT)), F)


def test_overstress_relaxes_at_the_rate_mu_over_viscosity():
    # Held at a fixed deformation: d|s|/dt = -2 mu d_p = -(mu / eta) (|s| - sqrt(2/3) Y).
    Y, viscosity, steps = 0.4, 0.6, 400
    F = stretched(np.random.default_rng(1), (1.3, 1.0, 0.8), 1)
    before = overstress(F, Y)[0]
    assert before > 0.1
    for _ in range(steps):
        F = flow("viscoplastic", F, (MU, Y, viscosity, DT))
    decay = MU / viscosity * DT
    assert np.isclose(overstress(F, Y)[0], before * (1 + decay) ** -steps, rtol=1e-10)  # backward Euler, exactly
    assert np.isclose(overstress(F, Y)[0], before * np.exp(-MU / viscosity * DT * steps), rtol=decay * decay * steps)


def test_steady_flow_carries_binghams_overstress():
    # Pulled at a constant rate D, |s| = sqrt(2/3) Y + 2 eta |D| once the elastic strain stands still.
    Y, viscosity, rate, dt = 0.3, 0.05, 2.0, 1e-4
    Q = rotations(np.random.default_rng(2), 1)[0]
    D = rate * Q @ np.diag([1.0, -0.5, -0.5]) @ Q.T
    grow = Q @ np.diag(np.exp(dt * rate * np.array([1.0, -0.5, -0.5]))) @ Q.T
    F = np.eye(3)[None]
    for _ in range(3000):
        F = flow("viscoplastic", grow @ F, (MU, Y, viscosity, dt))
    assert np.isclose(overstress(F, Y)[0], 2 * viscosity * np.linalg.norm(D), rtol=1e-6)


def test_viscosity_goes_over_into_von_mises_and_into_elasticity():
    F = deformations(np.random.default_rng(4))
    rigid = flow("von_mises", F, (MU, 0.5, 0.0, DT))
    assert np.array_equal(flow("viscoplastic", F, (MU, 0.5, 0.0, DT)), rigid)
    gaps = [np.abs(flow("viscoplastic", F, (MU, 0.5, eta, DT)) - rigid).max() for eta in (1e-5, 1e-7, 1e-9)]
    assert gaps[0] > 50 * gaps[1] > 2500 * gaps[2] > 0  # first order in the viscosity
    assert np.allclose(flow("viscoplastic", F, (MU, 0.5, 1e9, DT)), F, atol=1e-8)
    # The viscosity of a material whose law has none plays no part.
    assert np.array_equal(flow("von_mises", F, (MU, 0.5, 7.0, DT)), rigid)
