"""Jobs in a window: the modal driver, cancel, what a load, a save or an undo meanwhile does. The engine is a stand-in."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import bpy
import pytest

from seeing_wind.ui.edit.resimulate.operators import SEEING_WIND_OT_preview_edit, SEEING_WIND_OT_resimulate, Simulation
from seeing_wind.ui.job import operator as job_operator
from seeing_wind.ui.job import status, takes, worker_command
from seeing_wind.ui.job import worker as job
from seeing_wind.ui.recover.operators import SEEING_WIND_OT_recover
from seeing_wind.ui.recover.request import RecoverRequest
from tests.ui.jobs import notes_of, now, recover
from tests.ui.meshes import cube

pytestmark = pytest.mark.usefixtures("stand_in")


def worker_job(workplace: Path):
    call = worker_command.command(str(workplace / "fake_python"), "recover", "clip", "--take", str(workplace / "hang.take"))
    return job.run(call, cwd=str(workplace), env=worker_command.environment())


class Event:
    type = "TIMER"


class Window:
    """Stands for a window's context: what the modal driver asks of it."""

    def __init__(self, scene) -> None:
        self.scene, self.window, self.window_manager, self.timers = scene, object(), self, 0

    def event_timer_add(self, tick, window):
        self.timers += 1
        return self

    def event_timer_remove(self, timer) -> None:
        self.timers -= 1

    def modal_handler_add(self, operator) -> None:
        pass


class Modal(job_operator.JobOperator):
    """An operator's Python side without Blender's, so that the modal driver can be stepped."""

    bl_label, step = "Recover", "recover"

    def __init__(self, messages) -> None:
        self.messages, self.said, self.finished = messages, [], False

    def start(self, scene):
        return self.messages

    def finish(self, scene, result) -> str:
        self.finished = True
        return "done"

    def report(self, kinds, text) -> None:
        self.said.append(text)


@pytest.fixture
def windowed(monkeypatch):
    """The operators believe that there is a window."""
    monkeypatch.setattr(job_operator, "blocks", lambda context: False)


def step_until_over(operator, window, seconds: float = 120.0) -> set[str]:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        outcome = operator.modal(window, Event)
        if outcome != {"PASS_THROUGH"}:
            return outcome
        time.sleep(0.01)
    pytest.fail("the job never ended")


def resimulating(scene, operator: type = SEEING_WIND_OT_resimulate) -> Modal:
    """Re-simulate, or its preview, under the modal driver that the tests step."""

    class Stepped(Simulation, Modal):
        bl_label, step, take, digest_kept, coarse, digest_of = (
            getattr(operator, name) for name in ("bl_label", "step", "take", "digest_kept", "coarse", "digest_of")
        )

    return Stepped(None)


def test_loading_a_file_kills_the_worker_of_the_one_before(workplace, scene, monkeypatch) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "hang")
    running = job_operator.Running(worker_job(workplace))
    job_operator.jobs[scene.session_uid] = running
    status.begin(status.of(scene.session_uid), "recover", "Recover")
    while not any(message["type"] == "progress" for message in running.poll()):
        time.sleep(0.01)
    process = running.messages.gi_frame.f_locals["process"]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert process.poll() is not None and not job_operator.jobs


def test_a_file_saved_during_a_run_says_after_reopening_that_the_run_goes_on(workplace, scene, windowed, monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "hang")
    window, operator = Window(scene), Modal(worker_job(workplace))
    operator.execute(window)
    assert now(scene)["recover"].state == "running"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "während.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "während.blend"))
    scene = bpy.context.scene
    assert not job_operator.jobs and now(scene)["recover"].state == "idle"
    assert "was running when this file was saved" in now(scene)["recover"].message
    monkeypatch.setenv("SEEING_WIND_FAKE", "done")
    monkeypatch.setattr(job_operator, "blocks", lambda context: True)
    assert recover(workplace) == {"FINISHED"} and "Recovered" in now(scene)["recover"].message
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "während.blend"))
    assert now(bpy.context.scene)["recover"].state == "done" and now(bpy.context.scene)["recover"].message == ""


@pytest.mark.parametrize("first", [True, False])
def test_a_file_saved_in_another_folder_while_it_is_recovered_says_where_the_results_are(
    workplace, scene, windowed, tmp_path, monkeypatch, first: bool
) -> None:
    class Stepped(Modal):
        finish = SEEING_WIND_OT_recover.finish

        def start(self, scene):
            request = RecoverRequest.of(scene)
            self.folder, self.clip, self.digest = request.take, request.clip, request.digest()
            return SEEING_WIND_OT_recover._messages(self, str(workplace / "fake_python"), request)

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    for folder in ("temporary", "a", "b"):
        (tmp_path / folder).mkdir()
    if not first:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a" / "shot.blend"))
    settings = scene.seeing_wind
    settings.clip, settings.box, settings.distance = str(workplace / "clip.mp4"), (20, 20, 44, 44), 2.0
    window, operator = Window(scene), Stepped(None)
    operator.execute(window)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "b" / "shot.blend"))
    assert step_until_over(operator, window) == {"FINISHED"} and now(scene)["recover"].state == "done"
    told = notes_of(scene)[0]
    assert "save it again" in told if first else f"its results stay in {tmp_path / 'a' / 'clip.take'}" in told
    bpy.ops.wm.save_mainfile()
    assert Path(settings.recovered_take) == tmp_path / ("b" if first else "a") / "clip.take"
    assert takes.recovered(settings).is_dir()


def test_a_cancelled_job_says_that_it_goes_on(workplace, scene, windowed, monkeypatch) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "hang")
    window, operator = Window(scene), Modal(worker_job(workplace))
    operator.execute(window)
    while now(scene)["recover"].fraction == 0.0:
        operator.modal(window, Event)
    assert now(scene)["recover"].residual.endswith(" px") and scene.seeing_wind.unfinished == "recover"
    bpy.ops.seeing_wind.cancel()
    assert step_until_over(operator, window) == {"CANCELLED"}
    assert "goes on from what was finished" in now(scene)["recover"].message and scene.seeing_wind.unfinished == ""


def test_a_scene_deleted_while_it_runs_ends_its_worker_and_comes_back_idle(workplace, scene, windowed, monkeypatch) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "hang")
    bpy.data.scenes.new("Other")
    bpy.ops.ed.undo_push(message="Two scenes")
    window, operator = Window(scene), Modal(worker_job(workplace))
    operator.execute(window)
    while now(scene)["recover"].fraction == 0.0:
        operator.modal(window, Event)
        time.sleep(0.01)
    process = job_operator.jobs[scene.session_uid].messages.gi_frame.f_locals["process"]
    bpy.ops.scene.delete()
    bpy.ops.ed.undo_push(message="Delete")
    assert step_until_over(operator, window) == {"CANCELLED"} and window.timers == 0
    assert process.poll() is not None and not job_operator.jobs
    bpy.ops.ed.undo()
    again = now(bpy.data.scenes["Scene"])["recover"]
    assert (again.state, again.message) == ("idle", ""), "not how far it once was"


def test_modal_driver_runs_to_the_end_without_blocking(workplace, scene, windowed, monkeypatch) -> None:
    window, operator = Window(scene), Modal(worker_job(workplace))
    assert operator.execute(window) == {"RUNNING_MODAL"}
    assert now(scene)["recover"].state == "running" and window.timers == 1
    second = Modal(worker_job(workplace))
    assert second.execute(window) == {"CANCELLED"} and "running" in second.said[0]
    assert step_until_over(operator, window) == {"FINISHED"}
    assert operator.finished and window.timers == 0 and not job_operator.jobs
    assert status.of(scene.session_uid).running == ""


def test_cancel_from_the_panel_ends_a_job_that_does_not_listen(workplace, scene, windowed, monkeypatch) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "stubborn")
    window, operator = Window(scene), Modal(worker_job(workplace))
    operator.execute(window)
    while now(scene)["recover"].fraction == 0.0:
        operator.modal(window, Event)
        time.sleep(0.01)
    assert bpy.ops.seeing_wind.cancel() == {"FINISHED"}
    assert status.of(scene.session_uid).cancelling
    assert step_until_over(operator, window) == {"CANCELLED"}
    assert not operator.finished and window.timers == 0
    assert job.CANCEL_GRACE + job.KILL_GRACE < 2.0, "the user has Blender back soon, whatever the worker does"
    assert status.of(scene.session_uid).running == "" and now(scene)["recover"].state == "idle"


def test_a_killed_worker_shows_in_the_panel(workplace, scene, windowed, monkeypatch) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "die")
    window, operator = Window(scene), Modal(worker_job(workplace))
    operator.execute(window)
    assert step_until_over(operator, window) == {"CANCELLED"}
    assert now(scene)["recover"].state == "failed" and "SIGKILL" in now(scene)["recover"].message
    assert window.timers == 0 and not job_operator.jobs


def test_a_defect_while_taking_in_results_does_not_leave_the_panel_running(workplace, scene, windowed, monkeypatch) -> None:
    window, operator = Window(scene), Modal(worker_job(workplace))
    monkeypatch.setattr(operator, "finish", lambda scene, result: 1 / 0, raising=False)
    operator.execute(window)
    assert step_until_over(operator, window) == {"CANCELLED"}
    assert now(scene)["recover"].state == "failed" and "ZeroDivisionError" in now(scene)["recover"].message
    assert status.of(scene.session_uid).running == ""


def insert_in_two_steps(workplace, monkeypatch) -> None:
    """Recover and insert a box, as two steps that can be undone; jobs do not block afterwards."""
    monkeypatch.setattr(job_operator, "blocks", lambda context: True)
    recover(workplace)
    bpy.ops.ed.undo_push(message="Recover")
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.ed.undo_push(message="Insert")
    monkeypatch.setattr(job_operator, "blocks", lambda context: False)


def test_an_undo_while_it_runs_takes_no_result_back(workplace, scene, windowed, monkeypatch) -> None:
    insert_in_two_steps(workplace, monkeypatch)
    window, operator = Window(scene), resimulating(scene)
    operator.execute(window)
    bpy.ops.ed.undo()
    bpy.ops.ed.redo()
    scene = bpy.context.scene
    assert scene.seeing_wind.bodies[0].result == "" and scene.seeing_wind.unfinished == ""
    operator.modal(window, Event)
    assert scene.seeing_wind.unfinished == "resimulate", "a file that is saved now says so when it is opened"
    assert step_until_over(operator, window) == {"FINISHED"}
    assert now(scene)["resimulate"].state == "done" and bpy.ops.seeing_wind.bake() == {"FINISHED"}


def test_a_preview_is_cancelled_as_any_job_is_and_an_undo_takes_none_of_it_back(workplace, scene, windowed, monkeypatch) -> None:
    insert_in_two_steps(workplace, monkeypatch)
    monkeypatch.setenv("SEEING_WIND_FAKE", "hang")
    window, operator = Window(scene), resimulating(scene, SEEING_WIND_OT_preview_edit)
    operator.execute(window)
    while now(scene)["edit_preview"].fraction == 0.0:
        operator.modal(window, Event)
        time.sleep(0.01)
    assert status.of(scene.session_uid).running == "edit_preview" and now(scene)["resimulate"].state == "idle"
    bpy.ops.seeing_wind.cancel()
    assert step_until_over(operator, window) == {"CANCELLED"}
    assert now(scene)["edit_preview"].message.startswith("Cancelled. Preview") and scene.seeing_wind.coarse_take == ""
    monkeypatch.setenv("SEEING_WIND_FAKE", "done")
    operator = resimulating(scene, SEEING_WIND_OT_preview_edit)
    operator.execute(window)
    bpy.ops.ed.undo()
    bpy.ops.ed.redo()
    scene = bpy.context.scene
    assert step_until_over(operator, window) == {"FINISHED"}
    assert status.of(scene.session_uid).previewed == ["Box"] and now(scene)["bake"].state == "done"


def test_a_result_goes_to_the_edit_that_was_simulated(workplace, scene, windowed, monkeypatch) -> None:
    monkeypatch.setattr(job_operator, "blocks", lambda context: True)
    recover(workplace)
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.duplicate_edit()
    settings = scene.seeing_wind
    settings.active_edit = 0
    monkeypatch.setattr(job_operator, "blocks", lambda context: False)
    window, operator = Window(scene), resimulating(scene)
    operator.execute(window)
    settings.active_edit = 1
    assert step_until_over(operator, window) == {"FINISHED"}
    assert settings.simulated_take == "" and now(scene)["resimulate"].state == "idle"
    settings.active_edit = 0
    assert settings.simulated_take.endswith("out.edit.take") and now(scene)["resimulate"].state == "done"
    assert bpy.ops.seeing_wind.bake() == {"FINISHED"}
