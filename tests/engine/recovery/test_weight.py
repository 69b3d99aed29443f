"""A held body is assumed to bear its weight in its shape of frame 0, unless it is seen to sag."""

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.conventions import GRAVITY
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.recovery.diagnostics.remarks import BORNE
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.recovery.targets.objective import Objective
from seeing_wind.engine.recovery.targets.points import point_channels
from seeing_wind.engine.recovery.targets.weight import bears_weight
from seeing_wind.engine.settings import RecoverSettings
from tests.engine.recovery.bodies import FPS, RUBBER, blow, plate, points, relative

FRAMES = 16
BRANCH = replace(RUBBER, youngs_modulus=3e4)
"""Held at one end, it hangs by a fifth of its length."""


def branch():
    """A level bar, held at its left."""
    return plate((12, 2, 2), pinned=lambda X: X[:, 0] < -0.08)


def gusts(X, t):
    return np.zeros_like(X) + [0.0, 3.0 * np.sin(0.5 * t), 1.5 * (t > 7)]


def bears(body, x):
    model, _ = model_for(body, BRANCH, FPS, gravity=GRAVITY)
    return bears_weight(model, body.x, Objective([point_channels(body, points(body, x), False)]))


def test_one_that_is_let_go_without_a_load_is_seen_to_sag():
    body = branch()
    x, wind = blow(body, gusts, FRAMES, gravity=GRAVITY, material=BRANCH)
    assert not bears(body, x)
    found = recover(body, BRANCH, points(body, x), FPS, RecoverSettings(gravity=GRAVITY, stiffness="given"), NoProgress())
    free = ~body.pinned
    assert found.borne is None and BORNE not in found.notes
    off = found.force_density[:, free] / BRANCH.density - wind[:, free]
    assert np.linalg.norm(off.mean(axis=(0, 1))) < 0.1 * np.linalg.norm(GRAVITY)


@pytest.mark.parametrize("velocity", [0.0, -0.4])
def test_one_that_stands_bears_it_whichever_way_it_swings(velocity):
    """Seen in frame 0 on its way down, too: an even motion is no sag."""
    body = branch()
    swing = np.zeros_like(body.x)
    swing[:, 2] = velocity * np.maximum(body.x[:, 0] + 0.08, 0.0) / 0.2
    x, wind = blow(body, gusts, FRAMES, velocity=swing, material=BRANCH)
    assert bears(body, x)
    found = recover(body, BRANCH, points(body, x), FPS, RecoverSettings(gravity=GRAVITY, stiffness="given"), NoProgress())
    free = ~body.pinned
    np.testing.assert_array_equal(found.borne, GRAVITY)
    assert BORNE in found.notes
    assert relative(found.force_density[:, free] / BRANCH.density, wind[:, free]) < 0.5


def test_one_that_is_free_or_told_to_have_no_weight_bears_none():
    free = plate((6, 2, 2))
    x, _ = blow(free, gusts, 6, gravity=GRAVITY)
    assert recover(free, RUBBER, points(free, x), FPS, RecoverSettings(gravity=GRAVITY), NoProgress()).borne is None
    held = branch()
    x, _ = blow(held, gusts, 6, material=BRANCH)
    settings = RecoverSettings(gravity=(0.0, 0.0, 0.0), stiffness="given")
    assert recover(held, BRANCH, points(held, x), FPS, settings, NoProgress()).borne is None
