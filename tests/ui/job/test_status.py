"""What the panel says of a running job: how long it still takes."""

from __future__ import annotations

from pathlib import Path

import pytest

from seeing_wind.ui.job import status


def test_the_time_that_is_left_is_said_once_it_can_be() -> None:
    step = status.Step(status.State.RUNNING, fraction=0.25, started=100.0)
    assert status.remaining(step, 130.0) == pytest.approx(90.0)
    step.fraction = 0.01
    assert status.remaining(step, 130.0) is None and status.remaining(status.Step(), 130.0) is None
    assert [status.in_words(seconds) for seconds in (2.0, 42.0, 89.0, 600.0, 9000.0)] == ["5 s", "40 s", "1 min", "10 min", "2.5 h"]


def test_the_time_that_is_left_after_a_resume_counts_this_run_only() -> None:
    of_scene = status.SceneStatus()
    status.begin(of_scene, "recover", "Recover")
    step = of_scene.steps["recover"]
    for stage in ("observe", "build"):
        status.receive(of_scene, "recover", {"type": "progress", "stage": stage, "fraction": 0.0, "message": status.KEPT})
    assert step.fraction == step.inherited == 0.25
    step.started = 100.0
    status.receive(of_scene, "recover", {"type": "progress", "stage": "recover", "fraction": 0.0, "message": "going"})
    assert status.remaining(step, 102.0) is None, "nothing is done yet in this run"
    status.receive(of_scene, "recover", {"type": "progress", "stage": "recover", "fraction": 0.25, "message": "going"})
    assert status.remaining(step, 130.0) == pytest.approx(30.0 / 0.15 * 0.6)


def test_flags_are_called_as_the_panel_calls_them() -> None:
    now = status.SceneStatus()
    status.begin(now, "recover", "Recover")
    status.receive(now, "recover", {"type": "warning", "message": "Give --distance or --pixels-per-metre for absolute values."})
    assert now.warnings == ["Give Distance or Scale for absolute values."]
    said = {"message": "`--distance` must be above 0 m; this is -2.", "hint": "Add --schedule paper, or leave --view out."}
    status.receive(now, "recover", {"type": "error", **said})
    step = now.steps["recover"]
    assert (step.message, step.hint) == ("Distance must be above 0 m; this is -2.", "Add --schedule paper, or leave Further Views out.")


def test_what_the_engine_says_of_a_finished_stage_is_what_the_panel_waits_for() -> None:
    from seeing_wind.engine import take

    assert f'"{status.KEPT}"' in Path(take.__file__).read_text()
