"""Against simulators as simple as they come, of the speed benchmark: a particle grid in Taichi's usual pattern, and one in torch."""

from __future__ import annotations

import pytest

from benchmarks.speed.mpm import TOLERANCE, disagreement, peers
from benchmarks.speed.peers.problem import LAWS, cube


@pytest.mark.parametrize("law", LAWS)
def test_simple_simulators_reach_the_same_state(law):
    problem = cube(law, 1000, 32)
    errors = disagreement(problem, peers(problem, ["Warp"]))
    assert set(errors) == {"naive Taichi", "torch"}
    assert max(errors.values()) < TOLERANCE
