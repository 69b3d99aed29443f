"""Contact: rest on a floor, friction on a slope, a sheet over a ball."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.materials import SHEETS
from seeing_wind.engine.mpm.lattice.colliders import Plane
from seeing_wind.engine.mpm.lattice.mesh_collider import MeshCollider
from seeing_wind.engine.mpm.shell import advance, advance_frame, at_rest, obstacles_of, shell_of

trimesh = pytest.importorskip("trimesh")
G = np.array([0.0, 0.0, -9.81])
DT = 0.005


def run(shell, colliders, substeps, velocity=None):
    state = at_rest(shell, velocity, dt=DT)
    obstacles = obstacles_of(colliders, shell.surface.edge_length)
    for _ in range(substeps):
        state, _ = advance(shell, state, dt=DT, gravity=G, obstacles=obstacles)
    return state


def test_a_sheet_falls_on_the_floor_and_stays_there(make):
    x, faces = make["irregular"](0.2, 0.2, 5, 5)
    x[:, 2] = 0.05
    shell = shell_of(x, faces, SHEETS["cotton"])
    state = run(shell, [Plane((0, 0, 0), (0, 0, 1), friction=0.3)], 60)
    half = 0.5 * shell.sheet.thickness
    np.testing.assert_allclose(state.x[:, 2], half, atol=5e-5)
    assert np.abs(state.v).max() < 0.01


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8])
def test_friction_on_a_slope_is_coulombs(make, friction):
    """Down a slope of 30 degrees: a = g (sin - mu cos), nothing above tan 30 = 0.577."""
    x, faces = make["grid"](0.1, 0.1, 3, 3)
    tilt = np.radians(30.0)
    down, normal = np.array([np.cos(tilt), 0.0, -np.sin(tilt)]), np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    x = x[:, :1] * down + x[:, 1:2] * [0.0, 1.0, 0.0]
    shell = shell_of(x, faces, SHEETS["denim"])
    state = run(shell, [Plane(tuple(-0.5 * shell.sheet.thickness * normal), tuple(normal), friction=friction)], 80)
    t = 80 * DT
    expected = max(0.0, 9.81 * (np.sin(tilt) - friction * np.cos(tilt))) * 0.5 * t**2
    assert ((state.x - x) @ down).mean() == pytest.approx(expected, rel=0.03, abs=1e-3)
    assert np.abs((state.x - x) @ normal).max() < 2e-4


def test_a_sticky_floor_holds(make):
    x, faces = make["grid"](0.1, 0.1, 3, 3)
    x[:, 2] = 0.01
    shell = shell_of(x, faces, SHEETS["cotton"])
    state = run(shell, [Plane((0, 0, 0), (0, 0, 1), kind="sticky")], 60, np.broadcast_to([0.5, 0.0, 0.0], x.shape))
    assert np.abs(state.v).max() < 0.01
    assert (state.x - x)[:, 0].mean() < 0.5 * 60 * DT / 3.0


def lift(velocity, frames, **options):
    """A slab whose top is at z = 0 and that moves; a frame is four substeps."""
    box = trimesh.creation.box((1.0, 1.0, 0.1))
    vertices = np.asarray(box.vertices) - [0.0, 0.0, 0.05]
    path = vertices + np.arange(frames + 1)[:, None, None] * 4 * DT * np.asarray(velocity)
    return MeshCollider(vertices, np.asarray(box.faces), path=path, **options)


def ride(shell, collider, frames, velocity=None):
    state, obstacles = at_rest(shell, velocity, dt=DT), obstacles_of([collider], shell.surface.edge_length)
    states = [state]
    for frame in range(frames):
        state = advance_frame(shell, state, frame=frame, fps=0.25 / DT, substeps=4, gravity=G, obstacles=obstacles)
        states.append(state)
    return states


@pytest.mark.parametrize("kind", ["separate", "sticky"])
def test_a_sheet_goes_up_with_a_lift(make, kind):
    x, faces = make["irregular"](0.2, 0.2, 5, 5)
    shell = shell_of(x, faces, SHEETS["cotton"])
    states = ride(shell, lift((0.0, 0.0, 0.4), 15, kind=kind), 15, np.broadcast_to([0.0, 0.0, 0.4], x.shape))
    for frame in (5, 15):
        np.testing.assert_allclose(states[frame].x[:, 2], 0.4 * frame * 4 * DT + 0.5 * shell.sheet.thickness, atol=3e-4)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_table_drawn_away_takes_a_sheet_along_by_friction(make, friction):
    x, faces = make["grid"](0.1, 0.1, 3, 3)
    x[:, 2] = 0.5 * SHEETS["denim"].thickness
    shell = shell_of(x, faces, SHEETS["denim"])
    states = ride(shell, lift((0.8, 0.0, 0.0), 20, friction=friction), 20)
    speed = np.array([state.v[:, 0].mean() for state in states])
    np.testing.assert_allclose(speed, np.minimum(friction * 9.81 * 4 * DT * np.arange(21), 0.8), atol=0.04)


def test_what_a_lift_is_bound_to_goes_down_with_it(make):
    """Faster than it would fall: with a slip contact it cannot stay behind, without it does."""
    x, faces = make["grid"](0.1, 0.1, 3, 3)
    shell = shell_of(x, faces, SHEETS["denim"])
    bound, free = (ride(shell, lift((0.0, 0.0, -2.0), 6, kind=kind), 6)[-1].x[:, 2].mean() for kind in ("slip", "separate"))
    assert bound == pytest.approx(-2.0 * 24 * DT, abs=0.01) and free > -0.1


def test_a_sheet_hangs_over_a_ball(make):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    x, faces = make["grid"](0.3, 0.3, 14, 14)
    x = x - [0.15, 0.15, -0.105]
    shell = shell_of(x, faces, SHEETS["wool"])
    state = run(shell, [MeshCollider(ball.vertices, ball.faces, friction=0.4)], 100)
    distance = np.linalg.norm(state.x, axis=1)
    assert distance.min() > 0.098
    assert state.x[:, 2].max() > 0.095
    assert state.x[:, 2].min() < 0.02
