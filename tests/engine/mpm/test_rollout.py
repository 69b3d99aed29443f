"""Physics of whole frames, failures, and many copies at once."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.conventions import in_figures, in_units
from seeing_wind.engine.errors import MaterialError, SimulationError
from seeing_wind.engine.materials import LIMITS
from seeing_wind.engine.mpm.batch import rollout_batch
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import advance, rollout
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.mpm.tangent import Changes, tangents
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Particles
from tests.engine.mpm.bodies import RUBBER, affine_basis, block, still

G = np.array([0.0, 0.0, -9.81])


def test_free_fall_for_metres():
    body = block()
    model, notes = model_for(body, RUBBER, 30.0)
    assert not notes
    frames = 20
    path = rollout(model, State.at_rest(body.x, v=[3.0, 0.0, 2.0]), still(model, frames))
    t = frames / 30.0
    # Symplectic Euler: each substep falls with its new velocity, dt t g / 2 further than the parabola.
    dt = model.frame_dt / model.substeps
    fall = np.array([3.0, 0.0, 2.0]) * t + 0.5 * G * t * (t + dt)
    assert np.linalg.norm(fall) > 2.0
    assert np.allclose(path.x[-1] - path.x[0], fall, atol=1e-9)
    assert np.allclose(path.F[-1], np.eye(3), atol=1e-9)


def test_momentum_in_is_impulse_out():
    body = block()
    model, _ = model_for(body, RUBBER, 30.0, gravity=(0, 0, 0))
    rng = np.random.default_rng(0)
    acceleration, gradient = rng.normal(size=(5, model.particles, 3)), rng.normal(size=(5, model.particles, 3, 3))
    path = rollout(model, State.at_rest(body.x), acceleration, gradient)
    impulse = (model.mass[:, None] * acceleration).sum(axis=(0, 1)) * model.frame_dt
    momentum = (model.mass[:, None] * path.v[-1]).sum(axis=0)
    assert np.linalg.norm(momentum - impulse) < 1e-9 * np.linalg.norm(impulse)


def test_spin_is_kept():
    body = block((6, 6, 6))
    stiff = replace(RUBBER, youngs_modulus=1e5)
    model, _ = model_for(body, stiff, 30.0, gravity=(0, 0, 0))
    state = State.at_rest(body.x, spin=[0.0, 0.0, 4.0])

    def angular(x, v, C):
        # What a particle carries: the moment of its velocity and, through C, of its own extent dx²/4.
        centre = x.mean(axis=0)
        own = 0.25 * model.dx**2 * (C[:, 1, 0] - C[:, 0, 1])
        return (model.mass * (np.cross(x - centre, v)[:, 2] + own)).sum()

    path = rollout(model, state, still(model, 6))
    before, after = (angular(path.x[t], path.v[t], path.C[t]) for t in (0, -1))
    assert abs(after - before) < 1e-12 * abs(before)
    turned = np.arctan2(*(path.x[-1] - path.x[-1].mean(0))[-1][[1, 0]]) - np.arctan2(*(path.x[0] - path.x[0].mean(0))[-1][[1, 0]])
    assert np.isclose(turned, 4.0 * 6 / 30.0, rtol=0.03)


def test_gradient_of_the_force_turns_the_body():
    # a = w' x (r - centre) on a body smaller than three cells: without its gradient the grid would lose part of the torque.
    body = block((4, 4, 4))
    model, _ = model_for(body, replace(RUBBER, youngs_modulus=1e5), 30.0, gravity=(0, 0, 0))
    W = 20.0 * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0.0]])
    acceleration = (body.x - body.x.mean(axis=0)) @ W.T
    state = advance(model, State.at_rest(body.x), acceleration, np.broadcast_to(W, (model.particles, 3, 3)))
    assert np.allclose(state.C.mean(axis=0), W / 30.0, atol=0.02 * 20.0 / 30.0)


def test_motion_does_not_depend_on_the_place():
    body, moved = block(), np.array([12.34, -5.6, 78.9])
    there = replace(body, x=body.x + moved)
    rng = np.random.default_rng(1)
    acceleration = 5 * rng.normal(size=(6, len(body.x), 3))
    paths = []
    for particles in (body, there):
        model, _ = model_for(particles, RUBBER, 30.0)
        paths.append(rollout(model, State.at_rest(particles.x), acceleration))
    assert np.allclose(paths[1].x - moved, paths[0].x, atol=1e-9)


def test_mass_scale_halves_the_acceleration():
    body = block()
    force = 2.0 * 300.0
    ends = []
    for scale in (1.0, 2.0):
        model, _ = model_for(body, RUBBER, 30.0, gravity=(0, 0, 0), mass_scale=scale)
        density = model.mass / model.volume
        ends.append(advance(model, State.at_rest(body.x), np.array([force, 0, 0]) / density[:, None]).v.mean(axis=0)[0])
    assert np.isclose(ends[0], 2.0 / 30.0) and np.isclose(ends[1], 1.0 / 30.0)


def test_two_bodies_on_one_grid_push_each_other():
    left = block((3, 3, 3))
    right = replace(left, x=left.x + [0.06, 0.0, 0.0])
    soft = replace(RUBBER, name="soft", law="neo_hookean", density=600.0)
    model, _ = model_for([left, right], [RUBBER, soft], 60.0, gravity=(0, 0, 0))
    v = np.zeros((model.particles, 3))
    v[:27, 0] = 1.0
    path = rollout(model, State.at_rest(np.concatenate([left.x, right.x]), v), still(model, 6))
    momentum = (model.mass[:, None] * path.v[-1]).sum(axis=0)
    assert np.allclose(momentum, [model.mass[:27].sum(), 0, 0], atol=1e-12)
    assert path.v[-1][27:, 0].mean() > 0.2 and path.v[-1][:27, 0].mean() < 0.6


def two_flying_apart():
    left = block((3, 3, 3))
    bodies = [left, replace(left, x=left.x + [0.1, 0.0, 0.0])]
    model, _ = model_for(bodies, RUBBER, 30.0, gravity=(0, 0, 0))
    v = np.zeros((54, 3))
    v[:27, 0], v[27:, 0] = -4.0, 4.0
    return model, State.at_rest(np.concatenate([body.x for body in bodies]), v)


def test_the_grid_grows_with_the_bodies():
    model, state = two_flying_apart()
    path = rollout(model, state, still(model, 8))
    assert np.allclose(path.x[-1], state.x + state.v * 8 / 30.0, atol=1e-9)


# -- notices and failures ---------------------------------------------------------------------------------------------------------


def test_stiff_material_is_capped_with_both_numbers():
    model, notes = model_for(block(), replace(RUBBER, name="oak", youngs_modulus=1e10), 30.0, max_substeps=100)
    assert model.substeps == 100
    assert len(notes) == 1 and "oak: too stiff" in notes[0] and "10 GPa" in notes[0] and "nothing need be done" in notes[0]
    youngs_modulus = model.mu[0] * 2 * 1.3
    assert in_units(youngs_modulus, "Pa") in notes[0] and youngs_modulus < 1e7
    assert f"simulated {in_figures(1e10 / youngs_modulus, 2)} times softer" in notes[0]


def test_a_held_body_keeps_a_stiffness_that_a_free_one_loses():
    # Twice the substeps that a free body may take: the force that bends a held one is in proportion to its stiffness.
    free = block()
    pinned = free.x[:, 2] < free.x[:, 2].min() + 1.5 * free.spacing
    modulus = RUBBER.youngs_modulus * (1.9 * LIMITS.max_substeps / model_for(free, RUBBER, 30.0)[0].substeps) ** 2
    stiff = replace(RUBBER, youngs_modulus=modulus)
    softened, _ = model_for(free, stiff, 30.0)
    held, notes = model_for(replace(free, pinned=pinned), stiff, 30.0)
    assert softened.mu[0] < 0.3 * held.mu[0]
    assert held.mu[0] == pytest.approx(modulus / 2.6) and not notes
    capped, notes = model_for(replace(free, pinned=pinned), replace(stiff, youngs_modulus=9.0 * modulus), 30.0)
    assert capped.substeps == LIMITS.max_substeps_held and any("in proportion" in note for note in notes)
    # Where a hundredth of it would be left, they are spared.
    spared, notes = model_for(replace(free, pinned=pinned), replace(stiff, youngs_modulus=100.0 * modulus), 30.0)
    assert spared.substeps == LIMITS.max_substeps and any("in proportion" in note for note in notes)


def test_a_body_that_flows_has_as_many_substeps_a_second_at_any_frame_rate():
    clay = replace(RUBBER, name="clay", law="von_mises", yield_stress=60.0, youngs_modulus=5e3)
    for fps in (24.0, 60.0, 240.0):
        assert model_for(block(), clay, fps)[0].substeps == math.ceil(LIMITS.flow_substeps / fps)
    # What is stiff has as many as an elastic body has, and not more, which would damp it.
    stiff = replace(clay, youngs_modulus=1e5)
    waves = model_for(block(), replace(stiff, law="corotated"), 30.0)[0].substeps
    assert LIMITS.flow_substeps / 30.0 < waves < LIMITS.max_substeps
    assert model_for(block(), stiff, 30.0)[0].substeps == waves


def test_unknown_law_names_the_others():
    with pytest.raises(MaterialError, match="corotated, neo_hookean"):
        model_for(block(), replace(RUBBER, law="jelly"), 30.0)
    with pytest.raises(MaterialError, match="yield stress"):
        model_for(block(), replace(RUBBER, law="von_mises"), 30.0)


def test_no_particles_are_refused():
    empty = Particles(np.zeros((0, 3)), np.zeros(0), np.zeros(0, bool), 0.01)
    with pytest.raises(SimulationError, match="no particles"):
        model_for(empty, RUBBER, 30.0)


def test_too_fast_names_where_and_what_to_change():
    body = block()
    model, _ = model_for(body, RUBBER, 30.0)
    acceleration = still(model, 3)
    acceleration[2] = [3e4, 0.0, 0.0]
    with pytest.raises(SimulationError, match="more than one grid cell") as caught:
        rollout(model, State.at_rest(body.x), acceleration)
    error = caught.value
    assert error.frame == 2 and error.substep >= 0 and error.particle >= 0 and error.quantity == "velocity"
    assert f"of {2 * model.substeps}" in error.message and "gravity" in error.hint


def test_a_frame_that_is_a_little_too_fast_takes_half_the_substep():
    body = block()
    model, _ = model_for(body, replace(RUBBER, youngs_modulus=2e3), 30.0)
    speed = 1.5 * model.dx * model.substeps / model.frame_dt
    path = rollout(replace(model, gravity=np.zeros(3)), State.at_rest(body.x, v=[speed, 0, 0]), still(model, 2))
    assert list(path.substeps) == [2 * model.substeps] * 2
    assert np.allclose(path.x[-1] - path.x[0], [speed * 2 / 30.0, 0, 0], atol=1e-9)


def test_a_grid_too_large_for_memory_is_an_error(monkeypatch):
    monkeypatch.setattr(importlib.import_module("seeing_wind.engine.mpm.body.substeps"), "MOST_NODES", 2000)
    model, state = two_flying_apart()
    with pytest.raises(SimulationError, match="flew off") as caught:
        rollout(model, state, still(model, 8))
    assert caught.value.quantity == "position" and caught.value.frame > 0


@pytest.mark.parametrize("where", ["state", "force"])
def test_not_finite_is_an_error_not_a_zero(where):
    body = block()
    model, _ = model_for(body, RUBBER, 30.0)
    state, acceleration = State.at_rest(body.x), still(model, 1)
    (state.v if where == "state" else acceleration[0])[7, 1] = np.nan
    with pytest.raises(SimulationError, match="not finite") as caught:
        rollout(model, state, acceleration)
    assert caught.value.particle == 7 and caught.value.quantity == {"state": "velocity", "force": "acceleration"}[where]


def test_inside_out_is_an_error():
    body = block()
    model, _ = model_for(body, RUBBER, 30.0, gravity=(0, 0, 0))
    C = np.zeros((model.particles, 3, 3))
    state = State.at_rest(body.x)
    C[:, 0, 0] = -1.3 * model.substeps / model.frame_dt * 2
    v = np.einsum("nij,nj->ni", C, body.x - body.x.mean(axis=0)) * 0.2
    with pytest.raises(SimulationError, match="inside out") as caught:
        rollout(model, replace(state, C=C, v=v), still(model, 1))
    assert caught.value.quantity == "det F"


# -- many copies ------------------------------------------------------------------------------------------------------------------


def test_gravity_may_differ_from_frame_to_frame_and_particle_to_particle():
    body = block((4, 3, 3), pinned_below=0.015)
    model, _ = model_for(body, RUBBER, 30.0, gravity=(0, 0, 0))
    frames, start = 4, State.at_rest(body.x)
    rng = np.random.default_rng(0)
    pull = rng.normal(size=(frames, model.particles, 3))
    heavy = replace(model, gravity=pull)
    wanted = rollout(model, start, pull)
    assert np.allclose(rollout(heavy, start, still(model, frames)).x, wanted.x, atol=1e-12)
    assert np.allclose(advance(heavy, wanted.state(2), pull[0] * 0.0, frame=2).x, wanted.x[3], atol=1e-12)
    assert np.allclose(rollout(heavy.from_frame(2), wanted.state(2), still(model, 2)).x, wanted.x[2:], atol=1e-12)
    phi, dphi = affine_basis(body.x)
    copies = rollout_batch(heavy, start, phi, dphi, np.zeros((2, frames, phi.shape[1], 3)))
    assert np.allclose(copies.x, wanted.x, atol=1e-9)
    none = np.zeros((frames, phi.shape[1], 3))
    x, _ = tangents(heavy, start, phi, dphi, none, Changes(none[None]), NoProgress())
    assert np.allclose(x, wanted.x, atol=1e-9)
