"""From one block of a clip to the next."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.errors import SimulationError
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Outcome, TrackTargets
from seeing_wind.engine.recovery.prior.constants import PRIOR
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.recovery.solve import block as blocks
from seeing_wind.engine.recovery.solve import onward
from seeing_wind.engine.recovery.solve.constants import PACE
from seeing_wind.engine.settings import RecoverSettings
from tests.engine.recovery.bodies import FPS, RUBBER, blow, camera, every, plate, points, relative

FRAMES = 20
GIVEN = RecoverSettings(gravity=(0.0, 0.0, 0.0), stiffness="given")


def gusts(X, t):
    """Two gusts across the post, one in each block, from different sides."""
    return np.zeros_like(X) + [3.0 * np.sin(0.4 * t), 2.0 * (t > 11), 0.0]


@pytest.fixture(scope="module")
def blown():
    body = plate((2, 2, 9), pinned=lambda X: X[:, 2] < -0.07)
    return (body, *blow(body, gusts, FRAMES))


@pytest.fixture
def followed(monkeypatch):
    """Blocks of about ten frames; returns the first frames of the blocks that were followed from the start."""
    monkeypatch.setattr(sys.modules["seeing_wind.engine.recovery.blocks"], "PACE", replace(PACE, block=12, overlap=4))
    found, follow = [], blocks.follow
    monkeypatch.setattr(blocks, "follow", lambda solver, *rest: found.append(solver.objective.first) or follow(solver, *rest))
    return found


def recovered(blown, seen=points):
    body, x, wind = blown
    found = recover(body, RUBBER, [seen(body, x)], FPS, GIVEN, NoProgress())
    free = ~body.pinned
    return relative(found.force_density[:, free, 0] / RUBBER.density, wind[:, free, 0])


def filmed(body, x, noise=0.05):
    xy = np.stack([camera().project(one, t)[0] for t, one in enumerate(x)])
    xy[1:] += noise * np.random.default_rng(0).standard_normal(xy[1:].shape)
    return TrackTargets(xy, np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], noise), camera(), every(body))


def test_a_later_block_states_more_deviation_as_it_takes_its_start_for_exact(blown, followed, monkeypatch):
    body, x, _ = blown

    def stated():
        return recover(body, RUBBER, [points(body, x)], FPS, GIVEN, NoProgress()).deviation[:, ~body.pinned]

    more = stated()
    monkeypatch.setattr(sys.modules["seeing_wind.engine.recovery.kept"], "PRIOR", replace(PRIOR, later_optimism=1.0))
    posterior = stated()
    assert (more[:8] == posterior[:8]).all() and (more[8:] > posterior[8:]).all()


def test_a_held_body_is_followed_once_and_goes_on_with_the_force_so_far(blown, followed):
    error = recovered(blown)
    assert followed == [0]
    assert error < 0.1


def test_so_does_one_that_is_filmed(blown, followed, monkeypatch):
    error = recovered(blown, filmed)
    assert followed == [0]
    monkeypatch.setattr(onward, "PACE", replace(PACE, refollow_misfit=0.0))
    again = recovered(blown, filmed)
    assert followed == [0, 0, 8]
    assert error < 1.25 * again


@pytest.mark.parametrize("refused", ["astray", "broken"])
def test_where_that_field_loses_the_body_it_is_followed_again(blown, followed, monkeypatch, refused):
    if refused == "astray":
        monkeypatch.setattr(onward, "PACE", replace(PACE, refollow_misfit=0.0))
    else:

        def broken(*arguments):
            raise SimulationError("The body was torn.", "Nothing.")

        monkeypatch.setattr(onward, "prior_along", broken)
    error = recovered(blown)
    assert followed == [0, 8]
    assert error < 0.1


def test_so_does_one_that_is_free(followed):
    body = plate()
    x, wind = blow(body, gusts, FRAMES)
    found = recover(body, RUBBER, [points(body, x)], FPS, GIVEN, NoProgress())
    assert followed == [0]
    assert relative(found.force_density / RUBBER.density, wind) < 0.1


def test_a_draft_of_one_iteration_does_not_take_the_two_of_going_on(blown, followed):
    body, x, _ = blown
    found = recover(body, RUBBER, [points(body, x)], FPS, replace(GIVEN, iterations=1), NoProgress())
    assert followed == [0, 8] and found.outcome is Outcome.MAX_ITERATIONS
