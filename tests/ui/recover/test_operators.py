"""The operators as a script in the background calls them, on a stand-in for the engine with known results."""

from __future__ import annotations

import json
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from seeing_wind.engine.conventions import UNHELD, as_in_file, frame_named
from seeing_wind.engine.take import Take
from seeing_wind.ui import freshness
from seeing_wind.ui.bake.motion import is_intact
from seeing_wind.ui.bake.plan import MARK, mark_of
from seeing_wind.ui.job import operator as job_operator
from seeing_wind.ui.job import status
from seeing_wind.ui.recover.panel import RecoverTab
from tests.ui.drawn import Drawn
from tests.ui.jobs import notes_of, now, recover
from tests.ui.meshes import cube

pytestmark = pytest.mark.usefixtures("stand_in")


def test_recover_builds_the_scene(workplace, scene) -> None:
    assert recover(workplace) == {"FINISHED"}
    settings = scene.seeing_wind
    assert settings.field_object.field.type == "TEXTURE" and settings.field_object["seeing_wind_density"] == 700.0
    assert scene.camera is settings.camera_object and scene.camera.data.background_images[0].clip.size[0] == 96
    assert (scene.frame_start, scene.frame_end) == (1, 13) and scene.render.fps == 24
    recovered = settings.recovered_object
    ends = []
    for frame in (1, 13):
        scene.frame_set(frame)
        evaluated = recovered.evaluated_get(bpy.context.evaluated_depsgraph_get())
        ends.append(np.array([recovered.matrix_world @ vertex.co for vertex in evaluated.data.vertices]))
    np.testing.assert_allclose(ends[1] - ends[0], np.broadcast_to([0.24, 0.0, 0.12], ends[0].shape), atol=1e-5)
    assert now(scene)["recover"].state == "done" and status.of(scene.session_uid).running == ""


def test_what_the_recovery_says_of_itself_is_in_the_panel(workplace, scene) -> None:
    recover(workplace)
    report = workplace / "out.take" / "report.json"
    said = json.loads(report.read_text())
    notes = ["Nothing was marked as held.", as_in_file(f"In {frame_named(3)} it is far off.", 20)]
    report.write_text(json.dumps({**said, "clip": {**said["clip"], "first_frame": 20}, "notes": notes}))
    scene.seeing_wind.frame_start = 101
    bpy.ops.seeing_wind.build_scene(take=str(workplace / "out.take"))
    first = scene.seeing_wind.frame_start
    expected = ["Nothing was marked as held.", f"In frame {first + 3} it is far off."]
    assert notes_of(scene) == expected and drawn().endswith(" ".join(expected))
    # another job has notes of its own
    cube("Cube", (0.0, 0.0, 0.0))
    bpy.ops.seeing_wind.insert_mesh(object="Cube")
    bpy.ops.seeing_wind.resimulate()
    assert notes_of(scene) == expected
    for name in ("notes.blend", "again.blend"):
        bpy.ops.wm.save_as_mainfile(filepath=str(workplace / name))
        bpy.ops.wm.open_mainfile(filepath=str(workplace / name))
        assert notes_of(bpy.context.scene) == expected and drawn().endswith(" ".join(expected))


def drawn() -> str:
    """All that the panel *Recover* says now."""
    layout = Drawn()
    RecoverTab.fill(SimpleNamespace(), bpy.context, layout)
    return " ".join(layout.labels)


def test_notes_follow_undo(workplace, scene) -> None:
    bpy.ops.ed.undo_push(message="start")
    recover(workplace)
    report = workplace / "out.take" / "report.json"
    report.write_text(json.dumps({**json.loads(report.read_text()), "notes": ["Nothing was marked as held."]}))
    bpy.ops.ed.undo_push(message="recover")
    bpy.ops.seeing_wind.build_scene(take=str(workplace / "out.take"))
    bpy.ops.ed.undo_push(message="load")
    assert "held" in drawn()
    bpy.ops.ed.undo()
    assert "held" not in drawn()
    bpy.ops.ed.redo()
    assert drawn().endswith("Nothing was marked as held.")


def test_the_answer_to_gravity_has_two_ways_out(workplace, scene) -> None:
    recover(workplace)

    def offered() -> list[SimpleNamespace]:
        layout = Drawn()
        RecoverTab.fill(SimpleNamespace(), bpy.context, layout)
        return [one for one in layout.operators if one.name in ("seeing_wind.preview", "wm.context_set_enum")]

    assert not offered()
    report = workplace / "out.take" / "report.json"
    said = json.loads(report.read_text())
    report.write_text(json.dumps({**said, "notes": [f"{UNHELD}; the force found may be only what holds the body up."]}))
    bpy.ops.seeing_wind.build_scene(take=str(workplace / "out.take"))
    assert len(offered()) == 2
    bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "held.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "held.blend"))
    look, away = offered()
    assert look.name == "seeing_wind.preview"
    bpy.ops.wm.context_set_enum(data_path=away.data_path, value=away.value)
    assert bpy.context.scene.seeing_wind.gravity_mode == "NONE"


def test_steps_that_the_work_has_gone_past_fold(workplace, scene) -> None:
    def shown() -> list[str]:
        return [step for step in status.STEPS if getattr(scene.seeing_wind, f"shows_{step}")]

    assert shown() == list(status.STEPS)
    recover(workplace)
    assert shown() == ["recover", "edit", "resimulate", "bake"]
    cube("Cube", (0.0, 0.0, 0.0))
    bpy.ops.seeing_wind.insert_mesh(object="Cube")
    bpy.ops.seeing_wind.resimulate()
    assert shown() == ["edit", "resimulate", "bake"]


def test_a_failure_for_want_of_an_earlier_step_goes_when_that_step_is_done(workplace, scene) -> None:
    with pytest.raises(RuntimeError, match="no recovered field"):
        bpy.ops.seeing_wind.resimulate()
    assert now(scene)["resimulate"].state == "failed"
    recover(workplace)
    assert now(scene)["resimulate"].state == "idle" and now(scene)["resimulate"].message == ""


def test_the_worker_gets_the_options_of_the_settings(workplace, scene) -> None:
    scene.use_gravity = False
    recover(workplace, fps=30.19, frames=(2, 9), distance=1.5, density=850.0, seed=3)
    options = Take(workplace / "out.take").description()["stages"]["recover"]["settings"]["options"]
    pairs = dict(zip(options, options[1:]))
    assert pairs["--fps"] == "30.19" and pairs["--frames"] == "2:9" and pairs["--density"] == "850" and pairs["--seed"] == "3"
    assert options[options.index("--gravity") + 1 :][:3] == ["0", "0", "0"]
    assert options[options.index("--box") + 1 :][:4] == ["20", "20", "44", "44"]
    assert pairs["--distance"] == "1.5" and "--pixels-per-metre" not in options
    assert "--refine" not in options
    scene.use_gravity, scene.seeing_wind.pixels_per_metre, scene.seeing_wind.refine = True, 398.7, 4
    bpy.ops.seeing_wind.recover(pixels_per_metre=398.7)
    options = Take(workplace / "out.take").description()["stages"]["recover"]["settings"]["options"]
    pairs = dict(zip(options, options[1:]))
    assert pairs["--pixels-per-metre"] == "398.7" and "--distance" not in options and "--gravity" not in options
    assert pairs["--refine"] == "4"


def test_a_change_of_settings_makes_the_recovery_stale_and_changing_back_does_not(workplace, scene) -> None:
    recover(workplace)
    scene.seeing_wind.distance = 3.0
    assert now(scene)["recover"].state == "stale"
    scene.seeing_wind.distance = 2.0
    assert now(scene)["recover"].state == "done"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"clip": "/no/such.mp4"}, "There is no file /no/such.mp4"),
        ({"clip": ""}, "No clip is chosen"),
        ({"box": (0, 0, 0, 0)}, "No box is drawn"),
        ({"mask": "/no/mask.png"}, "There is no mask"),
        ({"frames": (9, 9)}, "frames 9 to 9 is empty"),
        ({"distance": 0.0}, "Distance must be at least 0.01 m; this is 0"),
        ({"distance": -1.0}, "Distance must be at least 0.01 m; this is -1"),
    ],
)
def test_bad_settings_are_refused_before_anything_starts(workplace, scene, options, says) -> None:
    with pytest.raises(RuntimeError, match=says):
        recover(workplace, **options)
    assert now(scene)["recover"].state == "failed" and says in now(scene)["recover"].message
    assert not job_operator.jobs


@pytest.mark.parametrize(("behaviour", "says"), [("error", "outside the frame"), ("die", "SIGKILL"), ("crash", "the grid is empty")])
def test_a_failed_worker_is_told_and_nothing_stays_running(workplace, scene, monkeypatch, behaviour, says) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", behaviour)
    with pytest.raises(RuntimeError, match=says):
        recover(workplace, take=str(workplace / "failed.take"))
    step = now(scene)["recover"]
    assert step.state == "failed" and says in step.message and step.hint
    assert status.of(scene.session_uid).running == "" and not job_operator.jobs
    assert scene.seeing_wind.field_object is None and scene.seeing_wind.recovered_digest == ""
    # other settings make the failure a thing of the past
    scene.seeing_wind.clip, scene.seeing_wind.box = str(workplace / "clip.mp4"), (20, 20, 44, 44)
    scene.seeing_wind.distance = 5.0
    assert now(scene)["recover"].state == "idle"


@pytest.mark.parametrize(("behaviour", "says"), [("done", "There is no camera file /no/camera.json"), ("flags", "nothing in Box")])
def test_options_that_cannot_be_used_do_not_stay(workplace, scene, monkeypatch, behaviour, says) -> None:
    """Refused in Blender, or by the worker; the next run is as before, and what the user set in the panel stays."""
    settings = scene.seeing_wind
    settings.clip, settings.box, settings.distance = str(workplace / "clip.mp4"), (20, 20, 44, 44), 2.0
    settings.camera_mode, settings.fov = "FOV", 40.0
    (workplace / "camera.json").write_text("{}")
    camera = workplace / "camera.json" if behaviour == "flags" else "/no/camera.json"
    monkeypatch.setenv("SEEING_WIND_FAKE", behaviour)
    with pytest.raises(RuntimeError, match=says):
        bpy.ops.seeing_wind.recover(camera=str(camera), box=(1, 2, 30, 40), take=str(workplace / "refused.take"))
    assert (settings.camera_mode, settings.camera, settings.fov, tuple(settings.box)) == ("FOV", "", 40.0, (20, 20, 44, 44))
    assert now(scene)["recover"].state == "failed" and says in now(scene)["recover"].message and settings.take == ""
    monkeypatch.setenv("SEEING_WIND_FAKE", "done")
    assert bpy.ops.seeing_wind.recover(take=str(workplace / "refused.take")) == {"FINISHED"}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"camera": "/no/camera.json"}, "There is no camera file"),
        ({"proxy": "Nothing"}, "There is no 'Nothing' in this file"),
        ({"object_mode": "BLENDER_MASK"}, "Nothing is inside the mask New"),
    ],
)
def test_masks_and_proxy_of_a_refused_call_do_not_stay(workplace, scene, options, says) -> None:
    settings, former, new = scene.seeing_wind, bpy.data.masks.new("Former"), bpy.data.masks.new("New")
    settings.clip, settings.box, settings.mask_data, settings.proxy = str(workplace / "clip.mp4"), (20, 20, 44, 44), former, cube("Before")
    cube("After")
    with pytest.raises(RuntimeError, match=says):
        bpy.ops.seeing_wind.recover(
            **{"mask_data": new.name, "held_mask": new.name, "proxy": "After", "take": str(workplace / "masks.take")} | options
        )
    assert (settings.mask_data, settings.held_mask, settings.proxy) == (former, None, scene.objects["Before"])
    assert (settings.object_mode, settings.take, tuple(settings.box)) == ("BOX", "", (20, 20, 44, 44))


def test_options_of_a_worker_that_broke_down_stay(workplace, scene, monkeypatch) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "die")
    with pytest.raises(RuntimeError, match="SIGKILL"):
        recover(workplace, distance=3.0, take=str(workplace / "died.take"))
    monkeypatch.setenv("SEEING_WIND_FAKE", "done")
    assert scene.seeing_wind.distance == 3.0 and bpy.ops.seeing_wind.recover() == {"FINISHED"}, "it goes on"


def test_a_missing_engine_names_the_button_that_mends_it(workplace, scene, monkeypatch) -> None:
    from seeing_wind.ui.job.install import environment as engine_environment

    monkeypatch.delenv("SEEING_WIND_PYTHON")
    monkeypatch.setattr(engine_environment, "ROOT", workplace)
    with pytest.raises(RuntimeError, match="not installed"):
        recover(workplace)
    assert now(scene)["recover"].mend == "install_engine"
    engine_environment.refresh()
    assert status.engine.problem.mend == "install_engine"
    monkeypatch.setenv("SEEING_WIND_PYTHON", "/no/python")
    engine_environment.refresh()
    assert status.engine.problem.mend == "open_preferences" and "/no/python" in status.engine.problem.message


def test_install_engine_asks_for_online_access_first(scene) -> None:
    assert not bpy.app.online_access
    with pytest.raises(RuntimeError, match="network"):
        bpy.ops.seeing_wind.install_engine()
    assert now(scene)["engine"].mend == "allow_online"


def test_edit_resimulate_and_bake(workplace, scene) -> None:
    recover(workplace)
    free, held = cube("Free"), cube("Held: it")
    held.vertex_groups.new(name="Top").add([0, 1], 1.0, "REPLACE")
    bpy.ops.seeing_wind.insert_mesh(object="Free", mass_scale=2.0)
    bpy.ops.seeing_wind.insert_mesh(object="Held: it")
    bpy.ops.seeing_wind.pin_vertices(vertex_group="Top")
    bpy.ops.seeing_wind.insert_mesh(recovered=True)
    assert [body.name for body in scene.seeing_wind.bodies] == ["Free", "Held: it", "Recovered Object"]
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}
    assert now(scene)["resimulate"].state == "done" and now(scene)["bake"].state == "idle"
    assert bpy.ops.seeing_wind.bake() == {"FINISHED"}
    assert now(scene)["bake"].state == "done"
    ends = {}
    for frame in (1, 13):
        scene.frame_set(frame)
        for obj in (free, held):
            mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
            ends[obj.name, frame] = np.array([obj.matrix_world @ vertex.co for vertex in mesh.vertices])
    fallen = 0.5 * 3.0 * (12 / 24.0) ** 2  # under the gravity of the recovery
    np.testing.assert_allclose((ends["Free", 13] - ends["Free", 1])[:, 2], -fallen / 2.0, atol=1e-5)
    np.testing.assert_allclose((ends["Held: it", 13] - ends["Held: it", 1])[:, 2], [0.0, 0.0] + [-fallen] * 6, atol=1e-5)
    assert scene.seeing_wind.bodies[2].baked_copy is not None and MARK in scene.seeing_wind.recovered_object
    # a second round starts from the meshes at rest, not from where the bake left them
    bpy.ops.seeing_wind.scale_mass(object="Free", factor=4.0)
    assert now(scene)["resimulate"].state == "stale" and now(scene)["bake"].state == "stale"
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    scene.frame_set(13)
    mesh = free.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    again = np.array([free.matrix_world @ vertex.co for vertex in mesh.vertices])
    np.testing.assert_allclose((again - ends["Free", 1])[:, 2], -fallen / 4.0, atol=1e-5)


def test_an_object_that_was_renamed_and_deleted_is_called_as_the_user_called_it(workplace, scene) -> None:
    recover(workplace)
    body, wall = cube("Flag"), cube("Wall")
    bpy.ops.seeing_wind.insert_mesh(object="Flag")
    bpy.ops.seeing_wind.insert_collider(object="Wall")
    body.name, wall.name = "Banner ü", "Mauer"
    bpy.ops.seeing_wind.scale_mass(object="Banner ü")
    bpy.ops.seeing_wind.resimulate()
    bpy.data.objects.remove(body)
    for call in (bpy.ops.seeing_wind.bake, bpy.ops.seeing_wind.resimulate, bpy.ops.seeing_wind.pin_vertices):
        with pytest.raises(RuntimeError, match="The object of Banner ü is gone"):
            call()
    bpy.ops.seeing_wind.remove_body()
    bpy.ops.seeing_wind.insert_mesh(object=cube("Flag").name)
    bpy.data.objects.remove(wall)
    with pytest.raises(RuntimeError, match="collider Mauer is gone"):
        bpy.ops.seeing_wind.resimulate()


def test_objects_that_the_user_renames_or_deletes_never_raise(workplace, scene) -> None:
    recover(workplace)
    gone, kept = cube("Gone"), cube("Kept")
    bpy.ops.seeing_wind.insert_mesh(object="Gone")
    bpy.ops.seeing_wind.insert_mesh(object="Kept")
    kept.name = "Another"
    bpy.data.objects.remove(gone)
    bpy.data.objects.remove(scene.seeing_wind.recovered_object)
    bpy.data.objects.remove(scene.seeing_wind.field_object)
    freshness.refresh(scene)
    with pytest.raises(RuntimeError, match="The object of Gone is gone"):
        bpy.ops.seeing_wind.resimulate()
    scene.seeing_wind.active_body = 0
    bpy.ops.seeing_wind.remove_body()
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    assert mark_of(kept)["way"] == "TRANSFORM" and is_intact(kept)  # it falls without bending
    assert bpy.ops.seeing_wind.build_scene() == {"FINISHED"}
    assert scene.seeing_wind.field_object is not None


def test_results_survive_undo_save_and_load(workplace, scene, tmp_path) -> None:
    bpy.ops.ed.undo_push(message="start")
    recover(workplace)
    bpy.ops.ed.undo_push(message="Recover")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    freshness.refresh_all()
    assert scene.seeing_wind.field_object is None and now(scene)["recover"].state == "idle"
    bpy.ops.ed.redo()
    scene = bpy.context.scene
    assert scene.seeing_wind.field_object.field.type == "TEXTURE" and now(scene)["recover"].state == "done"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    scene = bpy.context.scene
    assert scene.seeing_wind.distance == 2.0 and tuple(scene.seeing_wind.box) == (20, 20, 44, 44)
    assert scene.seeing_wind.field_object is not None and now(scene)["recover"].state == "done"


def test_doctor_leaves_its_findings_as_a_text(workplace, scene) -> None:
    assert bpy.ops.seeing_wind.doctor() == {"FINISHED"}
    text = bpy.data.texts["Seeing Wind Engine"].as_string()
    assert str(workplace / "fake_python") in text
    assert "Not needed, for further uses:\n  not here  transformers: not installed  pip install transformers" in text
    assert now(scene)["engine"].message.startswith("The engine is complete, with none of its 1 optional parts.")


def test_a_take_that_cannot_be_written_is_told(workplace, scene, tmp_path) -> None:
    blocked = tmp_path / "a file"
    blocked.write_text("no folder")
    with pytest.raises(RuntimeError, match="a file"):
        recover(workplace, take=str(blocked / "out.take"))
    assert now(scene)["recover"].state == "failed" and now(scene)["recover"].hint and not job_operator.jobs
