"""The kernels against their slow twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from tests.engine.mpm.bodies import RUBBER, block
from tests.reference import mpm as twin


@pytest.mark.parametrize("law", ["corotated", "neo_hookean", "von_mises", "viscoplastic"])
@pytest.mark.parametrize("pinned_below", [None, 0.022])
def test_two_substeps_match_the_twin(law, pinned_below):
    particles = block((2, 2, 4), pinned_below=pinned_below)
    material = replace(RUBBER, law=law, yield_stress=800.0, viscosity=2.0)
    model, _ = model_for(particles, replace(material, loss_factor=0.01), 30.0)
    dt = model.frame_dt / model.substeps
    rng = np.random.default_rng(0)
    count = model.particles
    state = State(
        particles.x, rng.normal(size=(count, 3)), rng.normal(size=(count, 3, 3)), np.eye(3) + 0.05 * rng.normal(size=(count, 3, 3))
    )
    for array in (state.v, state.C):
        array[particles.pinned] = 0.0
    state.F[particles.pinned] = np.eye(3)
    acceleration, gradient = 100 * rng.normal(size=(count, 3)), 1000 * rng.normal(size=(count, 3, 3))
    path = rollout(replace(model, substeps=2, frame_dt=2 * dt), state, acceleration[None], gradient[None])
    assert path.substeps[0] == 2
    slow = state
    for _ in range(2):
        slow = State(*twin.substep(model, law, dt, slow, acceleration + model.gravity, gradient))
    for got, want in zip((path.x[1], path.v[1], path.C[1], path.F[1]), (slow.x, slow.v, slow.C, slow.F)):
        # Particles out of reach of free nodes take no part; the twin moves them by rounding only.
        assert np.allclose(got, want, rtol=1e-10, atol=1e-10 * np.abs(want).max())
    if law in ("von_mises", "viscoplastic"):
        stretchy = replace(model, substeps=2, frame_dt=2 * dt, yield_stress=1e9 * model.yield_stress)
        elastic = rollout(stretchy, state, acceleration[None], gradient[None])
        assert not np.allclose(elastic.F[1], path.F[1], atol=1e-3)
