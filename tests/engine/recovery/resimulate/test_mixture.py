"""The clip's own object, whose parts have materials of their own, in an edit."""

from __future__ import annotations

import dataclasses

import numpy as np

from seeing_wind.engine.conventions import GRAVITY
from seeing_wind.engine.field import ForceField
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.records import Attachment, Body, Mixture, Recovery
from seeing_wind.engine.recovery.wind.motion import Sail
from seeing_wind.engine.recovery.wind.surface import mesh_surface
from seeing_wind.engine.settings import BodyEdit
from tests.engine.recovery.resimulate.edits import FPS, FRAMES, run, uniform
from tests.engine.recovery.resimulate.test_pins import recovered_object

LIGHT = 0.2
FORCE = np.array([60.0, 0.0, 30.0])


def two_densities() -> tuple[Body, Recovery]:
    """A free plate at rest of which one half has a fifth of the density; its surface is the mean of its particles, weighted by mass."""
    body, recovery = recovered_object()
    count = len(body.particles.x)
    light = body.particles.x[:, 0] > 0.08
    assert light.sum() == count // 2
    mixture = Mixture(np.where(light, LIGHT, 1.0), np.ones(count), np.full(count, 0.3), np.zeros(count))
    weight = mixture.density / mixture.density.sum()
    whole = Attachment(np.tile(np.arange(count, dtype=np.int32), (3, 1)), np.tile(weight, (3, 1)))
    surface = dataclasses.replace(body.surface, vertices=weight @ body.particles.x + 0.01 * np.eye(3), attachment=whole)
    particles = dataclasses.replace(body.particles, mixture=mixture)
    return dataclasses.replace(body, particles=particles, surface=surface), dataclasses.replace(recovery, v0=np.zeros((count, 3)))


def acceleration(folder, field: ForceField | None = None, gravity=(0.0, 0.0, 0.0), **edit) -> np.ndarray:
    """Constant acceleration (3,) [m/s²] of the centre of mass, from x = a t² / 2."""
    found = run(folder, BodyEdit("clip", "recovered", **edit), field=field or uniform(FORCE), gravity=gravity, recovered=two_densities())
    path = found["clip"].vertices[:, 0]
    t = np.arange(FRAMES + 1) / FPS
    return ((path - path[0]) * t[:, None] ** 2).sum(axis=0) / (t**4).sum() * 2.0


def test_the_field_pushes_it_by_force_over_its_own_mass(folder) -> None:
    mean = 500.0 * 0.5 * (1.0 + LIGHT)
    near = {"atol": 0.01 * np.linalg.norm(FORCE) / mean}
    plain = acceleration(folder)
    np.testing.assert_allclose(plain, FORCE / mean, **near)
    np.testing.assert_allclose(acceleration(folder, mass_scale=2.0), FORCE / mean / 2.0, **near)
    np.testing.assert_allclose(acceleration(folder, density=1000.0), FORCE / mean / 2.0, **near)
    volume = two_densities()[0].particles.volume.sum()
    np.testing.assert_allclose(acceleration(folder, mass=mean * volume / 3.0), 3.0 * FORCE / mean, rtol=0.02, atol=1e-3)
    np.testing.assert_allclose(acceleration(folder, material="foam", density=200.0), FORCE / 200.0, rtol=0.02, atol=1e-3)


def test_gravity_is_an_acceleration_of_all_its_parts(folder) -> None:
    np.testing.assert_allclose(acceleration(folder, uniform((0.0, 0.0, 0.0)), GRAVITY), GRAVITY, atol=0.05)


def test_the_air_makes_no_light_part_faster_than_itself() -> None:
    body, wind, dt = two_densities()[0], np.array([0.0, 6.0, 0.0]), 1.0
    particles, thin = body.particles, dataclasses.replace(body.material, density=0.5)  # so light that the air takes it along at once
    model, _ = model_for(particles, thin, FPS, gravity=(0.0, 0.0, 0.0))
    surface = mesh_surface(particles.x, _faces(), body.keypoints, particles.x, closed=False)
    relative = particles.relative_density / particles.relative_density.mean()
    sail = Sail(surface, slice(None), surface.attachment.follow(relative[:, None])[:, 0])
    at_rest, unmoved = State.at_rest(particles.x), np.zeros((model.particles, 3))
    force = sail.drag(model, at_rest, lambda points: np.broadcast_to(wind, points.shape), unmoved, dt)
    blown = np.abs(force[:, 1]) > 0.0
    behind = surface.spread(np.linalg.norm(surface.rest, axis=1) * sail.heaviness, model.particles)
    mass = model.mass.sum() * behind / behind.sum()  # what each piece is taken to move
    gained = dt * force[blown, 1] / mass[blown]
    assert 3.0 < gained.min() and gained.max() < 6.0
    assert gained.max() / gained.min() < 1.3, "light and heavy parts alike"


def _faces() -> np.ndarray:
    """Triangles over one layer of the plate's particles."""
    number = np.arange(8 * 2 * 8).reshape(8, 2, 8)[:, 0]
    a, b, c, d = (number[i : i + 7, j : j + 7].ravel() for i in (0, 1) for j in (0, 1))
    return np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)]).astype(np.int32)
