"""Energies: gradients and second derivatives against finite differences, exact curvature on any mesh, nothing from rotation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seeing_wind.engine.mpm.shell import bending as bend
from seeing_wind.engine.mpm.shell import membrane as stretch
from seeing_wind.engine.mpm.shell.forces import Forces
from seeing_wind.engine.mpm.shell.linear import System
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


def gradient(m, b, y, **damped):
    """The derivative (V, 3) of the energy of both, as the solver has it."""
    forces = Forces(m, b, len(y))
    return forces.at_vertices(y, np.zeros(len(y)), y, np.zeros_like(y), forces.faces(y, **damped))


def stretching(make, kind, buckles=True):
    """A sheet that resists stretching only."""
    surface, m, _ = sheet(make, kind, buckles)
    return surface, m, bend.bending(surface, m, 1e-15)


def matrix(surface, m, b, y, convex):
    forces = Forces(m, b, len(y))
    faces = forces.faces(y)
    system = System(surface, m.slope, b, 0.0, np.zeros(len(y), dtype=bool))
    return system.matrix(faces.F, forces.tangents(faces.F, faces.stress, 0.0, convex), np.zeros((len(y), 3, 3)), 1.0)


@pytest.mark.parametrize("kind", ["grid", "irregular"])
@pytest.mark.parametrize(("buckles", "size"), [(False, 0.02), (True, 0.002), (True, 0.02)])
def test_stretching_forces_and_their_derivative(make, kind, buckles, size):
    """Small, folded and crushed: every branch of the stress is passed."""
    surface, m, b = stretching(make, kind, buckles)
    rng = np.random.default_rng(1)
    y, d = surface.x + size * rng.normal(size=surface.x.shape), rng.normal(size=surface.x.shape)

    def energy(z):
        return stretch.energy(m, stretch.strain(stretch.deformation(m, z))).sum()

    assert energy(surface.x) == pytest.approx(0.0, abs=1e-15)
    numeric = (energy(y + STEP * d) - energy(y - STEP * d)) / (2.0 * STEP)
    assert (gradient(m, b, y) * d).sum() == pytest.approx(numeric, rel=1e-6)
    along = matrix(surface, m, b, y, convex=False).times(d)
    difference = (gradient(m, b, y + STEP * d) - gradient(m, b, y - STEP * d)) / (2.0 * STEP)
    np.testing.assert_allclose(along, difference, atol=1e-5 * np.abs(difference).max())


@pytest.mark.parametrize("size", [0.002, 0.02])
def test_the_matrix_for_newton_is_positive_semidefinite(make, size):
    surface, m, b = stretching(make, "irregular")
    y = surface.x + size * np.random.default_rng(3).normal(size=surface.x.shape)
    found = matrix(surface, m, b, y, convex=True)
    H = np.stack([found.times(column.reshape(-1, 3)).ravel() for column in np.eye(y.size)])
    np.testing.assert_allclose(H, H.T, atol=1e-9 * np.abs(H).max())
    assert np.linalg.eigvalsh(H).min() > -1e-10 * np.abs(H).max()
    if size == 0.02:  # what compression takes away would make it indefinite
        true = matrix(surface, m, b, y, convex=False)
        T = np.stack([true.times(column.reshape(-1, 3)).ravel() for column in np.eye(y.size)])
        assert np.linalg.eigvalsh(T).min() < -1e-6 * np.abs(T).max()


def test_hooke_in_tension_and_the_buckling_load_in_compression(make):
    """A sheet that is pulled, or pressed, along x and free across."""
    surface, m, b = stretching(make, "grid")
    along = stretch.deformation(m, surface.x)[:, 0]  # the direction x in each face's own axes
    forces = Forces(m, b, len(surface.x))
    pulled, pressed = (forces.faces(surface.x * np.sqrt([1.0 + 2.0 * e, 1.0 - 2.0 * NU * e, 1.0])).stress for e in (1e-3, -0.015))
    one = np.stack([along[:, 0] ** 2, along[:, 1] ** 2, along[:, 0] * along[:, 1]], axis=1)
    np.testing.assert_allclose(pulled, Y * 1e-3 * one, atol=1e-12)
    assert (m.buckling < 0.1 * Y * 0.015).all()
    taken = pressed[:, 0] * one[:, 0] + pressed[:, 1] * one[:, 1] + 2.0 * pressed[:, 2] * one[:, 2]
    np.testing.assert_allclose(taken, -m.buckling, rtol=1e-9)


def test_damping_follows_the_change_since_the_start(make):
    """Stress and moments of a lag are so many times what has changed; a turned sheet has none."""
    surface, m, b = sheet(make, "irregular", bumpy=1.0)
    rng, lag = np.random.default_rng(8), 2.5
    forces = Forces(m, b, len(surface.x))
    start = surface.x + 0.002 * rng.normal(size=surface.x.shape)
    y = start + 0.002 * rng.normal(size=surface.x.shape)
    before, plain, damped = forces.faces(start), forces.faces(y), forces.faces(y, lag, forces.faces(start))
    np.testing.assert_allclose(damped.stress, plain.stress + lag * (plain.stress - before.stress), atol=1e-12 * np.abs(plain.stress).max())
    change = (plain.curvature - before.curvature) @ b.law * b.area[:, None]
    expected = lag * change[:, :, None] * bend.normals(y, b.faces)[:, None]
    np.testing.assert_allclose(damped.moment - plain.moment, expected, atol=1e-12 * np.abs(plain.moment).max())
    turned = start @ Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix().T
    still, lagging = forces.faces(turned), forces.faces(turned, lag, before)
    np.testing.assert_allclose(lagging.stress, still.stress, atol=1e-10 * np.abs(still.stress).max())
    np.testing.assert_allclose(lagging.moment, still.moment, atol=1e-10 * np.abs(still.moment).max())


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
    soft = stretch.membrane(surface, 1e-12, NU, 0.0)
    rng = np.random.default_rng(4)
    y, d = surface.x + 0.02 * rng.normal(size=surface.x.shape), rng.normal(size=surface.x.shape)
    assert b.flat == (bumpy == 0.0)
    numeric = (bend.energy(b, y + STEP * d) - bend.energy(b, y - STEP * d)) / (2.0 * STEP)
    assert (gradient(soft, b, y) * d).sum() == pytest.approx(numeric, rel=1e-6)


def test_a_turned_sheet_has_no_energy_and_no_forces(make):
    """Curved and creased at rest."""
    surface, m, b = sheet(make, "irregular", bumpy=3.0)
    turned = surface.x @ Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix().T + [1.0, 2.0, 3.0]
    scale = bend.energy(b, 1.1 * surface.x)
    assert bend.energy(b, turned) < 1e-12 * scale
    soft = stretch.membrane(surface, 1e-12, NU, 0.0)
    assert np.abs(gradient(soft, b, turned)).max() < 1e-8 * np.abs(b.matrix @ surface.x).max()
    assert np.abs(gradient(m, b, turned)).max() < 1e-8 * Y * surface.edge_length
    assert stretch.energy(m, stretch.strain(stretch.deformation(m, turned))).sum() < 1e-20
