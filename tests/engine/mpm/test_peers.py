"""Against simulators as simple as they come, of the speed benchmark: a particle grid in Taichi's usual pattern, and one in torch."""

from __future__ import annotations

import pytest

from benchmarks.speed.mpm import TOLERANCE, disagreement, peers
from benchmarks.speed.peers.problem import LAWS, cube
from seeing_wind.engine.mpm.compiler import device
from seeing_wind.engine.mpm.compiler.settings import compiled_sooner


@pytest.mark.parametrize("law", LAWS)
def test_simple_simulators_reach_the_same_state(law):
    problem = cube(law, 1000, 32)
    device.start()
    with compiled_sooner():  # the kernels that know nothing of it: how fast they are, only the benchmark asks
        others = peers(problem, ["Warp"])
        others[0].run(1)
        others[0].reset()
    errors = disagreement(problem, others)
    assert set(errors) == {"naive Taichi", "torch"}
    assert max(errors.values()) < TOLERANCE
