"""Adjoints of the laws against finite differences in double precision: every law, every input, every delicate point."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from seeing_wind.engine.conventions import lame
from seeing_wind.engine.mpm.laws.constitutive import LAWS
from tests.engine.mpm.law_kernels import deformations, delicate, flow, flow_adjoint, rotations, stress, stress_adjoint, stretched

MU, LAM = 3.0, 5.0
PLASTIC = ("von_mises", "viscoplastic")


def central(function, h):
    """f'(0), of fourth order."""
    return (8 * (function(h) - function(-h)) - function(2 * h) + function(-2 * h)) / (12 * h)


def one_sided(function, h):
    """f'(0) from values at 0, h, 2h, 3h, 4h, of fourth order."""
    return (-25 * function(0.0) + 48 * function(h) - 36 * function(2 * h) + 16 * function(3 * h) - 3 * function(4 * h)) / (12 * h)


def agree(found, numeric, scale):
    """Each to 1e-6 of the derivative, or of `scale` where the derivative happens to be small."""
    assert (np.abs(found - numeric) <= 1e-6 * np.maximum(np.abs(numeric), scale)).all(), np.abs((found - numeric) / scale).max()


@pytest.mark.parametrize("law", LAWS)
def test_stress_in_every_input(law):
    rng = np.random.default_rng(0)
    F = np.concatenate([delicate(rng), deformations(rng, 40), deformations(rng, 20, 0.05), stretched(rng, (3.0, 1.0, 0.4))])
    material, tau_bar = np.tile([MU, LAM], (len(F), 1)), rng.normal(size=F.shape)
    F_bar, material_bar = stress_adjoint(law, F, material, tau_bar)
    size = np.linalg.norm(F_bar, axis=(1, 2))
    for _ in range(4):
        direction = rng.normal(size=F.shape)

        def along(h, direction=direction):
            return (stress(law, F + h * direction, material) * tau_bar).sum((1, 2))

        agree((F_bar * direction).sum((1, 2)), central(along, 1e-3 if law == "neo_hookean" else 3e-4), 0.1 * size)
    for k in range(2):
        step = np.eye(2)[k]

        def with_material(h, step=step):
            return (stress(law, F, material + h * step) * tau_bar).sum((1, 2))

        agree(material_bar[:, k], central(with_material, 0.1), 1e-6)


@pytest.mark.parametrize("law", PLASTIC)
@pytest.mark.parametrize("yield_stress", [0.02, 0.5])
def test_flow_in_every_input(law, yield_stress):
    rng = np.random.default_rng(1)
    # Clear of yield by more than the steps below reach; at yield itself see the next test.
    F = np.concatenate([delicate(rng), deformations(rng, 60), stretched(rng, (2.0, 1.0, 0.5))])
    strain = np.log(np.linalg.svd(F, compute_uv=False))
    trial = 2 * MU * np.linalg.norm(strain - strain.mean(axis=1, keepdims=True), axis=1)
    F = F[np.abs(trial - np.sqrt(2 / 3) * yield_stress) > 0.05 * yield_stress]
    material = np.tile([MU, yield_stress, 0.004, 1e-3], (len(F), 1))
    F_next_bar = rng.normal(size=F.shape)
    F_bar, material_bar = flow_adjoint(law, F, material, F_next_bar)
    assert (material_bar[:, 1] == 0).any() and (material_bar[:, 1] != 0).any()  # both sides of yield are there

    def loss(F, material):
        return (flow(law, F, material) * F_next_bar).sum((1, 2))

    size = np.linalg.norm(F_bar, axis=(1, 2))
    for _ in range(4):
        direction = rng.normal(size=F.shape)
        numeric = central(lambda h, direction=direction: loss(F + h * direction, material), 1e-4 * yield_stress**0.5)
        agree((F_bar * direction).sum((1, 2)), numeric, 0.1 * size)
    for k in range(3):
        step = material * np.eye(4)[k]
        numeric = central(lambda h, step=step: loss(F, material + h * step), 3e-3)
        if law == "von_mises" and k == 2:
            assert (material_bar[:, k] == 0).all()
        agree(material_bar[:, k] * material[:, k], numeric, 1e-5)


@pytest.mark.parametrize("law", PLASTIC)
@pytest.mark.parametrize("stretches", [(1.15, 1.0, 0.9), (1.1, 1.1, 0.9), (1.1, 0.95, 0.95)])
def test_flow_at_yield_from_both_sides(law, stretches):
    rng = np.random.default_rng(2)
    F = stretched(rng, stretches, 12)
    strain = np.log(stretches)
    at_yield = 2 * MU * np.linalg.norm(strain - strain.mean()) / np.sqrt(2 / 3)
    F_next_bar = rng.normal(size=F.shape)
    outward = stress("von_mises", F, (MU, 0.0)) @ np.linalg.inv(F).swapaxes(1, 2)  # d|dev e| / dF, but for a factor
    outward /= np.linalg.norm(outward, axis=(1, 2), keepdims=True)
    # A direction across the yield surface, and any part along it.
    direction = outward + 0.3 * rng.normal(size=F.shape)
    for side, sign in ((1 - 1e-12, 1.0), (1 + 1e-12, -1.0)):
        # Y below: it flows already, and goes on to as F moves outward. Y above: it does not, and will not inward.
        material = np.tile([MU, side * at_yield, 0.004, 1e-3], (len(F), 1))
        F_bar, material_bar = flow_adjoint(law, F, material, F_next_bar)

        def along(h, sign=sign, material=material):
            return (flow(law, F + h * sign * direction, material) * F_next_bar).sum((1, 2))

        agree((F_bar * direction).sum((1, 2)), sign * one_sided(along, 3e-4), 0.1 * np.linalg.norm(F_bar, axis=(1, 2)))
        for k in range(3):
            # A lower yield stress, and a higher shear modulus, go outward; the viscosity does not matter at yield.
            toward = material * np.eye(4)[k] * sign * (-1.0 if k == 1 else 1.0)

            def with_material(h, material=material, toward=toward):
                return (flow(law, F, material + h * toward) * F_next_bar).sum((1, 2))

            agree((material_bar * toward).sum(1), one_sided(with_material, 1e-3), 1e-4)
        assert (np.abs(material_bar[:, 1]).max() > 0) == (side < 1)


def same_in_single_precision(adjoint, law, F, material, bar):
    exact, rounded = (adjoint(law, F, material, bar, real) for real in (np.float64, np.float32))
    for double, single in zip(exact, rounded):
        assert np.isfinite(single).all()
        assert np.abs(single - double).max() <= 1e-4 * np.abs(double).max()


@pytest.mark.parametrize("law", ["corotated", "neo_hookean", "von_mises"])
def test_single_precision_stress_adjoint(law):
    rng = np.random.default_rng(3)
    F = np.concatenate([delicate(rng), deformations(rng, 40), deformations(rng, 20, 0.05)])
    same_in_single_precision(stress_adjoint, law, F, (MU, LAM), rng.normal(size=F.shape))


@pytest.mark.parametrize("law", PLASTIC)
def test_single_precision_flow_adjoint(law):
    rng = np.random.default_rng(3)
    F = np.concatenate([deformations(rng, 40), stretched(rng, (1.2, 1.2, 0.9)), deformations(rng, 20, 0.02)])
    same_in_single_precision(flow_adjoint, law, F, (MU, 0.25, 0.004, 1e-3), rng.normal(size=F.shape))


@pytest.mark.parametrize("law", LAWS)
def test_youngs_modulus_and_poissons_ratio_through_lame(law):
    rng = np.random.default_rng(4)
    F = deformations(rng, 10)
    tau_bar = rng.normal(size=F.shape)
    E, nu = (torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in (8.0, 0.3))
    mu, lam = lame(E, nu)
    _, material_bar = stress_adjoint(law, F, (mu.item(), lam.item()), tau_bar)
    torch.autograd.backward([mu, lam], [torch.tensor(total) for total in material_bar.sum(axis=0)])

    def loss(E, nu):
        return (stress(law, F, lame(E, nu)) * tau_bar).sum()

    assert E.grad.item() == pytest.approx(central(lambda h: loss(8.0 + h, 0.3), 1e-2), rel=1e-8)
    assert nu.grad.item() == pytest.approx(central(lambda h: loss(8.0, 0.3 + h), 1e-4), rel=1e-8)


def test_a_turned_body_has_a_turned_gradient():
    rng = np.random.default_rng(5)
    F, bar = deformations(rng, 10), rng.normal(size=(10, 3, 3))
    Q = rotations(rng, 1)[0]
    for law in LAWS:
        upright, material_bar = stress_adjoint(law, F, (MU, LAM), bar)
        turned, turned_material_bar = stress_adjoint(law, Q @ F, (MU, LAM), Q @ bar @ Q.T)
        assert np.allclose(turned, Q @ upright, atol=1e-11)
        assert np.allclose(turned_material_bar, material_bar, atol=1e-11)
