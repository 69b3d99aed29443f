"""The two errors of the paper."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.look.report import field_errors, uniform_errors


def forces(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(6, 30, 3)) + [0, 0, 4]


def test_no_error():
    assert field_errors(forces(), forces()) == pytest.approx((0, 0), abs=1e-5)


def test_a_stronger_force_and_a_turned_one():
    assert field_errors(forces(), 1.2 * forces()) == pytest.approx((20, 0), abs=1e-5)
    turned = np.tile([0.0, np.sin(0.3), np.cos(0.3)], (2, 5, 1))
    assert field_errors(np.tile([0.0, 0.0, 1.0], (2, 5, 1)), turned) == pytest.approx((0, np.degrees(0.3)))


def test_held_particles_and_weak_forces_do_not_count():
    want, got = forces(), forces()
    free = np.arange(30) >= 10
    got[:, ~free] *= 9
    want[2] *= 1e-3
    got[2] *= -5
    assert field_errors(want, got, free) == pytest.approx((0, 0), abs=1e-5)


def test_the_same_numbers_as_the_published_score(shared):
    sys.path.insert(0, str(shared / "truth"))
    try:
        from score import score
    finally:
        sys.path.pop(0)
    with np.load(shared / "truth" / "pole.npz", allow_pickle=False) as file:
        truth = dict(file)
    want = truth["acc"] * float(truth["rho"])
    got = want + np.random.default_rng(1).normal(size=want.shape) * 0.3 * np.abs(want).mean()
    assert field_errors(want, got, ~truth["fixed"]) == pytest.approx(score(truth, got), rel=1e-6)


def test_a_uniform_field_scores_what_its_variation_costs():
    want = np.tile([1.0, 0.0, 0.0], (3, 8, 1))
    assert uniform_errors(want) == pytest.approx((0, 0), abs=1e-5)
    want[:, ::2] = [0.0, 1.0, 0.0]
    assert uniform_errors(want) == pytest.approx((100 * (1 - np.sqrt(0.5)), 45))


NOTHING = np.zeros((2, 3, 3))
INCOMPARABLE = [(forces(), forces()[:-1]), (forces(), np.full((6, 30, 3), np.nan)), (NOTHING, NOTHING), (forces()[0], forces()[0])]


@pytest.mark.parametrize("want, got", INCOMPARABLE)
def test_what_cannot_be_compared(want, got):
    with pytest.raises(UsageError):
        field_errors(want, got)
