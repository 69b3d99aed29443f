"""The surface of bodies of particles, against areas and drags in closed form."""

import numpy as np
import pytest

from seeing_wind.engine.records import Attachment, Particles
from seeing_wind.engine.recovery.wind import drag, face_forces
from seeing_wind.engine.recovery.wind.surface import mesh_surface, particle_surface

SPACING = 0.01
REST = np.tile(np.eye(3), (1, 1, 1))


def lattice(*counts):
    axes = [SPACING * (np.arange(count) - 0.5 * (count - 1)) for count in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def body(x):
    return Particles(x, np.full(len(x), SPACING**3), np.zeros(len(x), bool), SPACING)


def turn(axis, angle):
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def facing_area(normals, direction):
    """Area [m²] that a closed surface of area normals (E, 3) shows along `direction` (3,)."""
    return np.maximum(-normals @ direction / np.linalg.norm(direction), 0.0).sum()


@pytest.mark.parametrize("layers", [1, 2, 5])
@pytest.mark.parametrize("angle", [0.0, 0.5, 1.1])
def test_a_plate_however_it_lies_is_pushed_along_its_normal_by_its_area(layers, angle):
    rotation = turn([0.3, 1.0, 0.2], angle)
    surface = particle_surface(body(lattice(24, 20, layers) @ rotation.T))
    normal = rotation[:, 2]
    area = 0.24 * 0.20
    assert facing_area(surface.rest, normal) == pytest.approx(area, rel=0.06)
    np.testing.assert_allclose(surface.rest.sum(axis=0), 0.0, atol=1e-9)
    wind = 5.0 * normal
    force = face_forces(np.tile(wind, (len(surface.rest), 1)), surface.rest, closed=True).sum(axis=0)
    expected = 0.5 * 1.2 * 1.17 * area * 25.0
    assert force @ normal == pytest.approx(expected, rel=0.08)
    assert np.linalg.norm(force - (force @ normal) * normal) < 0.03 * expected


@pytest.mark.parametrize("attack", [0.4, 0.8])
def test_a_plate_at_an_angle_of_attack_is_pushed_along_its_normal(attack):
    rotation = turn([1.0, 0.4, 0.1], 0.7)
    surface = particle_surface(body(lattice(24, 20, 1) @ rotation.T))
    normal, along = rotation[:, 2], rotation[:, 0]
    wind = 5.0 * (np.sin(attack) * normal + np.cos(attack) * along)
    force = face_forces(np.tile(wind, (len(surface.rest), 1)), surface.rest, closed=True).sum(axis=0)
    assert force @ normal == pytest.approx(0.5 * 1.2 * 1.17 * 0.048 * 25.0 * np.sin(attack), rel=0.08)


def test_a_ball_has_the_drag_of_its_windward_half(monkeypatch):
    monkeypatch.setattr(drag, "AIR", drag.DragLaw(tangential=0.0))
    x = lattice(24, 24, 24)
    radius = 0.11
    surface = particle_surface(body(x[np.linalg.norm(x, axis=1) < radius]))
    assert np.linalg.norm(surface.rest, axis=1).sum() == pytest.approx(4 * np.pi * radius**2, rel=0.13)
    wind = np.array([3.0, 2.0, -1.0])
    force = face_forces(np.tile(wind, (len(surface.rest), 1)), surface.rest, closed=True).sum(axis=0)
    # terraces of the lattice add about a tenth
    expected = 0.5 * 1.2 * 1.17 * (2.0 / 3.0) * np.pi * radius**2 * np.linalg.norm(wind) * wind
    np.testing.assert_allclose(force, expected, atol=0.13 * np.linalg.norm(expected))


def test_normals_turn_and_stretch_with_the_body():
    x = lattice(16, 12, 2)
    surface = particle_surface(body(x))
    F = turn([1.0, 2.0, 0.5], 0.8) @ np.diag([1.2, 0.9, 1.0])
    moved = surface.normals(x @ F.T, np.tile(F, (len(x), 1, 1)))
    assert facing_area(moved, F[:, 2]) == pytest.approx(1.2 * 0.9 * facing_area(surface.rest, np.array([0.0, 0.0, 1.0])), rel=1e-3)


def test_a_mesh_rides_on_particles_and_hands_its_force_on():
    x = lattice(3, 3, 1)
    triangles = np.array([[0, 3, 4], [0, 4, 1]])
    everyone = Attachment(np.arange(9, dtype=np.int32)[:, None], np.ones((9, 1)))
    surface = mesh_surface(x, triangles, everyone, x, closed=False)
    np.testing.assert_allclose(surface.normals(2.0 * x, REST), [[0, 0, 2e-4]] * 2)
    force = np.array([[3.0, 0.0, 0.0], [0.0, 6.0, 0.0]])
    spread = surface.spread(force, 9)
    np.testing.assert_allclose(spread.sum(axis=0), [3.0, 6.0, 0.0])
    np.testing.assert_allclose(spread[4], [1.0, 2.0, 0.0])


def test_few_particles_are_lumps():
    surface = particle_surface(body(lattice(2, 1, 1)))
    assert facing_area(surface.rest, np.array([1.0, 0.0, 0.0])) == pytest.approx(2 * SPACING**2)
