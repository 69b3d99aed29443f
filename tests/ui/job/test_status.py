"""What the panel says of a running job: how long it still takes."""

from __future__ import annotations

from pathlib import Path

import pytest

from seeing_wind.engine.conventions import as_in_file, frame_named, frames_named
from seeing_wind.engine.observe.mask.from_box import NEITHER
from seeing_wind.engine.progress import in_words
from seeing_wind.ui.clip.inputs.pace import Pace
from seeing_wind.ui.job import operator, status
from seeing_wind.ui.job.panel_words import in_panel_words, in_scene_frames


def test_the_time_that_is_left_is_said_once_it_can_be() -> None:
    step = status.Step(status.State.RUNNING, fraction=0.25, started=100.0)
    assert status.remaining(step, 130.0) == pytest.approx(90.0)
    step.fraction = 0.01
    assert status.remaining(step, 130.0) is None and status.remaining(status.Step(), 130.0) is None
    said = [in_words(seconds) for seconds in (2.0, 42.0, 89.0, 600.0, 9000.0)]
    assert said == ["5 seconds", "40 seconds", "a minute", "10 minutes", "2.5 hours"]


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


def test_what_the_solve_takes_is_known_while_it_runs() -> None:
    of_scene = status.SceneStatus()
    status.begin(of_scene, "recover", "Recover")
    told = {"type": "progress", "stage": "recover", "fraction": 0.0, "message": "recovering the force", "expected_seconds": 170.0}
    assert status.receive(of_scene, "recover", told) and of_scene.steps["recover"].expected == 170.0
    status.begin(of_scene, "recover", "Recover")
    assert of_scene.steps["recover"].expected is None, "it was another solve"


def test_flags_are_called_as_the_panel_calls_them() -> None:
    now = status.SceneStatus()
    status.begin(now, "recover", "Recover")
    status.receive(now, "recover", {"type": "warning", "message": "Give --distance or --pixels-per-metre for absolute values."})
    assert now.warnings == ["Give Distance or Scale for absolute values."]
    said = {"message": "`--distance` must be above 0 m; this is -2.", "hint": "Add --schedule paper, or leave --view out."}
    status.receive(now, "recover", {"type": "error", **said})
    step = now.steps["recover"]
    assert (step.message, step.hint) == ("Distance must be above 0 m; this is -2.", "Add --schedule paper, or leave Further Views out.")


def test_frames_are_those_of_the_scene() -> None:
    frame_of = Pace(1001, 1.25).frame_of
    sight = as_in_file(f"The object is out of sight in 5 of 40 frames, first in {frame_named(8)}.", 20)
    assert in_scene_frames(sight, frame_of, 20) == "The object is out of sight in 5 of 40 frames, first in frame 1011."
    unseen = as_in_file(f"Nothing of the object is seen {frames_named(4, 8)}: a guess.", 20)
    assert in_scene_frames(unseen, frame_of, 20) == "Nothing of the object is seen from frame 1006 to frame 1011: a guess."
    going = {"type": "progress", "message": "Following the object, frame 13 to 26 of 26"}
    assert operator._in_scene_frames(going, frame_of, 20) == going, "that is how far it is in the clip"
    assert operator._in_scene_frames({"type": "warning", "message": "In frame 24 of the file"}, frame_of, 20)["message"] == "In frame 1006"
    broken = f"Particle 3 was turned inside out in {frame_named(4)}, substep 7 of 20."
    assert in_scene_frames(broken, frame_of, 20) == "Particle 3 was turned inside out in frame 1006, substep 7 of 20.", "of a re-simulation"


def test_what_the_engine_says_of_a_finished_stage_is_what_the_panel_waits_for() -> None:
    from seeing_wind.engine import take

    assert f'"{status.KEPT}"' in Path(take.__file__).read_text()


def test_refusals_speak_of_what_the_panel_has() -> None:
    assert in_panel_words(NEITHER) == "Mark the object in the first frame by Box, Blender Mask, or Mask with a PNG."
    assert in_panel_words("Leave it out of --correct.") == "Leave it out of Correct the Outline."
    assert in_panel_words("--out must be a folder's path.") == "To must be a folder's path.", "of Export Field"
    assert in_panel_words("Leave --schedule out.") == "Leave --schedule out.", "what the panel does not have keeps its name"
