"""The elastic laws and the Hencky stress against closed forms, their energies and their twins."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.mpm.laws.constitutive import LAWS
from tests.engine.mpm.law_kernels import deformations, delicate, rotations, stress, stress_both_ways, stretched
from tests.reference import mpm as twin

MU, LAM = 3.0, 5.0
MATERIAL = (MU, LAM)
STRESSES = ("corotated", "neo_hookean", "von_mises")
"""One law for each stress: the viscoplastic one has that of von Mises."""


@pytest.mark.parametrize(
    "law, along, across",
    [
        ("corotated", lambda s: 2 * MU * (s - 1) * s + LAM * s * (s - 1), lambda s: LAM * s * (s - 1)),
        ("neo_hookean", lambda s: MU * (s**2 - 1) + LAM * np.log(s), lambda s: LAM * np.log(s)),
        ("von_mises", lambda s: (2 * MU + LAM) * np.log(s), lambda s: LAM * np.log(s)),
    ],
)
def test_uniaxial_stretch(law, along, across):
    for s in (0.4, 0.7, 0.95, 1.0, 1.02, 1.4, 2.5):
        assert np.allclose(stress(law, [np.diag([s, 1.0, 1.0])], MATERIAL)[0], np.diag([along(s), across(s), across(s)]), atol=1e-12)


@pytest.mark.parametrize(
    "law, pressure",
    [
        ("corotated", lambda s: 2 * MU * (s - 1) * s + LAM * s**3 * (s**3 - 1)),
        ("neo_hookean", lambda s: MU * (s**2 - 1) + 3 * LAM * np.log(s)),
        ("von_mises", lambda s: (2 * MU + 3 * LAM) * np.log(s)),
    ],
)
def test_hydrostatic_compression_and_expansion(law, pressure):
    for s in (0.5, 0.8, 0.99, 1.3):
        assert np.allclose(stress(law, [s * np.eye(3)], MATERIAL)[0], pressure(s) * np.eye(3), atol=1e-12)


@pytest.mark.parametrize("g", [0.01, 0.3, 0.6, 2.0])
def test_simple_shear(g):
    F = np.array([[1.0, g, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.allclose(stress("neo_hookean", [F], MATERIAL)[0], MU * np.array([[g * g, g, 0], [g, 0, 0], [0, 0, 0]]), atol=1e-12)
    angle = np.arctan(g / 2)  # the rotation of simple shear
    R = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    assert np.allclose(stress("corotated", [F], MATERIAL)[0], 2 * MU * (F - R) @ F.T, atol=1e-12)
    # The principal Hencky strains are +-arsinh(g/2), on axes with tan(2 angle) = 2/g.
    along = 2 * MU * np.arcsinh(g / 2) / np.hypot(g, 2) * np.array([[g, 2, 0], [2, -g, 0], [0, 0, 0]])
    assert np.allclose(stress("von_mises", [F], MATERIAL)[0], along, atol=1e-12)


@pytest.mark.parametrize("law", STRESSES)
def test_small_strain_is_linear_elasticity(law):
    rng = np.random.default_rng(7)
    gradient = 1e-7 * rng.normal(size=(8, 3, 3))
    strain = 0.5 * (gradient + gradient.swapaxes(1, 2))
    linear = 2 * MU * strain + LAM * np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    assert np.allclose(stress(law, np.eye(3) + gradient, MATERIAL), linear, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_stress_is_the_derivative_of_the_energy(law):
    F = np.concatenate([deformations(np.random.default_rng(1)), stretched(np.random.default_rng(2), (1.2, 1.2, 0.9))])
    tau, h = stress(law, F, MATERIAL), 1e-6
    for p in range(len(F)):
        P = np.empty((3, 3))
        for i, j in np.ndindex(3, 3):
            step = np.zeros((3, 3))
            step[i, j] = h
            P[i, j] = (twin.energy(law, F[p] + step, MU, LAM) - twin.energy(law, F[p] - step, MU, LAM)) / (2 * h)
        assert np.allclose(tau[p], P @ F[p].T, atol=1e-7)


@pytest.mark.parametrize("law", STRESSES)
def test_stress_turns_with_the_body_and_is_symmetric(law):
    rng = np.random.default_rng(3)
    F, Q = deformations(rng), rotations(rng, 1)[0]
    tau = stress(law, F, MATERIAL)
    assert np.allclose(stress(law, Q @ F, MATERIAL), Q @ tau @ Q.T, atol=1e-11)
    assert np.allclose(stress(law, F @ Q, MATERIAL), tau, atol=1e-11)  # isotropic
    assert np.array_equal(tau, tau.swapaxes(1, 2))


@pytest.mark.parametrize("law", STRESSES)
@pytest.mark.parametrize("real, tolerance", [(np.float64, 3e-13), (np.float32, 1e-5)])
def test_every_delicate_deformation_matches_the_twin(law, real, tolerance):
    rng = np.random.default_rng(4)
    large = [stretched(rng, s) for s in ((2.0, 1.0, 0.5), (3.0, 0.8, 0.8), (1.5, 1.5, 0.4))]
    F = np.concatenate([delicate(rng), deformations(rng, 50), deformations(rng, 20, 0.03), *large]).astype(real)
    want = np.stack([twin.kirchhoff(law, f, MU, LAM) for f in F.astype(np.float64)])
    assert np.abs(stress(law, F, MATERIAL, real) - want).max() < tolerance * max(1.0, np.abs(want).max())


@pytest.mark.parametrize("law", STRESSES)
@pytest.mark.parametrize("real, tolerance", [(np.float64, 1e-12), (np.float32, 1e-5)])
def test_the_stress_found_beside_its_adjoint_is_the_same(law, real, tolerance):
    rng = np.random.default_rng(5)
    F = np.concatenate([deformations(rng, 200), delicate(rng)]).astype(real)
    tau = stress(law, F, MATERIAL)
    found = stress_both_ways(law, F, MATERIAL, np.ones_like(F), real)[0]
    assert (np.abs(found - tau).max(axis=(1, 2)) < tolerance * (1.0 + np.abs(tau).max(axis=(1, 2)))).all()


