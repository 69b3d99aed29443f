"""Against another simulator: its force, its first state and the paths of what it holds must give its motion.

The force comes as an acceleration per particle and frame; its gradient is taken from neighbours. See benchmarks/accuracy/solver_truth.py.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy.solver_truth import drive, travelled


@pytest.mark.parametrize("name, bound", [("sheet", 0.005), ("banner", 0.01), ("pole", 0.02), ("clay", 0.02)])
def test_the_true_force_gives_the_true_motion(shared, name, bound):
    truth = np.load(shared / "truth" / f"{name}.npz", allow_pickle=False)
    path, _ = drive(truth)
    free = ~truth["fixed"]
    error = np.linalg.norm(path.x - truth["x"], axis=-1)[:, free]
    assert error[-1].mean() < bound * travelled(truth)
    assert np.allclose(path.x[:, ~free], truth["x"][:, ~free], atol=1e-6)


def test_a_clamp_that_stands_still_bends_the_post_about_as_far(shared):
    truth = np.load(shared / "truth" / "pole.npz", allow_pickle=False)
    # What the file calls fixed are the particles that moved less than half a millimetre, some of them above the clamp.
    path, _ = drive(truth, kinematic=False, clamp_depth=0.5)
    top = truth["x"][0][:, 2] > 0.48
    got, want = ((x[:, top] - truth["x"][0][top]).mean(axis=1)[:, :2] for x in (path.x, truth["x"]))
    assert (got * want).sum() / (want * want).sum() == pytest.approx(1.0, abs=0.07)
    free = ~truth["fixed"]
    error = np.sqrt(((path.x - truth["x"])[:, free] ** 2).sum(-1).mean())
    assert error < 0.12 * np.sqrt(((truth["x"] - truth["x"][0])[:, free] ** 2).sum(-1).mean())
