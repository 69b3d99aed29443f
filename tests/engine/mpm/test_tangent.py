"""Changes carried to first order, against closed forms and against finite differences of whole simulations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.errors import SimulationError, UsageError
from seeing_wind.engine.mpm.batch import rollout_batch
from seeing_wind.engine.mpm.damping import substeps_for, with_retardation
from seeing_wind.engine.mpm.kernels.carry import WIDTHS
from seeing_wind.engine.mpm.lattice.colliders import Plane
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.mpm.tangent import Changes, tangents
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.recovery.prior.basis import spatial_basis
from tests.engine.mpm.bodies import RUBBER, block

FPS, FRAMES = 30.0, 4


def body(law="corotated", pinned_below=None, shape=(4, 3, 5)):
    """A body of so many particles, its solver's model, start, and a basis of four modes."""
    particles = block(shape, pinned_below=pinned_below)
    material = replace(RUBBER, law=law, yield_stress=1e3 if law == "von_mises" else 0.0)
    model, _ = model_for(particles, material, FPS, gravity=(0.0, 0.0, -2.0))
    basis = spatial_basis(particles.x, model.mass * ~particles.pinned, 4)
    return model, State.at_rest(particles.x, spin=None if particles.pinned.any() else (3.0, -2.0, 4.0)), basis


def coefficients(rng, modes, size):
    """(FRAMES, modes, 3) of a force that bends and turns the body."""
    return size * rng.standard_normal((FRAMES, modes, 3))


def test_a_uniform_force_moves_a_free_body_as_a_point():
    """Any body's changed places are those of a point: dx = sum over substeps of dt² (s da), exactly."""
    model, start, basis = body()
    change = np.zeros((1, FRAMES, 4, 3))
    change[0, 1:, 0] = (0.0, 0.0, 1.0)  # the first mode is uniform
    phi, dphi = basis.phi, basis.gradient
    _, dx = tangents(model, start, phi, dphi, coefficients(np.random.default_rng(0), 4, 2.0), Changes(change), NoProgress())
    steps = np.arange(1, FRAMES + 1)[:, None] * model.substeps - np.arange(model.substeps, FRAMES * model.substeps)[None]
    expected = np.where(steps > 0, steps, 0).sum(axis=1) * (model.frame_dt / model.substeps) ** 2 * phi[0, 0]
    assert dx[0, 0] == pytest.approx(0.0)
    np.testing.assert_allclose(dx[0, 1:, :, 2], np.tile(expected[:, None], len(start.x)), rtol=1e-4, atol=1e-9)
    assert np.abs(dx[0, ..., :2]).max() < 1e-5 * expected[-1]


def largest_error(model, start, basis, force, change):
    """Of the carried changes against central differences of simulations, relative to each; the motion itself must be the same.

    And the changes (B, FRAMES + 1, N, 3).
    """
    phi, dphi, count, step = basis.phi, basis.gradient, len(change), 1e-4
    x, dx = tangents(model, start, phi, dphi, force, Changes(change), NoProgress())
    every = np.concatenate([force[None], force + step * change, force - step * change])
    points = rollout_batch(model, start, phi, dphi, every, strict=True).x
    np.testing.assert_allclose(x, points[0], rtol=0, atol=1e-12)
    wanted = (points[1 : count + 1] - points[count + 1 :]) / (2 * step)
    return np.max(np.linalg.norm((dx - wanted).reshape(count, -1), axis=1) / np.linalg.norm(wanted.reshape(count, -1), axis=1)), dx


FEW, MANY = WIDTHS[0] + 3, 2 * WIDTHS[-1] + 3
"""Changes: few lanes, and many of which the last group is not full."""


@pytest.mark.parametrize(
    ("law", "pinned_below", "count"),
    [(law, pinned, FEW) for law in ("corotated", "neo_hookean") for pinned in (None, 0.008)]
    + [("corotated", 0.008, MANY), ("neo_hookean", None, MANY)]
    + [pytest.param(*case, MANY, marks=pytest.mark.slow) for case in (("corotated", None), ("neo_hookean", 0.008))],
)
def test_agrees_with_differences_of_simulations(law, pinned_below, count):
    """Random changes in every mode, of a body of 5 by 4 by 6 cells that turns and bends."""
    rng = np.random.default_rng(1)
    change = rng.standard_normal((count, FRAMES, 4, 3))
    change[5:, :2] = 0.0  # these begin later
    model, start, basis = body(law, pinned_below, (8, 6, 10))
    assert largest_error(model, start, basis, coefficients(rng, 4, 3.0), change)[0] < 0.03


@pytest.mark.parametrize("law", ["corotated", pytest.param("neo_hookean", marks=pytest.mark.slow)])
def test_agrees_with_differences_where_the_body_is_damped(law):
    """Its damping changes the changes by far more than the bar."""
    rng, retardation = np.random.default_rng(1), 2e-3
    model, start, basis = body(law, 0.008, (8, 6, 10))
    damped = with_retardation(replace(model, substeps=substeps_for(model, retardation)), retardation)
    change, force = rng.standard_normal((8, FRAMES, 4, 3)), coefficients(rng, 4, 3.0)
    error, slowed = largest_error(damped, start, basis, force, change)
    assert error < 0.03
    moved = tangents(model, start, basis.phi, basis.gradient, force, Changes(change), NoProgress())[1]
    differs = np.linalg.norm((slowed - moved).reshape(8, -1), axis=1) / np.linalg.norm(moved.reshape(8, -1), axis=1)
    assert differs.max() > 0.1


def test_what_moving_nodes_neglect_is_of_second_order():
    """Twice the cells across the body: the error falls at least threefold."""
    change = np.random.default_rng(3).standard_normal((8, FRAMES, 4, 3))
    force = coefficients(np.random.default_rng(1), 4, 3.0)
    small, large = (largest_error(*body(shape=shape), force, change)[0] for shape in ((4, 3, 5), (8, 6, 10)))
    assert 3.0 * large < small < 0.2


def test_nothing_moves_before_its_force_acts():
    model, start, basis = body()
    change = np.zeros((3, FRAMES, 4, 3))
    change[:, 3:, 1] = 1.0
    _, dx = tangents(model, start, basis.phi, basis.gradient, np.zeros((FRAMES, 4, 3)), Changes(change), NoProgress())
    assert not dx[:, :4].any()
    assert dx[:, 4:].any()


def test_changes_of_the_start():
    """Initial velocities too: a spin and a push of a free body, against differences."""
    model, start, basis = body(shape=(8, 6, 10))
    velocity = np.zeros((2, *start.x.shape))
    velocity[0, :, 0] = 1.0
    gradient = np.zeros((2, len(start.x), 3, 3))
    gradient[1] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    velocity[1] = (start.x - start.x.mean(axis=0)) @ gradient[1, 0].T
    force = coefficients(np.random.default_rng(2), 4, 1.0)
    phi, dphi = basis.phi, basis.gradient
    changes = Changes(np.zeros((2, FRAMES, 4, 3)), velocity, gradient)
    _, dx = tangents(model, start, phi, dphi, force, changes, NoProgress())
    step, every = 1e-4, np.repeat(force[None], 4, axis=0)
    sides = np.array([1.0, 1.0, -1.0, -1.0])
    v0 = start.v + step * sides[:, None, None] * np.concatenate([velocity, velocity])
    C0 = start.C + step * sides[:, None, None, None] * np.concatenate([gradient, gradient])
    points = rollout_batch(model, start, phi, dphi, every, v0=v0, C0=C0, strict=True).x
    wanted = (points[:2] - points[2:]) / (2 * step)
    for k in range(2):
        assert np.linalg.norm(dx[k] - wanted[k]) < 0.03 * np.linalg.norm(wanted[k])


def test_a_force_that_acts_late_is_the_same_beside_a_start_that_changes():
    model, start, basis = body()
    change = np.zeros((2, FRAMES, 4, 3))
    change[0, 3:, 1] = 1.0
    still, moving = np.zeros((2, *start.x.shape)), np.zeros((2, len(start.x), 3, 3))
    still[1, :, 0] = 1.0
    force, phi, dphi = np.zeros((FRAMES, 4, 3)), basis.phi, basis.gradient
    alone = tangents(model, start, phi, dphi, force, Changes(change), NoProgress())[1]
    beside = tangents(model, start, phi, dphi, force, Changes(change, still, moving), NoProgress())[1]
    np.testing.assert_array_equal(beside[0], alone[0])
    assert not beside[0, :4].any()
    assert beside[1, 1:].any()


@pytest.mark.parametrize("law", ["von_mises", pytest.param("viscoplastic", marks=pytest.mark.slow)])
def test_agrees_with_differences_of_a_body_that_flows(law):
    """A body that is bent for good: exactly, to single precision."""
    rng = np.random.default_rng(1)
    particles = block((4, 3, 5), pinned_below=0.008)
    model, _ = model_for(particles, replace(RUBBER, law=law, yield_stress=400.0, viscosity=2.0), FPS, gravity=(0.0, 0.0, -2.0))
    basis, start = spatial_basis(particles.x, model.mass * ~particles.pinned, 4), State.at_rest(particles.x)
    force, change = coefficients(rng, 4, 8.0), rng.standard_normal((8, FRAMES, 4, 3))
    error, flowing = largest_error(model, start, basis, force, change)
    assert error < 1e-3
    stiff = replace(model, yield_stress=1e9 * model.yield_stress)
    elastic = tangents(stiff, start, basis.phi, basis.gradient, force, Changes(change), NoProgress())[1]
    assert np.linalg.norm(elastic - flowing) > 0.4 * np.linalg.norm(flowing)


def test_bodies_that_meet_colliders_are_refused():
    particles = block((4, 3, 5))
    model, _ = model_for(particles, RUBBER, FPS, colliders=[Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))])
    basis = spatial_basis(particles.x, model.mass, 4)
    with pytest.raises(UsageError, match="colliders"):
        force = np.zeros((FRAMES, 4, 3))
        tangents(model, State.at_rest(particles.x), basis.phi, basis.gradient, force, Changes(force[None]), NoProgress())


def test_agrees_with_differences_where_the_pins_move():
    rng = np.random.default_rng(1)
    particles = block((8, 6, 10), pinned_below=0.008)
    along = np.linspace(0.0, 0.01, FRAMES + 1)[:, None, None] * np.array([1.0, 0.5, 0.0])
    model, _ = model_for(particles, RUBBER, FPS, gravity=(0.0, 0.0, -2.0), pin_path=particles.x[particles.pinned] + along)
    basis = spatial_basis(particles.x, model.mass * ~particles.pinned, 4)
    force, change = coefficients(rng, 4, 3.0), rng.standard_normal((8, FRAMES, 4, 3))
    assert largest_error(model, State.at_rest(particles.x), basis, force, change)[0] < 0.03


def test_particles_on_the_edge_between_two_cells():
    """Their far nodes get weights that are rounding, 1e-32 along each axis: the changes are those of a body a little beside the edge."""
    particles = block((4, 3, 5))
    model, _ = model_for(particles, RUBBER, FPS, gravity=(0.0, 0.0, 0.0))
    basis = spatial_basis(particles.x, model.mass, 4)
    change = np.random.default_rng(5).standard_normal((8, FRAMES, 4, 3))
    found = []
    for beside in (1e-15, 1e-6):
        on_edge = replace(model, offset=particles.x[0] - (0.5 + beside) * model.dx)
        place = (particles.x[0] - on_edge.offset) / model.dx - 0.5
        assert (place > 0.0).all() and (place < 2.0 * beside).all()
        start = State.at_rest(particles.x)
        _, dx = tangents(on_edge, start, basis.phi, basis.gradient, np.zeros((FRAMES, 4, 3)), Changes(change), NoProgress())
        found.append(dx)
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-4 * np.abs(found[1]).max())


def test_a_body_that_has_flown_apart_is_told_before_its_grid_fills_the_memory():
    """What its kernels index with 32 bits would not hold the grid: it once ended the process."""
    model, start, basis = body()
    apart = start.x.copy()
    apart[-1] += 280.0 * model.dx
    with pytest.raises(SimulationError, match="flew off"):
        tangents(
            model, replace(start, x=apart), basis.phi, basis.gradient, np.zeros((FRAMES, 4, 3)),
            Changes(np.ones((8, FRAMES, 4, 3))), NoProgress(),
        )  # fmt: skip


def test_a_body_that_flies_apart_on_the_way_is_told_long_before_that():
    """A stem whose head comes off kept the solve busy for minutes, with gigabytes of grid."""
    model, start, basis = body()
    x, v = start.x.copy(), start.v.copy()
    x[-1] += 3.0 * model.dx  # one particle leaves the others
    v[-1] += 10.0 * model.dx * FPS

    def carried(of, v):
        force, changes = np.zeros((FRAMES, 4, 3)), Changes(np.ones((8, FRAMES, 4, 3)))
        return tangents(of, replace(start, x=x, v=v), basis.phi, basis.gradient, force, changes, NoProgress())[0]

    with pytest.raises(SimulationError, match="flew off"):
        carried(model, v)
    # What flows may spread as far as it will; half as far across, as the grid between takes eight times the work.
    flows, _, _ = body("von_mises")
    assert np.ptp(carried(flows, v * (1.0, 0.5, 0.5)), axis=1).max() > 40.0 * model.dx
