"""Many substeps in one launch do what they do one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.errors import SimulationError
from seeing_wind.engine.mpm.body import Body
from seeing_wind.engine.mpm.checks import checked_state
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.progress import NoProgress
from tests.engine.mpm.bodies import RUBBER, block


def problem(speed=0.0, spread=0.0, substeps=40):
    """A free block that flies along x at `speed` [m/s] and grows at the rate `spread` [1/s], in substeps of which the last lies alone."""
    body = block((6, 5, 7))
    model, _ = model_for(body, replace(RUBBER, law="von_mises", yield_stress=300.0), 30.0)
    model = replace(model, substeps=substeps, frame_dt=model.frame_dt / model.substeps * substeps)
    x = body.x - body.x.mean(axis=0)
    v = spread * x + np.array([speed, 0.0, 0.0])
    return model, State(body.x, v, np.tile(spread * np.eye(3), (len(x), 1, 1)), np.tile(np.eye(3), (len(x), 1, 1)))


def run(model, state, one_by_one, tasks=3, workers=2, force=0.0):
    """The state after a frame and the frame's run, the body, and launches of the forward kernel."""
    body = Body(model, tasks=tasks, workers=workers)
    launches, launch = [], body.forward_kernel
    body.forward_kernel = lambda *args: (launches.append(args[1]), launch(*args))
    found = body.frame(
        checked_state(model, state), force + np.zeros_like(state.x), None, 0, NoProgress(), lambda substeps: 1 if one_by_one else substeps
    )
    return found, body, launches


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_all_in_one_launch_and_one_by_one_are_the_same_to_the_bit(workers):
    model, state = problem(speed=1.0, spread=2.0)
    (single, _), _, each = run(model, state, one_by_one=True, workers=workers)
    (many, _), _, launches = run(model, state, one_by_one=False, workers=workers)
    assert each == [1] * model.substeps
    assert launches == [1, model.substeps - 1]  # the first leaves the state that is kept alone
    assert all(np.array_equal(getattr(single, name), getattr(many, name)) for name in "xvCF")


def test_a_body_that_outgrows_its_grids_goes_on_in_larger_ones():
    model, state = problem(substeps=120)
    apart = 4e4 * (state.x - state.x.mean(axis=0))
    (single, _), _, _ = run(model, state, one_by_one=True, force=apart)
    (many, _), _, launches = run(model, state, one_by_one=False, force=apart)
    assert np.ptp(many.x[:, 0]) > 2.0 * np.ptp(state.x[:, 0])
    assert len(launches) > 3  # more than 1, 64 and 55
    assert all(np.array_equal(getattr(single, name), getattr(many, name)) for name in "xvCF")


def test_the_substep_that_breaks_is_named_and_the_last():
    model, state = problem()
    # Too fast after some twenty substeps, also at half the length.
    pull = model.dx / (model.frame_dt / model.substeps / 2.0) / (0.5 * model.frame_dt)
    said = []
    for one_by_one in (True, False):
        with pytest.raises(SimulationError, match="moved more than one grid cell") as caught:
            run(model, state, one_by_one=one_by_one, force=[pull, 0.0, 0.0])
        said.append((caught.value.message, caught.value.substep, caught.value.particle))
    assert said[0] == said[1]
    assert 20 <= said[0][1] < 2 * model.substeps - 1


@pytest.mark.parametrize("tasks", [7, 8])
def test_bodies_far_apart_need_no_grid_of_the_whole_window_for_every_task(tasks):
    body = block((6, 6, 6))
    far = replace(body, x=body.x + 0.7)
    model, _ = model_for([body, far], RUBBER, 30.0)
    state = State.at_rest(np.concatenate([body.x, far.x]))
    (one, _), _, _ = run(model, state, one_by_one=False, tasks=1)
    (many, _), found, _ = run(model, state, one_by_one=False, tasks=tasks)
    assert np.abs(many.x - one.x).max() < 1e-12 * np.abs(one.x - state.x).max()
    assert len(found.grid) < 2.5 * len(found.velocity)  # a task may hold particles of both


def test_more_tasks_than_particles_are_as_many_as_particles():
    model, _ = model_for(block((2, 1, 1)), RUBBER, 30.0)
    state = State.at_rest(block((2, 1, 1)).x)
    (_, frame), found, _ = run(model, state, one_by_one=False, tasks=5, workers=3)
    assert found.packing.tasks == found.workers == 2 and frame.substeps == model.substeps
