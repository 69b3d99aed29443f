"""Changes that are carried as mixtures of fewer columns: they come out as each alone does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.mpm.body.columns import PLACE, VELOCITY, Columns
from seeing_wind.engine.mpm.kernels.carry import STATE
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.mpm.tangent import Changes, tangents
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.recovery.prior.basis import spatial_basis
from tests.engine.mpm.bodies import RUBBER, block

FRAMES, MODES, WIDTH = 8, 4, 8


@pytest.mark.parametrize("law, frames", [("neo_hookean", FRAMES), ("von_mises", 4)])
def test_many_changes_are_what_each_is_alone(law, frames):
    """A block that bends, or flows: every mode and component in every frame, and a start that changes."""
    particles = block((4, 3, 5), pinned_below=0.008)
    material = replace(RUBBER, law=law, yield_stress=400.0 if law == "von_mises" else 0.0)
    model, _ = model_for(particles, material, 30.0, gravity=(0.0, 0.0, -2.0))
    basis, start = spatial_basis(particles.x, model.mass * ~particles.pinned, MODES), State.at_rest(particles.x)
    force = 4.0 * np.random.default_rng(0).standard_normal((frames, MODES, 3))
    each = 3 * MODES * frames
    change = np.eye(each + 1)[:, :each].reshape(each + 1, frames, MODES, 3)
    velocity = np.zeros((each + 1, *start.x.shape))
    velocity[-1] = (0.02, 0.0, 0.0) * (particles.x[:, 2:] > 0.02)
    none = np.zeros((each + 1, len(start.x), 3, 3))

    def moved(rows):
        some = Changes(change[rows], velocity[rows], none[rows])
        return tangents(model, start, basis.phi, basis.gradient, force, some, NoProgress())[1]

    together = moved(slice(None))
    alone = np.concatenate([moved(slice(first, first + 2 * MODES)) for first in range(0, each + 1, 2 * MODES)])
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-4 * np.abs(alone).max())
    size = np.linalg.norm(alone.reshape(each + 1, -1), axis=1)
    assert (np.linalg.norm((together - alone).reshape(each + 1, -1), axis=1) < 1e-3 * np.maximum(size, 0.1 * size.max())).all()


def test_what_is_wanted_is_mixed_as_the_changes_are():
    particles = block((4, 3, 5), pinned_below=0.008)
    model, _ = model_for(particles, RUBBER, 30.0)
    basis, start = spatial_basis(particles.x, model.mass * ~particles.pinned, MODES), State.at_rest(particles.x)
    change = np.random.default_rng(1).standard_normal((60, FRAMES, MODES, 3))
    given = model, start, basis.phi, basis.gradient, np.zeros((FRAMES, MODES, 3)), Changes(change), NoProgress()

    def middle(frame, x, moved):
        assert x.shape == start.x.shape and 0 <= frame <= FRAMES
        return frame * moved.mean(axis=1)

    moved, middles = tangents(*given)[1], tangents(*given, wanted=middle)[1]
    assert middles.shape == (60, FRAMES + 1, 3)
    wanted = np.arange(FRAMES + 1)[None, :, None] * moved.mean(axis=2)
    np.testing.assert_allclose(middles, wanted, rtol=0, atol=1e-5 * np.abs(wanted).max())


def given_to(columns, given):
    """A frame in which a column's place and velocity become those coefficients of the force that it adds, as far as there are three."""
    force = columns.prepare_frame(given, 1.0)
    states = columns.lanes.transpose(0, 3, 1, 2).reshape(-1, columns.particles, STATE).copy()
    for part in (VELOCITY, PLACE):
        states[: columns.count, 0, part] += force[:, :3]
    columns.lanes[...] = states.reshape(-1, columns.width, columns.particles, STATE).transpose(0, 2, 3, 1)


def test_columns_are_as_few_as_what_they_do_differs():
    """Forty directions that begin two by two, of a body that knows three answers."""
    rng, columns = np.random.default_rng(2), Columns(40, 2, WIDTH)
    total = np.zeros((40, 3))
    for frame in range(20):
        given = np.where(np.arange(40)[:, None] <= 2 * frame + 1, rng.standard_normal((40, 3)), 0.0)
        total += given
        given_to(columns, given)
        found = columns.mix @ columns.states(PLACE)[:, 0]
        np.testing.assert_allclose(found, total, atol=1e-4 * np.abs(total).max())
        assert columns.count <= 6 or not columns.mixed
    assert columns.mixed and columns.count == 6, "three that are left of former frames, and three that begin"


def test_a_state_that_is_kept_goes_on_alike():
    rng = np.random.default_rng(3)
    given = rng.standard_normal((4, 30, 3))
    columns, resumed = Columns(30, 2, WIDTH), Columns(30, 2, WIDTH)
    given_to(columns, given[0])
    given_to(columns, given[1])
    resumed.resume({name: array.copy() for name, array in columns.state().items()})
    for one in (columns, resumed):
        given_to(one, given[2])
        given_to(one, given[3])
    np.testing.assert_array_equal(resumed.mix, columns.mix)
    np.testing.assert_array_equal(resumed.lanes, columns.lanes)


def test_directions_that_do_nothing_cost_nothing():
    columns = Columns(5, 3, WIDTH)
    assert columns.prepare_frame(np.zeros((5, 6)), 1.0).shape == (0, 6)
    assert columns.count == 0 and columns.states().shape == (0, 3, STATE)
