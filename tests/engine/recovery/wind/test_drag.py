"""The drag law against measured coefficients, its derivatives, and closed forms of motion under it."""

import numpy as np
import pytest

from seeing_wind.engine.recovery.wind import area_normals, drag, face_forces, vertex_drag
from seeing_wind.engine.recovery.wind.drag import DragLaw, face_damping, face_force_derivative


@pytest.fixture
def faces(rng=np.random.default_rng(3)):
    return rng.normal(size=(40, 3)) * 3.0, rng.normal(size=(40, 3)) * 0.1


@pytest.mark.parametrize("attack", np.radians([5.0, 30.0, 60.0, 90.0]))
def test_a_falling_plate_of_the_literature_is_a_case_of_the_law(attack, monkeypatch):
    # Andersen, Pesavento and Wang (2005): drag A - B cos 2a, lift C_T sin 2a on the chord, A = 1.4, B = C_T = 1.
    w, n = 2.0 * np.array([np.cos(attack), 0.0, np.sin(attack)]), np.array([0.0, 0.0, 1.0])
    monkeypatch.setattr(drag, "AIR", DragLaw(normal=2.4, tangential=0.4, density=1.0))
    f = face_forces(w[None], 0.3 * n[None])[0] / (0.5 * 0.3 * 4.0)
    across = np.array([-np.sin(attack), 0.0, np.cos(attack)])
    assert f @ w / 2.0 == pytest.approx(1.4 - np.cos(2 * attack))
    assert f @ across == pytest.approx(np.sin(2 * attack))


@pytest.mark.parametrize("closed", [False, True])
def test_derivative_is_that_of_finite_differences(faces, closed):
    w, a = faces
    step = 1e-6
    columns = [(face_forces(w + step * e, a, closed) - face_forces(w - step * e, a, closed)) / (2 * step) for e in np.eye(3)]
    np.testing.assert_allclose(face_force_derivative(w, a, closed), np.stack(columns, axis=2), atol=1e-7)


@pytest.mark.parametrize("closed", [False, True])
def test_damping_times_velocity_is_the_force_and_takes_energy(faces, closed):
    w, a = faces
    damping = face_damping(w, a, closed)
    np.testing.assert_allclose((damping @ w[..., None])[..., 0], face_forces(w, a, closed), atol=1e-12)
    np.testing.assert_allclose(damping, np.swapaxes(damping, 1, 2), atol=1e-15)
    assert np.linalg.eigvalsh(damping).min() > -1e-15


def test_no_force_at_the_winds_own_speed():
    nothing = np.zeros((1, 3))
    area = np.array([[0.0, 0.0, 0.2]])
    assert not face_forces(nothing, area).any()
    assert not face_force_derivative(nothing, area).any()
    assert not face_forces(np.ones((1, 3)), nothing).any()


def test_a_sheet_and_the_two_sides_of_a_thin_body_feel_the_same(faces):
    w, a = faces
    both = face_forces(w, a, closed=True) + face_forces(w, -a, closed=True)
    np.testing.assert_allclose(both, face_forces(w, a), atol=1e-12)


def test_a_cube_across_the_wind_has_the_plates_drag(monkeypatch):
    monkeypatch.setattr(drag, "AIR", DragLaw(tangential=0.0))
    normals = 0.01 * np.concatenate([np.eye(3), -np.eye(3)])
    total = face_forces(np.tile([5.0, 0.0, 0.0], (6, 1)), normals, closed=True).sum(axis=0)
    np.testing.assert_allclose(total, [0.5 * 1.2 * 1.17 * 0.01 * 25.0, 0.0, 0.0], atol=1e-12)


def grid(n=5, size=0.4):
    axis = np.linspace(0.0, size, n)
    x = np.stack(np.meshgrid(axis, axis, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    return x, np.concatenate([np.stack([corner, corner + n, corner + n + 1], 1), np.stack([corner, corner + n + 1, corner + 1], 1)])


def test_vertices_share_the_faces_force():
    x, triangles = grid()
    normals = area_normals(x, triangles)
    np.testing.assert_allclose(normals.sum(axis=0), [0.0, 0.0, 0.16], atol=1e-12)
    velocity = np.random.default_rng(1).normal(size=x.shape)
    force, damping = vertex_drag(np.array([1.0, 2.0, 3.0]), x, velocity, triangles)
    relative = np.array([1.0, 2.0, 3.0]) - velocity[triangles].mean(axis=1)
    np.testing.assert_allclose(force.sum(axis=0), face_forces(relative, normals).sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(damping.sum(axis=0), face_damping(relative, normals).sum(axis=0), rtol=1e-12)


@pytest.mark.parametrize("areal_density", [0.02, 0.08, 0.16])
def test_a_mesh_blown_along_follows_the_closed_form_at_any_step_and_never_passes_the_wind(areal_density):
    """v(t) = u (1 - 1 / (1 + k u t)), k = rho C_n / (2 m''): heavier ones lag. Steps of a frame, far beyond what is stable explicitly."""
    x, triangles = grid()
    u, dt, frames = 8.0, 1.0 / 24.0, 30
    area = np.zeros(len(x))
    for corner in range(3):
        np.add.at(area, triangles[:, corner], np.linalg.norm(area_normals(x, triangles), axis=1) / 3.0)
    mass, v = areal_density * area, np.zeros_like(x)
    k = 1.2 * 1.17 / (2.0 * areal_density)
    for t in range(1, frames + 1):
        force, damping = vertex_drag(np.array([0.0, 0.0, u]), x, v, triangles)
        v = v + dt * np.linalg.solve(mass[:, None, None] * np.eye(3) + dt * damping, force[..., None])[..., 0]
        np.testing.assert_allclose(v[:, 2], u * (1.0 - 1.0 / (1.0 + k * u * t * dt)), rtol=1e-9)
        assert v[:, 2].max() < u
    assert np.abs(v[:, :2]).max() < 1e-12
