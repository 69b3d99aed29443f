"""Refinement: a simulation in the stored field comes nearer to the recovered motion, and its derivatives are right."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.errors import SimulationError
from seeing_wind.engine.field import distill, distillation
from seeing_wind.engine.look.report.accuracy import field_errors
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import advance
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.progress import Cancelled, Journal, NoProgress, Progress
from seeing_wind.engine.records import Outcome, Recovery
from seeing_wind.engine.recovery.paper.refinement import SEGMENT, _Run, refine
from seeing_wind.engine.recovery.stage import recover_stage
from seeing_wind.engine.take import Take
from tests.engine.recovery.bodies import FPS, RUBBER, WEIGHTLESS, blow, plate, points

FRAMES = SEGMENT + 4
SLOPE = np.array([[0.0, 5.0, 10.0], [0.0, 0.0, 8.0], [0.0, 0.0, 0.0]])
REFINED = replace(WEIGHTLESS, refine=5)


@pytest.fixture(scope="module")
def known():
    """A body, and a recovery that holds the true wind."""
    body = plate((6, 4, 2))
    x, wind = blow(body, lambda X, t: [2.0 * np.cos(0.3 * t), 0.5, 1.0] + X @ SLOPE, FRAMES)
    eye = np.tile(np.eye(3), (*x.shape[:2], 1, 1))
    deviation, residual = np.full(wind.shape, 4.0), np.zeros(len(x))
    return body, Recovery(Outcome.CONVERGED, 400.0 * wind, deviation, x, eye, np.zeros_like(body.x), residual, "m", 1, 0.1)


@pytest.fixture(scope="module", params=["causal_triplane", pytest.param("kplanes", marks=pytest.mark.slow)])
def rough(request, known):
    """A coarsely distilled field."""
    body, recovery = known
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(distillation, "ITERATIONS", 60)
        return distill(recovery, body, FPS, request.param)


def stray(field, body, recovery):
    """How far the body is off when the plain solver moves it through the field [m]."""
    model, _ = model_for(body, RUBBER, FPS, gravity=(0.0, 0.0, 0.0))
    state, squares = State.at_rest(body.x), []
    for t in range(FRAMES):
        state = advance(model, state, field.sample(state.x, t)[0] / 400.0, field.gradient(state.x, t) / 400.0)
        squares.append(((state.x - recovery.x[t + 1]) ** 2).sum(axis=-1).mean())
    return np.sqrt(np.mean(squares))


def test_the_body_strays_less_and_the_force_stays(known, rough):
    body, recovery = known
    found = refine(rough, recovery, body, RUBBER, REFINED, NoProgress())
    assert found.after < 0.6 * found.before
    # The plain solver in the field as it is sampled agrees, so the gain is not one of the linearised field only.
    assert stray(rough, body, recovery) == pytest.approx(found.before, rel=0.2)
    assert stray(found.field, body, recovery) < 0.6 * stray(rough, body, recovery)
    errors = [field_errors(recovery.force_density, np.stack([one.sample(recovery.x[t], t)[0] for t in range(FRAMES)]), ~body.pinned)
              for one in (rough, found.field)]  # fmt: skip
    assert errors[1][0] < errors[0][0] + 1.0 and errors[1][1] < errors[0][1] + 1.0


def test_the_derivatives_are_those_of_the_loss(known, rough):
    """Within one segment, where no derivatives are cut."""
    body, recovery = known
    force, deviation, x, F = recovery.force_density[:4], recovery.deviation[:4], recovery.x[:5], recovery.F[:5]
    short = replace(recovery, force_density=force, deviation=deviation, x=x, F=F)
    module = type(rough.module)(FRAMES, **rough.module.shape).double()
    module.load_state_dict(rough.module.state_dict())
    run = _Run(rough, module, short, body, RUBBER, REFINED, Journal())
    run.backward(NoProgress(), "")
    random = torch.Generator().manual_seed(0)
    for parameter in (module.decoder[-1].weight, next(module.planes.parameters()), module.decoder[-1].bias):
        towards = torch.randn(parameter.shape, generator=random, dtype=torch.float64)
        slope, step = float((parameter.grad * towards).sum()), 1e-5
        values = []
        for sign in (1.0, -1.0):
            with torch.no_grad():
                parameter.add_(sign * step * towards)
            kept = [None if one.grad is None else one.grad.clone() for one in module.parameters()]
            values.append(run.backward(NoProgress(), "")[0])
            for one, grad in zip(module.parameters(), kept, strict=True):
                one.grad = grad
            with torch.no_grad():
                parameter.sub_(sign * step * towards)
        assert (values[0] - values[1]) / (2 * step) == pytest.approx(slope, rel=1e-3)


def test_the_same_twice_and_point_forces_as_they_are(known, rough):
    body, recovery = known
    few = replace(REFINED, refine=2)
    twice = [refine(rough, recovery, body, RUBBER, few, NoProgress()).field for _ in range(2)]
    np.testing.assert_array_equal(*(one.sample(body.x, 3)[0] for one in twice))
    point = distill(recovery, body, FPS, "point")
    assert refine(point, recovery, body, RUBBER, few, NoProgress()).field is point


def test_it_can_be_cancelled_and_a_body_that_breaks_is_told(known, rough, monkeypatch):
    body, recovery = known
    with pytest.raises(Cancelled):
        refine(rough, recovery, body, RUBBER, REFINED, Progress(lambda message: None, lambda: True))

    def broken(*_, **__):
        raise SimulationError("It broke.", "Try another.")

    told: list[dict] = []
    monkeypatch.setattr("seeing_wind.engine.recovery.paper.refinement.simulate", broken)
    assert refine(rough, recovery, body, RUBBER, REFINED, Progress(told.append)).field is rough
    assert any("not refined" in str(one) for one in told)


def test_a_solve_that_is_done_is_refined_without_another(known, tmp_path, monkeypatch):
    body, recovery = known
    solves = []
    monkeypatch.setattr(distillation, "ITERATIONS", 60)
    monkeypatch.setattr("seeing_wind.engine.recovery.stage.recover", lambda *_: solves.append(1) or recovery)
    take, times, few = Take(tmp_path / "a.take"), [], replace(WEIGHTLESS, refine=2)
    for settings in (WEIGHTLESS, few, few):
        times.append(recover_stage(take, body, RUBBER, points(body, recovery.x), FPS, "up", settings, NoProgress())[2:])
    assert len(solves) == 1
    assert ["refine" in seconds for seconds, _ in times] == [False, True, False]
    assert [[*expected] for _, expected in times] == [["recover"], [], []]
