"""What is reported of a wind: its figures, and which forces are not a wind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.recovery.prior.kernel import Kernel
from seeing_wind.engine.recovery.wind.estimate import Estimate
from seeing_wind.engine.recovery.wind.verdict import beaufort, figures, objection, sentence
from tests.engine.recovery.wind.blown_plate import DENSITY, FPS

NOTHING = (0.0, 0.0, 0.0)
DOWN = (0.0, 0.0, -9.81)


def estimate(velocity, unexplained=0.02):
    deviation = np.full(velocity.shape, 0.1)
    return Estimate(velocity, deviation, velocity.mean(axis=(0, 1)), Kernel(np.eye(3)), (0.01, 0.01), unexplained, 0.0)


def breeze(frames, count, speed=6.0):
    return np.broadcast_to([0.0, 0.0, speed], (frames, count, 3))


@pytest.mark.parametrize(("speed", "number"), [(0.0, 0), (0.3, 1), (3.3, 2), (5.5, 4), (10.7, 5), (32.6, 11), (32.7, 12), (80.0, 12)])
def test_beaufort_numbers(speed, number):
    assert beaufort(speed) == number


def test_a_breeze_is_no_cause_for_doubt(blown):
    recovery, particles, _ = blown
    assert objection(estimate(breeze(*recovery.deviation.shape[:2])), recovery, particles, DENSITY, FPS, NOTHING) == ""


def test_what_holds_a_body_up_is_no_wind(blown):
    recovery, particles, _ = blown
    still = np.repeat(recovery.x[:1], len(recovery.x), axis=0)
    force = np.zeros_like(recovery.force_density)
    force[..., 2] = 9.81 * DENSITY
    held_up = replace(recovery, x=still, force_density=force)
    assert "against gravity" in objection(estimate(breeze(*recovery.deviation.shape[:2])), held_up, particles, DENSITY, FPS, DOWN)


def test_a_tossed_body_tells_of_no_wind(blown):
    recovery, particles, _ = blown
    t = np.arange(len(recovery.x)) / FPS
    fall = np.stack([2.0 * t, 0.0 * t, 3.0 * t - 4.905 * t**2], axis=1)
    tossed = replace(recovery, x=particles.x + fall[:, None], force_density=np.full_like(recovery.force_density, 1e-3))
    assert "no air" in objection(estimate(breeze(*recovery.deviation.shape[:2])), tossed, particles, DENSITY, FPS, DOWN)


def test_a_magnet_would_need_a_storm(blown):
    recovery, particles, _ = blown
    storm = estimate(breeze(*recovery.deviation.shape[:2], speed=90.0))
    assert "90 m/s" in objection(storm, recovery, particles, DENSITY, FPS, NOTHING)


def test_a_force_that_no_wind_explains(blown):
    recovery, particles, _ = blown
    doubtful = estimate(breeze(*recovery.deviation.shape[:2]), unexplained=0.7)
    assert "70 %" in objection(doubtful, recovery, particles, DENSITY, FPS, NOTHING)


def test_figures_are_of_the_wind_over_the_body():
    velocity = np.zeros((4, 5, 3))
    velocity[:, :, 0] = np.array([4.0, 6.0, 4.0, 6.0])[:, None]
    told = figures(estimate(velocity))
    assert told["unit"] == "m/s"
    assert told["mean_velocity"] == [5.0, 0.0, 0.0]
    assert told["gusts_rms"] == pytest.approx(1.0)
    assert told["beaufort"] == {"mean": 3, "strongest_gust": 4}
    assert "5 m/s (Beaufort 3)" in sentence(told)
    assert "not measured" in sentence(told)
