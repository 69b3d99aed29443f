"""Pinned bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.lattice.boundary import FREE, HELD, PINNED
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from tests.engine.mpm.bodies import SPACING, block

POST = Material("post", "corotated", density=500.0, youngs_modulus=1e5, poisson_ratio=0.3)


def bend(particles, dx=None, push=2.0, frames=8):
    model, _ = model_for(particles, POST, 30.0, gravity=(0, 0, 0), dx=dx)
    acceleration = np.broadcast_to([push, 0.0, 0.0], (frames, model.particles, 3))
    return rollout(model, State.at_rest(particles.x), acceleration), model


def tip(path, particles):
    top = particles.x[:, 2] > particles.x[:, 2].max() - SPACING
    return (path.x[:, top] - path.x[0, top]).mean(axis=1)[:, 0].max()


def test_pinned_particles_stay_and_the_rest_bends():
    particles = block((4, 4, 16), pinned_below=0.035)
    path, model = bend(particles)
    assert np.abs(path.x - path.x[0])[:, particles.pinned].max() < 1e-16
    assert tip(path, particles) > 2e-3
    assert set(np.unique(model.role)) == {FREE, PINNED, HELD}
    assert np.array_equal(model.pinned, particles.pinned)


def test_the_clamp_does_not_depend_on_place_or_grid():
    particles = block((4, 4, 16), pinned_below=0.035)
    here = tip(bend(particles)[0], particles)
    for moved in ([0.0031, 0.0, 0.0], [0.0, 0.0, 0.0043], [1.0, 2.0, 3.0077]):
        there = replace(particles, x=particles.x + moved)
        assert np.isclose(tip(bend(there)[0], there), here, rtol=1e-6)
    for cells in (1.4, 1.9):
        assert np.isclose(tip(bend(particles, dx=cells * SPACING)[0], particles), here, rtol=0.1)


def test_all_pinned_stands_still():
    particles = block((3, 3, 3), pinned_below=1.0)
    path, _ = bend(particles, frames=2)
    assert np.array_equal(path.x, np.broadcast_to(path.x[0], path.x.shape)) and np.isfinite(path.F).all()


def test_two_pinned_corners_hold_a_hanging_plate():
    particles = block((10, 2, 10))
    corners = (particles.x[:, 2] > 0.085) & (np.abs(particles.x[:, 0] - 0.045) > 0.03)
    particles = replace(particles, pinned=corners)
    model, _ = model_for(particles, replace(POST, youngs_modulus=3e4), 30.0)
    path = rollout(model, State.at_rest(particles.x), np.zeros((10, model.particles, 3)))
    assert np.abs(path.x - path.x[0])[:, corners].max() < 1e-16
    fall = (path.x[0] - path.x)[:, :, 2].max()
    assert 1e-3 < fall < 0.05  # free fall would be 0.54 m


def test_one_pinned_row_bends_like_two():
    # The free part is the same.
    long, short = block((3, 3, 12), jitter=0.0), block((3, 3, 11), jitter=0.0)
    two = replace(long, pinned=long.x[:, 2] < 0.015)
    one = replace(short, pinned=short.x[:, 2] < 0.005)
    assert np.isclose(tip(bend(one)[0], one), tip(bend(two)[0], two), rtol=0.2)
