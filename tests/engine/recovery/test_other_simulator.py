"""A force must be recovered from motion made by another simulator: if solver and truth are the same code, both may have the same error.

`genesis_post.npz` is eight frames of a square post of 6 x 5 x 40 cm, held at its upper end, in Genesis 1.4.5's own material point method
(grid of 48 nodes per metre, 150 substeps a frame): 482 particles, E 0.2 MPa, 500 kg/m³, no gravity, in gusts that change along the post and
with time. `acc` [N/kg] is the force on the particles, over their mass.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.command.trajectories.bodies import read_trajectories
from seeing_wind.engine.look.report.accuracy import field_errors, uniform_errors
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.settings import RecoverSettings

FILE = Path(__file__).with_name("genesis_post.npz")


@pytest.fixture(scope="module")
def found():
    seen = read_trajectories(FILE)
    settings = RecoverSettings(gravity=seen.gravity, clamp_depth=seen.clamp_depth)
    return recover(seen.particles, seen.material, [seen.targets], seen.fps, settings, NoProgress())


def test_the_force_is_nearer_to_the_truth_than_a_uniform_one_that_is_known(found):
    """The uniform one has the true net force in every frame: what is found must know how the force changes along the post."""
    with np.load(FILE, allow_pickle=False) as truth:
        want, free = truth["acc"] * float(truth["rho"]), ~truth["fixed"]
    (magnitude, direction), uniform = field_errors(want, found.force_density, free), uniform_errors(want, free)
    assert uniform[0] > 25.0 and uniform[1] > 20.0
    assert magnitude < 10.0 and direction < 10.0  # found: 6.3 % and 7.0 degrees


def test_the_body_moves_as_the_other_simulator_moved_it(found):
    with np.load(FILE, allow_pickle=False) as truth:
        x, free = truth["x"].astype(np.float64), ~truth["fixed"]
    missed, moved = (np.linalg.norm(path[:, free], axis=-1) for path in (found.x - x, x - x[0]))
    assert missed[-1].mean() < 0.02 * moved[-1].mean()


def test_the_stated_deviation_is_that_of_the_error(found):
    """68 % of normally distributed errors lie within one deviation."""
    with np.load(FILE, allow_pickle=False) as truth:
        want, free = truth["acc"] * float(truth["rho"]), ~truth["fixed"]
    within = (np.abs(found.force_density - want) < found.deviation)[:, free].mean()
    assert 0.6 < within < 0.8  # found: 0.68
