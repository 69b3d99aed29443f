"""Many copies of a body at once move as each would alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.errors import SimulationError
from seeing_wind.engine.mpm.batch import rollout_batch
from seeing_wind.engine.mpm.lattice.colliders import Plane
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import advance, rollout
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.progress import Cancelled, Progress
from tests.engine.mpm.bodies import RUBBER, affine_basis, block, still


@pytest.mark.parametrize("what", ["held", "damped", "on a floor", "held by pins that move"])
def test_copies_equal_single_rollouts(what):
    body = block(pinned_below=None if what == "on a floor" else 0.015)
    more = {}
    if what == "on a floor":
        more["colliders"] = [Plane((0.0, 0.0, body.x[:, 2].min() - 0.002), (0.1, 0.0, 1.0), friction=0.3)]
    if what == "held by pins that move":
        more["pin_path"] = body.x[body.pinned] + np.linspace(0.0, 0.02, 4)[:, None, None] * np.array([1.0, 0.0, 0.5])
    model, _ = model_for(body, replace(RUBBER, loss_factor=0.05 if what == "damped" else 0.0), 30.0, **more)
    assert what != "damped" or model.viscosity.any()
    phi, dphi = affine_basis(body.x)
    rng = np.random.default_rng(0)
    coefficients = 5 * rng.normal(size=(4, 3, 4, 3))
    v0 = 0.1 * rng.normal(size=(4, model.particles, 3)) * ~body.pinned[:, None]
    every = rollout_batch(model, State.at_rest(body.x), phi, dphi, coefficients, v0=v0)
    assert not every.failed.any()
    for b in range(4):
        state = State.at_rest(body.x, v0[b])
        for t in range(3):
            acceleration = phi @ coefficients[b, t]
            gradient = np.einsum("jc,njk->nck", coefficients[b, t], dphi) @ np.linalg.inv(state.F)
            state = advance(model, state, acceleration, gradient, frame=t)
            for name in ("x", "v", "C", "F"):
                assert np.allclose(getattr(every.paths[b], name)[t + 1], getattr(state, name), atol=1e-8), name
        assert np.allclose(every.x[b], every.paths[b].x) and list(every.paths[b].substeps) == 3 * [model.substeps]


def test_a_broken_copy_is_marked_and_leaves_the_others_alone():
    body = block()
    model, _ = model_for(body, RUBBER, 30.0)
    phi, dphi = affine_basis(body.x)
    coefficients = np.zeros((3, 3, 4, 3))
    coefficients[1, 1, 0, 0] = 1e5
    found = rollout_batch(model, State.at_rest(body.x), phi, dphi, coefficients)
    assert list(found.failed_frame) == [-1, 1, -1] and list(found.failed) == [False, True, False]
    assert np.isfinite(found.x[[0, 2]]).all() and np.isfinite(found.x[1, :2]).all() and np.isnan(found.x[1, 2:]).all()
    with pytest.raises(SimulationError):
        rollout_batch(model, State.at_rest(body.x), phi, dphi, coefficients, strict=True)


def test_cancelling_stops_between_calls():
    body = block()
    model, _ = model_for(body, RUBBER, 30.0)
    asked = []

    def cancelled():
        asked.append(True)
        return len(asked) > 3

    with pytest.raises(Cancelled):
        rollout(model, State.at_rest(body.x), still(model, 50), progress=Progress(cancelled=cancelled))
    assert len(asked) == 4
