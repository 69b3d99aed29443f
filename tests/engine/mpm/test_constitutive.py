"""The laws against closed forms, their energies, and finite differences. No postponed annotations: Taichi reads them."""

import numpy as np
import pytest
import taichi as ti

from seeing_wind.engine.mpm import device
from seeing_wind.engine.mpm.constitutive import ELASTIC_LAWS, LAWS, kirchhoff, kirchhoff_adjoint
from seeing_wind.engine.mpm.plasticity import plastic_flow
from tests.reference import mpm as twin

MU, LAM = 3.0, 5.0
matrices = ti.types.ndarray(dtype=ti.types.matrix(3, 3, ti.f64), ndim=1)


@ti.kernel
def stresses(law: ti.i32, mu: ti.f64, lam: ti.f64, F: matrices, tau_out: matrices):
    for p in range(F.shape[0]):
        tau_out[p] = kirchhoff(True, law, F[p], mu, lam)


@ti.kernel
def adjoints(law: ti.i32, mu: ti.f64, lam: ti.f64, F: matrices, tau_bar: matrices, F_bar_out: matrices):
    for p in range(F.shape[0]):
        F_bar_out[p] = kirchhoff_adjoint(law, F[p], mu, lam, tau_bar[p])


@ti.kernel
def flows(law: ti.i32, mu: ti.f64, yield_stress: ti.f64, viscosity: ti.f64, dt: ti.f64, F: matrices, F_out: matrices):
    for p in range(F.shape[0]):
        F_out[p] = plastic_flow(law, F[p], mu, yield_stress, viscosity, dt)


def stress(law, F):
    device.start()
    F = np.atleast_3d(F).reshape(-1, 3, 3).astype(float)
    out = np.empty_like(F)
    stresses(LAWS[law], MU, LAM, np.ascontiguousarray(F), out)
    return out


def flow(law, F, yield_stress, viscosity=0.0, dt=1e-3):
    device.start()
    F = np.ascontiguousarray(F.reshape(-1, 3, 3))
    out = np.empty_like(F)
    flows(LAWS[law], MU, yield_stress, viscosity, dt, F, out)
    return out


def rotation(rng):
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


def deformations(rng, count=12, size=0.25):
    """Rotated random stretches."""
    return np.stack([rotation(rng) @ (np.eye(3) + size * rng.uniform(-1, 1, size=(3, 3))) for _ in range(count)])


@pytest.mark.parametrize(
    "law, along, across",
    [
        ("corotated", lambda s: 2 * MU * (s - 1) * s + LAM * s * (s - 1), lambda s: LAM * s * (s - 1)),
        ("neo_hookean", lambda s: MU * (s**2 - 1) + LAM * np.log(s), lambda s: LAM * np.log(s)),
        ("von_mises", lambda s: (2 * MU + LAM) * np.log(s), lambda s: LAM * np.log(s)),
    ],
)
def test_uniaxial_stretch(law, along, across):
    for s in (0.7, 1.0, 1.4):
        assert np.allclose(stress(law, np.diag([s, 1.0, 1.0]))[0], np.diag([along(s), across(s), across(s)]), atol=1e-12)


@pytest.mark.parametrize(
    "law, pressure",
    [
        ("corotated", lambda s: 2 * MU * (s - 1) * s + LAM * s**3 * (s**3 - 1)),
        ("neo_hookean", lambda s: MU * (s**2 - 1) + 3 * LAM * np.log(s)),
        ("von_mises", lambda s: (2 * MU + 3 * LAM) * np.log(s)),
    ],
)
def test_hydrostatic_stretch(law, pressure):
    for s in (0.8, 1.3):
        assert np.allclose(stress(law, s * np.eye(3))[0], pressure(s) * np.eye(3), atol=1e-12)


def test_simple_shear():
    g = 0.6
    F = np.array([[1.0, g, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.allclose(stress("neo_hookean", F)[0], MU * np.array([[g * g, g, 0], [g, 0, 0], [0, 0, 0]]), atol=1e-12)
    angle = np.arctan(g / 2)  # the rotation of simple shear
    R = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    assert np.allclose(stress("corotated", F)[0], 2 * MU * (F - R) @ F.T, atol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_stress_is_the_derivative_of_the_energy_and_turns_with_the_body(law):
    rng = np.random.default_rng(1)
    F = deformations(rng)
    tau, h = stress(law, F), 1e-6
    for p in range(len(F)):
        P = np.empty((3, 3))
        for i, j in np.ndindex(3, 3):
            step = np.zeros((3, 3))
            step[i, j] = h
            P[i, j] = (twin.energy(law, F[p] + step, MU, LAM) - twin.energy(law, F[p] - step, MU, LAM)) / (2 * h)
        assert np.allclose(tau[p], P @ F[p].T, atol=1e-7)
    Q = rotation(rng)
    assert np.allclose(stress(law, Q @ F), Q @ tau @ Q.T, atol=1e-11)


@pytest.mark.parametrize("law", ELASTIC_LAWS)
def test_adjoint_matches_finite_differences(law):
    rng = np.random.default_rng(2)
    special = [np.eye(3), np.diag([1.2, 1.2, 0.9]), 0.8 * np.eye(3), rotation(rng)]
    F = np.concatenate([np.stack(special), deformations(rng)])
    tau_bar, out = rng.normal(size=F.shape), np.empty_like(F)
    adjoints(LAWS[law], MU, LAM, F, tau_bar, out)
    for _ in range(5):
        direction = rng.normal(size=F.shape)
        h = 1e-6
        numeric = ((stress(law, F + h * direction) - stress(law, F - h * direction)) * tau_bar).sum((1, 2)) / (2 * h)
        assert np.allclose((out * direction).sum((1, 2)), numeric, rtol=1e-6, atol=1e-7)


def test_von_mises_yields_at_the_yield_stress():
    # Tension with free sides yields at Y: the deviator of diag(Y, 0, 0) has the norm sqrt(2/3) Y.
    Y = 0.4
    strain = Y / (2 * MU)  # of the deviator: diag(2, -1, -1) / 3 * strain
    below, above = (np.diag(np.exp(k * strain * np.array([2, -1, -1]) / 3)) for k in (0.999, 1.5))
    assert np.array_equal(flow("von_mises", below, Y)[0], below)
    tau = stress("von_mises", flow("von_mises", above, Y))[0]
    assert np.isclose(np.linalg.norm(tau - np.trace(tau) / 3 * np.eye(3)), np.sqrt(2 / 3) * Y, rtol=1e-12)
    assert np.isclose(tau[0, 0] - tau[1, 1], Y, rtol=1e-12)


def test_plastic_flow_matches_its_twin_and_keeps_the_volume():
    rng = np.random.default_rng(3)
    F = np.concatenate([deformations(rng), np.stack([np.diag([1.2, 1.2, 0.8]), rotation(rng) @ np.diag([1.3, 0.9, 0.9])])])
    for law, viscosity in (("von_mises", 0.0), ("viscoplastic", 0.02)):
        got = flow(law, F, 0.5, viscosity)
        want = np.stack([twin.return_mapping(f, MU, 0.5, viscosity, 1e-3) for f in F])
        assert np.allclose(got, want, atol=1e-12)
        assert np.allclose(np.linalg.det(got), np.linalg.det(F), rtol=1e-12)


def test_viscosity_goes_over_into_von_mises_and_into_elasticity():
    F = deformations(np.random.default_rng(4))
    assert np.allclose(flow("viscoplastic", F, 0.5, viscosity=1e-12), flow("von_mises", F, 0.5), atol=1e-8)
    assert np.allclose(flow("viscoplastic", F, 0.5, viscosity=1e9), F, atol=1e-8)
