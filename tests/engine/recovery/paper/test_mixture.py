"""The paper's schedule and the refinement on a body of two densities: the field is a force density for both."""

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.field import distill, distillation
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Mixture, Outcome, Recovery
from seeing_wind.engine.recovery.paper.refinement import refine
from seeing_wind.engine.recovery.paper.schedule import recover_by_descent
from seeing_wind.engine.settings import RecoverSettings
from tests.engine.recovery.bodies import FPS, RUBBER, WEIGHTLESS, blow, plate, points

FORCE = RUBBER.density * np.array([2.0, 0.5, -1.0])
STIFF = replace(RUBBER, youngs_modulus=4e4)


def two_densities(shape):
    """A free block of which one half has half of the density."""
    body = plate(shape)
    count = len(body.x)
    return replace(body, mixture=Mixture(np.where(body.x[:, 0] > 0.0, 0.5, 1.0), np.ones(count), np.full(count, 0.3), np.zeros(count)))


def blown(body, frames):
    return blow(body, lambda X, t: FORCE / body.density(STIFF)[:, None], frames, material=STIFF)[0]


def test_a_uniform_force_density_comes_back_frame_by_frame() -> None:
    body = two_densities((4, 3, 3))
    chosen = RecoverSettings(gravity=(0.0, 0.0, 0.0), schedule="paper", representation="causal_triplane", frame_iterations=60)
    found = recover_by_descent(body, STIFF, points(body, blown(body, 2)), FPS, chosen, NoProgress())
    for half in (body.x[:, 0] > 0.0, body.x[:, 0] < 0.0):
        mean = found.force_density[:, half].mean(axis=(0, 1))
        assert np.linalg.norm(mean - FORCE) < 0.12 * np.linalg.norm(FORCE)


def test_a_field_that_was_distilled_from_the_force_density_makes_it_move_as_recovered(monkeypatch: pytest.MonkeyPatch) -> None:
    body = two_densities((6, 4, 2))
    x = blown(body, 8)
    force = np.broadcast_to(FORCE, x[1:].shape).copy()
    eye = np.tile(np.eye(3), (*x.shape[:2], 1, 1))
    recovery = Recovery(
        Outcome.CONVERGED, force, np.full(force.shape, 4.0), x, eye, np.zeros_like(body.x), np.zeros(len(x)), "m", 1, 0.1
    )
    monkeypatch.setattr(distillation, "ITERATIONS", 60)
    field = distill(recovery, body, FPS, "causal_triplane")
    refined = refine(field, recovery, body, STIFF, replace(WEIGHTLESS, refine=1), NoProgress())
    travelled = np.sqrt(((x - x[0]) ** 2).sum(axis=-1).mean())
    assert refined.before < 0.05 * travelled
