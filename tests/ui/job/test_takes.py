"""Where results are: a project that is moved or copied, a file that is saved for the first time, a folder that two share."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.engine.take import Take
from seeing_wind.ui import freshness
from seeing_wind.ui.bake.motion import is_intact
from seeing_wind.ui.job import operator as job_operator
from seeing_wind.ui.job import status, takes
from seeing_wind.ui.user_paths import absolute

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture
def project(workplace, tmp_path) -> Path:
    """A folder with a clip and a saved file."""
    folder = tmp_path / "Projekt eins"
    folder.mkdir()
    shutil.copy(workplace / "clip.mp4", folder)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "Szene.blend"))
    return folder


@pytest.fixture
def temporary(monkeypatch, tmp_path) -> Path:
    """The system's temporary folder, for this test alone."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return tmp_path / "temporary"


def recover(clip: Path | str, **more) -> None:
    assert bpy.ops.seeing_wind.recover(**{"clip": str(clip), "box": (20, 20, 44, 44), "distance": 2.0, **more}) == {"FINISHED"}


def insert() -> bpy.types.Object:
    bpy.ops.mesh.primitive_cube_add(size=0.2)
    obj = bpy.context.object
    obj.vertex_groups.new(name="Top").add([0, 1], 1.0, "REPLACE")
    bpy.ops.seeing_wind.insert_mesh(object=obj.name, pin_group="Top")
    return obj


def states() -> set[str]:
    freshness.refresh_all()
    steps = status.of(bpy.context.scene.session_uid).steps
    return {str(steps[name].state) for name in status.STEPS}


def low() -> float:
    """Height of the lowest vertex of the cube at the last frame."""
    bpy.context.scene.frame_set(13)
    obj = bpy.data.objects["Cube"]
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return min((evaluated.matrix_world @ vertex.co).z for vertex in evaluated.data.vertices)


@pytest.mark.parametrize(("way", "copied"), [("SHAPE_KEYS", True), ("POINT_CACHE", False)])
def test_a_project_can_be_moved_or_copied(project, tmp_path, way, copied) -> None:
    recover("//clip.mp4")
    insert()
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way=way)
    assert states() == {"done"}
    fallen = low()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    elsewhere = tmp_path / "ailleurs ñ" / "Projekt"
    (shutil.copytree if copied else shutil.move)(project, elsewhere)
    for path in elsewhere.rglob("*") if copied else ():
        os.utime(path, (1.0e9, 1.0e9))  # not every way of copying keeps dates
    bpy.ops.wm.open_mainfile(filepath=str(elsewhere / "Szene.blend"))
    settings = bpy.context.scene.seeing_wind
    assert states() == {"done"} and low() == pytest.approx(fallen)
    assert takes.recovered(settings) == elsewhere / "clip.take" and takes.simulated(settings) == elsewhere / "clip.edit.take"
    before = {path: path.stat().st_mtime_ns for path in project.rglob("*")} if copied else {}
    for call in (bpy.ops.seeing_wind.resimulate, bpy.ops.seeing_wind.bake, bpy.ops.seeing_wind.build_scene):
        assert call() == {"FINISHED"}
    assert bpy.ops.seeing_wind.set_up_composite(behind="PLATE") == {"FINISHED"}
    assert bpy.context.scene.active_clip.filepath and states() == {"done"}
    assert Path(absolute(bpy.context.scene.active_clip.filepath)) == elsewhere / "clip.mp4" == Path(absolute(settings.clip))
    assert len(bpy.data.movieclips) == 1
    assert before == {path: path.stat().st_mtime_ns for path in before}, "the original project is left alone"


@pytest.mark.parametrize("said", [True, False])
def test_reload_in_a_copied_project_takes_its_own_clip(project, tmp_path, said) -> None:
    """As the file says where the clip is, and, where it says nothing, as the clip stands to the take."""
    (project / "footage").mkdir()
    (project / "clip.mp4").rename(project / "footage" / "clip.mp4")
    recover("//footage/clip.mp4")
    bpy.ops.wm.save_mainfile()
    elsewhere = tmp_path / "copy"
    shutil.copytree(project, elsewhere)
    bpy.ops.wm.open_mainfile(filepath=str(elsewhere / "Szene.blend"))
    for clip in list(bpy.data.movieclips):
        bpy.data.movieclips.remove(clip)
    if not said:
        bpy.context.scene.seeing_wind.clip = ""
    assert bpy.ops.seeing_wind.build_scene() == {"FINISHED"}
    assert Path(absolute(bpy.context.scene.active_clip.filepath)) == elsewhere / "footage" / "clip.mp4"


def test_another_projects_take_comes_with_its_own_clip(project, workplace, tmp_path) -> None:
    """Both clips have one name: a take that is not the scene's own says which is meant."""
    other = tmp_path / "other"
    other.mkdir()
    shutil.copy(workplace / "clip.mp4", other)
    recover(other / "clip.mp4", take=str(other / "x.take"))
    recover("//clip.mp4", take="//own.take")
    with (project / "clip.mp4").open("ab") as file:  # another film of that name
        file.write(b"more")
    assert bpy.ops.seeing_wind.build_scene(take=str(other / "x.take")) == {"FINISHED"}
    assert Path(absolute(bpy.context.scene.active_clip.filepath)) == other / "clip.mp4"
    # the very film, chosen here before the take is loaded
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(project / "new.blend"))
    shutil.copy(other / "clip.mp4", project)
    assert bpy.ops.seeing_wind.choose_clip(filepath="//clip.mp4") == {"FINISHED"}
    assert bpy.ops.seeing_wind.build_scene(take=str(other / "x.take")) == {"FINISHED"}
    assert bpy.ops.seeing_wind.build_scene() == {"FINISHED"}
    assert Path(absolute(bpy.context.scene.active_clip.filepath)) == project / "clip.mp4" and len(bpy.data.movieclips) == 1


def test_a_file_saved_for_the_first_time_takes_its_results_along(workplace, temporary, tmp_path) -> None:
    recover(workplace / "clip.mp4")
    insert()
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="POINT_CACHE")
    fallen, settings = low(), bpy.context.scene.seeing_wind
    assert temporary in Path(settings.recovered_take).parents
    home = tmp_path / "zu Hause"
    home.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(home / "x.blend"))
    assert states() == {"done"}
    for each in temporary.iterdir():
        shutil.rmtree(each)
    bpy.ops.wm.open_mainfile(filepath=str(home / "x.blend"))
    assert states() == {"done"} and low() == pytest.approx(fallen)
    assert takes.recovered(bpy.context.scene.seeing_wind) == home / "clip.take" and is_intact(bpy.data.objects["Cube"])
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"} and bpy.ops.seeing_wind.build_scene() == {"FINISHED"}


def test_what_is_taken_along_replaces_nothing(workplace, temporary, tmp_path) -> None:
    recover(workplace / "clip.mp4")
    kept = Path(bpy.context.scene.seeing_wind.recovered_take)
    (tmp_path / "clip.take").write_text("in the way")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "x.blend"))
    assert Path(bpy.context.scene.seeing_wind.recovered_take) == tmp_path / "clip.2.take", "another name"
    assert kept.is_dir() and takes.take_folder(bpy.context.scene.seeing_wind) == tmp_path / "clip.2.take"


def test_an_unfinished_recovery_goes_on_after_the_file_was_saved(workplace, temporary, tmp_path) -> None:
    settings = bpy.context.scene.seeing_wind
    settings.clip = str(workplace / "clip.mp4")
    begun = takes.take_folder(settings)
    assert temporary in begun.parents
    takes.bring_along(settings, begun)
    Take(begun).write_arrays("observation.npz", {"half": np.arange(3)})
    Take(begun).finish("observe", "stamp of the first stage", {})
    settings.unfinished = "recover"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "x.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "x.blend"))
    settings = bpy.context.scene.seeing_wind
    folder = takes.take_folder(settings)
    assert folder.parent == tmp_path
    takes.bring_along(settings, folder)
    assert Take(folder).is_done("observe", "stamp of the first stage") and Take(folder).read_arrays("observation.npz")["half"].size == 3


def test_two_scenes_with_one_clip_have_a_take_each(project) -> None:
    recover("//clip.mp4")
    first = bpy.context.scene
    second = bpy.data.scenes.new("Zweite Szene")
    bpy.context.window.scene = second
    recover("//clip.mp4")
    names = [Path(scene.seeing_wind.recovered_take).name for scene in (first, second)]
    assert names == ["clip.take", "clip.Zweite_Szene.take"]
    recover("//clip.mp4", distance=3.0)
    bpy.context.window.scene = first
    recover("//clip.mp4", distance=3.0)
    assert [Path(scene.seeing_wind.recovered_take).name for scene in (first, second)] == names, "and each keeps its own"


def two_shots(project: Path) -> tuple[Path, Path]:
    """Two films of one name."""
    shots = project / "A" / "clip.mp4", project / "B" / "clip.mp4"
    for number, shot in enumerate(shots):
        shot.parent.mkdir()
        shot.write_bytes((project / "clip.mp4").read_bytes() + b"other" * number)
    return shots


def test_a_clip_of_the_same_name_does_not_replace_what_was_recovered_of_another(project) -> None:
    first, second = two_shots(project)
    recover(first)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(project / "two.blend"))
    for clip, name in ((second, "clip.2.take"), (first, "clip.take"), (second, "clip.2.take")):
        recover(clip)
        assert takes.shown(bpy.context.scene.seeing_wind) == project / name
    told = [Take(project / name).read_json("report.json")["clip"]["path"] for name in ("clip.take", "clip.2.take")]
    assert told == [str(first), str(second)]
    refused(lambda: recover(second, take="//clip.take"), f"the take of another clip, {first}", "the user's own choice")
    bpy.context.scene.seeing_wind.take = "//clip.take"
    refused(bpy.ops.seeing_wind.preview, "the take of another clip", "which writes into it, too")
    assert Take(project / "clip.take").read_json("report.json")["clip"]["path"] == str(first)


def test_a_clip_that_was_moved_or_copied_goes_on_in_its_take(project) -> None:
    clip, second = two_shots(project)
    recover(clip)
    (project / "C").mkdir()
    copied = Path(shutil.copy(clip, project / "C"))
    os.utime(copied, (1.0e9, 1.0e9))
    recover(copied)
    assert takes.shown(bpy.context.scene.seeing_wind) == project / "clip.take", "a copy"
    copied.unlink()
    recover(clip, take="//clip.take")
    assert takes.shown(bpy.context.scene.seeing_wind) == project / "clip.take", "moved"


def test_a_take_that_was_recovered_anew_elsewhere_is_not_simulated_in_silently(project) -> None:
    recover("//clip.mp4")
    insert()
    bpy.ops.seeing_wind.resimulate()
    other = bpy.data.scenes.new("Other")
    mine = bpy.context.scene
    bpy.context.window.scene = other
    recover("//clip.mp4", distance=5.0, take="//clip.take")
    bpy.context.window.scene = mine
    for call in (bpy.ops.seeing_wind.resimulate, lambda: bpy.ops.seeing_wind.export_field(format="FGA")):
        with pytest.raises(RuntimeError, match="has been recovered again"):
            call()
    assert not job_operator.jobs
    assert bpy.ops.seeing_wind.build_scene() == {"FINISHED"} and status.of(mine.session_uid).steps["resimulate"].state == "stale"
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}


def set_value(name: str, value) -> object:
    def change(arrays: dict) -> None:
        arrays[name] = value if isinstance(value, np.ndarray) else arrays[name].astype(np.float64) * value
    return change  # fmt: skip


DAMAGES = [
    ("trajectory.npz", set_value("x", np.nan)),
    ("trajectory.npz", lambda arrays: arrays.pop("x")),
    ("trajectory.npz", lambda arrays: arrays.update(x=arrays["x"][:3])),
    ("particles.npz", set_value("surface.vertices", np.nan)),
    ("particles.npz", lambda arrays: arrays.pop("surface.uv")),
    ("particles.npz", lambda arrays: arrays.update({"surface.triangles": arrays["surface.triangles"] + 1000})),
    ("particles.npz", lambda arrays: arrays.update({"surface.attachment.index": arrays["surface.attachment.index"] + 1000})),
    ("observation.npz", lambda arrays: arrays.pop("image")),
    ("observation.npz", lambda arrays: arrays.pop("camera.fx")),
    ("observation.npz", set_value("camera.camera_to_world", np.nan)),
]


REPORTS = [{"frames": 0}, {"fps": 0}, {"fps": float("nan")}, {"frames": "x"}, {"box": "x"}, {"clip": [1]}, {"material": {}}, []]

SIMULATIONS = [set_value("vertices", np.nan), lambda arrays: arrays.pop("fps"), lambda arrays: arrays.pop("vertices")]


def refused(call, says: str, what: object) -> None:
    with pytest.raises(RuntimeError, match=says) as told:
        call()
    assert "Traceback" not in str(told.value) and not job_operator.jobs, what


def test_a_damaged_take_is_told_and_what_is_shown_stays(project) -> None:
    recover("//clip.mp4")
    insert()
    bpy.ops.seeing_wind.resimulate()
    settings = bpy.context.scene.seeing_wind
    take, edit = Take(settings.recovered_take), Take(settings.simulated_take)
    shown = [settings.field_object, settings.arrows_object, settings.recovered_object]
    for number, (name, change) in enumerate(DAMAGES):
        whole = take.file(name).read_bytes()
        arrays = take.read_arrays(name)
        change(arrays)
        take.write_arrays(name, arrays)
        refused(bpy.ops.seeing_wind.build_scene, "clip.take|The take lacks", (number, name))
        assert all(obj.name in bpy.context.scene.objects for obj in shown), (number, name)
        take.file(name).write_bytes(whole)
    report = take.file("report.json").read_text()
    for change in REPORTS:
        take.file("report.json").write_text(json.dumps(json.loads(report) | change if change else change))
        for call in (bpy.ops.seeing_wind.build_scene, bpy.ops.seeing_wind.resimulate):
            refused(call, "report", change)
    take.file("report.json").write_text(json.dumps({key: value for key, value in json.loads(report).items() if key != "fps"}))
    refused(bpy.ops.seeing_wind.build_scene, "clip.take.report.json does not describe a field: it lacks fps. Run", "fps")
    take.file("report.json").write_text(report)
    for number, change in enumerate(SIMULATIONS):
        whole = edit.file("bodies/Cube.npz").read_bytes()
        arrays = edit.read_arrays("bodies/Cube.npz")
        change(arrays)
        edit.write_arrays("bodies/Cube.npz", arrays)
        refused(bpy.ops.seeing_wind.bake, "damaged or not finite", number)
        edit.file("bodies/Cube.npz").write_bytes(whole)
    assert bpy.ops.seeing_wind.build_scene() == {"FINISHED"} and bpy.ops.seeing_wind.bake() == {"FINISHED"}


def test_a_clip_that_is_gone_leaves_what_is_shown(project) -> None:
    recover("//clip.mp4")
    (project / "clip.mp4").unlink()
    bpy.data.movieclips.remove(bpy.context.scene.active_clip)
    with pytest.raises(RuntimeError, match="clip.mp4"):
        bpy.ops.seeing_wind.build_scene()
    settings = bpy.context.scene.seeing_wind
    assert settings.field_object.name in bpy.context.scene.objects and settings.recovered_object.data.shape_keys
