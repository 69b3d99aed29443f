"""Energies: gradients and second derivatives against finite differences, exact curvature on any mesh, nothing from rotation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seeing_wind.engine.mpm.shell import bending as bend
from seeing_wind.engine.mpm.shell import membrane as stretch
from seeing_wind.engine.mpm.shell.surface import surface_of

Y, NU, D, STEP = 100.0, 0.3, 2e-5, 1e-7
HUGE = 10.0
"""N m of a plate whose triangles never buckle."""


def sheet(make, kind, buckles=True, bumpy=0.0):
    x, faces = make[kind](0.8, 0.6, 8, 6)
    x[:, 2] = bumpy * (0.4 * x[:, 0] ** 2 - 0.5 * x[:, 0] * x[:, 1] + 0.02 * np.random.default_rng(2).normal(size=len(x)))
    surface = surface_of(x, faces)
    m = stretch.membrane(surface, Y, NU, D if buckles else HUGE)
    return surface, m, bend.bending(surface, m, D)


def forces(m, y):
    F = stretch.deformation(m, y)
    g = np.zeros_like(y)
    np.add.at(g, m.faces, stretch.gradient(m, F, stretch.stress(m, stretch.strain(F))))
    return g


@pytest.mark.parametrize("kind", ["grid", "irregular"])
@pytest.mark.parametrize(("buckles", "size"), [(False, 0.02), (True, 0.002), (True, 0.02)])
def test_stretching_forces_and_their_derivative(make, kind, buckles, size):
    """Small, folded and crushed: every branch of the stress is passed."""
    surface, m, _ = sheet(make, kind, buckles)
    rng = np.random.default_rng(1)
    y, d = surface.x + size * rng.normal(size=surface.x.shape), rng.normal(size=surface.x.shape)

    def energy(z):
        return stretch.energy(m, stretch.strain(stretch.deformation(m, z))).sum()

    assert energy(surface.x) == pytest.approx(0.0, abs=1e-15)
    numeric = (energy(y + STEP * d) - energy(y - STEP * d)) / (2.0 * STEP)
    assert (forces(m, y) * d).sum() == pytest.approx(numeric, rel=1e-6)
    F = stretch.deformation(m, y)
    E = stretch.strain(F)
    H = stretch.hessian(m, F, stretch.stress(m, E), stretch.stress_tangent(m, E), convex=False)
    along = np.zeros_like(y)
    np.add.at(along, m.faces, (H @ d[m.faces].reshape(-1, 9, 1)).reshape(-1, 3, 3))
    difference = (forces(m, y + STEP * d) - forces(m, y - STEP * d)) / (2.0 * STEP)
    np.testing.assert_allclose(along, difference, atol=1e-5 * np.abs(difference).max())


@pytest.mark.parametrize("size", [0.002, 0.02])
def test_the_matrix_for_newton_is_positive_semidefinite(make, size):
    surface, m, _ = sheet(make, "irregular")
    F = stretch.deformation(m, surface.x + size * np.random.default_rng(3).normal(size=surface.x.shape))
    E = stretch.strain(F)
    H = stretch.hessian(m, F, stretch.stress(m, E), stretch.stress_tangent(m, E))
    np.testing.assert_allclose(H, H.transpose(0, 2, 1), atol=1e-9 * np.abs(H).max())
    assert np.linalg.eigvalsh(H).min() > -1e-10 * np.abs(H).max()


def test_hooke_in_tension_and_the_buckling_load_in_compression(make):
    surface, m, _ = sheet(make, "grid")
    pulled, pressed = (np.tile([e, -NU * e, 0.0], (len(surface.faces), 1)) for e in (1e-3, -0.015))
    np.testing.assert_allclose(stretch.stress(m, pulled), np.tile([Y * 1e-3, 0.0, 0.0], (len(pulled), 1)), atol=1e-12)
    assert (m.buckling < 0.1 * Y * 0.015).all()
    np.testing.assert_allclose(stretch.stress(m, pressed)[:, 0], -m.buckling, rtol=1e-9)


@pytest.mark.parametrize("kind", ["grid", "irregular"])
@pytest.mark.parametrize("k", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.3, -0.5, 0.7)])
def test_constant_curvature_is_exact_on_any_mesh(make, kind, k):
    """w = k11 x²/2 + k22 y²/2 + k12 x y has the plate's energy D/2 (k11² + k22² + 2 nu k11 k22 + 2 (1 - nu) k12²) A."""
    surface, _, b = sheet(make, kind)
    x, y = surface.x[:, 0], surface.x[:, 1]
    w = 0.5 * k[0] * x**2 + 0.5 * k[1] * y**2 + k[2] * x * y
    exact = 0.5 * D * (k[0] ** 2 + k[1] ** 2 + 2 * NU * k[0] * k[1] + 2 * (1 - NU) * k[2] ** 2) * 0.48
    assert 0.5 * w @ (b.matrix @ w) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("kind", ["grid", "irregular"])
def test_only_flat_shapes_cost_nothing(make, kind):
    _, _, b = sheet(make, kind)
    values = np.linalg.eigvalsh(b.matrix.toarray())
    assert np.abs(values[:3]).max() < 1e-12 * values[-1] < values[3]


@pytest.mark.parametrize("bumpy", [0.0, 1.0])
def test_bending_forces(make, bumpy):
    surface, _, b = sheet(make, "irregular", bumpy=bumpy)
    rng = np.random.default_rng(4)
    y, d = surface.x + 0.02 * rng.normal(size=surface.x.shape), rng.normal(size=surface.x.shape)
    assert b.flat == (bumpy == 0.0)
    numeric = (bend.energy(b, y + STEP * d) - bend.energy(b, y - STEP * d)) / (2.0 * STEP)
    assert (bend.gradient(b, y) * d).sum() == pytest.approx(numeric, rel=1e-6)


def test_a_turned_sheet_has_no_energy_and_no_forces(make):
    """Curved and creased at rest."""
    surface, m, b = sheet(make, "irregular", bumpy=3.0)
    turned = surface.x @ Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix().T + [1.0, 2.0, 3.0]
    scale = bend.energy(b, 1.1 * surface.x)
    assert bend.energy(b, turned) < 1e-12 * scale
    assert np.abs(bend.gradient(b, turned)).max() < 1e-8 * np.abs(b.matrix @ surface.x).max()
    assert stretch.energy(m, stretch.strain(stretch.deformation(m, turned))).sum() < 1e-20
