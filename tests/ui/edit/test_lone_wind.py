"""A body is inserted in a scene that has a wind and no take: what the field object carries goes to the engine."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.ui.edit.resimulate.lone_wind import lone_wind
from seeing_wind.ui.field.field_object import make_again
from seeing_wind.ui.field.node_groups import FIRST_FRAME, get_input
from seeing_wind.ui.field.samples import rows_at, samples_of
from seeing_wind.ui.field.vdb import frames_of, said_of_frames
from seeing_wind.ui.job import operator as job_operator
from tests.ui.edit.edits import state
from tests.ui.job.test_modal import Window, resimulating, step_until_over
from tests.ui.jobs import notes_of
from tests.ui.meshes import cube, shown


def opened(path: Path) -> tuple[dict, dict[str, np.ndarray]]:
    """Metadata and arrays of a safetensors file, by its format."""
    content = path.read_bytes()
    size = int.from_bytes(content[:8], "little")
    header, body = json.loads(content[8 : 8 + size]), content[8 + size :]
    metadata, kinds = header.pop("__metadata__"), {"F32": "<f4", "I64": "<i8"}
    arrays = {
        name: np.frombuffer(body[slice(*one["data_offsets"])], kinds[one["dtype"]]).reshape(one["shape"]) for name, one in header.items()
    }
    return metadata, arrays


@pytest.fixture
def field(scene, checks, stand_in, workplace, monkeypatch, tmp_path):
    """A field of another file, appended."""
    checks["swirl_field"](scene)
    bpy.data.libraries.write(str(tmp_path / "wind.blend"), {bpy.data.objects["Wind"]})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    with bpy.data.libraries.load(str(tmp_path / "wind.blend")) as (_, into):
        into.objects = ["Wind"]
    scene = bpy.context.scene
    scene.collection.objects.link(into.objects[0])
    scene.frame_end, scene.render.fps = 14, 48
    return into.objects[0]


def test_an_appended_wind_can_be_simulated_in(field, checks, tmp_path):
    scene = bpy.context.scene
    field.location.x += 0.5
    obj = cube("Box", (0.3, 0.0, 0.6))
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    assert state("resimulate") == "done" and scene.seeing_wind.field_object == field
    take = Path(scene.seeing_wind.recovered_take)
    assert take.parent == tmp_path and not (take / "wind.safetensors").exists()
    metadata, arrays = opened(take / "field.safetensors")
    # 9 frames from the field's first to the end, 2 a clip frame only once it is conformed
    assert (metadata["representation"], metadata["frames"], float(metadata["fps"])) == ("lattice", "9", 48.0)
    assert arrays["row"].tolist() == [0, 1, 2, 3, 4, 5, 5, 5, 5], "its last frame stays"
    box = np.array(json.loads(metadata["box"]))
    counts = arrays["force"].shape[1:4]
    axes = [np.linspace(*box[:, k], counts[k]) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    for frame in (0, 5):
        truth = checks["swirl"](nodes + checks["CENTRE"], frame)
        np.testing.assert_allclose(arrays["force"][frame].reshape(-1, 3), truth, atol=1e-4 * np.abs(truth).max())
    place = np.load(Path(scene.seeing_wind.simulated_take) / "field_place.npy")
    np.testing.assert_allclose(place[0, :3, 3], checks["CENTRE"] + [0.5, 0.0, 0.0], atol=1e-6)
    bpy.ops.seeing_wind.bake()
    assert np.abs(shown(obj, 14) - shown(obj, 5)).max() > 0.01
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert lone_wind(bpy.context.scene).name == "Wind" and bpy.ops.seeing_wind.resimulate() == {"FINISHED"}


def test_a_wind_that_fades_is_simulated_as_it_fades(field):
    """What its reach leaves, at the nodes of its lattice; with Hold all of it."""
    scene, mesh = bpy.context.scene, samples_of(field).data
    cube("Box", (0.3, 0.0, 0.6))
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    for name in ("distance", "left"):
        mesh.attributes.new(name, "FLOAT", "POINT")
    values = np.random.default_rng(0).uniform(0.0, 1.2, len(mesh.vertices)).astype(np.float32)
    mesh.attributes["distance"].data.foreach_set("value", values)
    forces = {}
    for reach in ("HOLD", "FADE"):
        make_again(field, reach)
        bpy.ops.seeing_wind.resimulate()
        forces[reach] = opened(Path(scene.seeing_wind.recovered_take) / "field.safetensors")[1]["force"].reshape(-1, 3)
    s = np.clip(values / 0.75, 0.0, 1.0)[:, None]  # its box is 1 m long
    np.testing.assert_allclose(forces["FADE"], (1.0 - s**2 * (3.0 - 2.0 * s)) * forces["HOLD"], atol=1e-4 * np.abs(forces["HOLD"]).max())


def test_it_goes_on_with_the_scene_and_loops(field):
    scene = bpy.context.scene
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    field["seeing_wind_loop"] = True
    bpy.ops.seeing_wind.conform(field=field.name, real_time=True)
    scene.frame_end = 25
    bpy.ops.seeing_wind.resimulate()
    metadata, arrays = opened(Path(scene.seeing_wind.recovered_take) / "field.safetensors")
    assert float(metadata["fps"]) == 24.0 and arrays["row"].tolist() == [0, 1, 2, 3, 4, 5, 0, 1, 2, 3]
    scene.frame_start = 8  # in the middle of the second of its frames, which last two of the scene's
    bpy.ops.seeing_wind.resimulate()
    rows = opened(Path(scene.seeing_wind.recovered_take) / "field.safetensors")[1]["row"]
    assert rows.tolist() == [2, 3, 4, 5, 0, 1, 2, 3, 4] and scene.seeing_wind.frame_start == 8, "the bodies begin with the scene"
    scene.frame_start = scene.frame_end = 20
    with pytest.raises(RuntimeError, match="from frame 20 on, and the scene ends at 20"):
        bpy.ops.seeing_wind.resimulate()


@pytest.mark.parametrize(("first", "last"), [(1001, 1014), (1, 5)])
def test_a_wind_that_would_not_blow_in_the_scene_begins_with_it(field, first, last):
    """It blew in frames 5 to 11 of the file that it comes from."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = first, last
    box = cube("Box", (0.3, 0.0, 0.6))
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    arrays = opened(Path(scene.seeing_wind.recovered_take) / "field.safetensors")[1]
    assert arrays["row"].tolist() == [*range(6), *[5] * 7][: last - first] and scene.seeing_wind.frame_start == first
    begins = f"Wind begins with the scene now, at frame {first}. It blew from frame 5 to 11, and the scene lasts from {first} to {last}"
    assert begins in notes_of(scene, "resimulate")
    modifier = next(each for each in samples_of(field).modifiers if get_input(each, FIRST_FRAME) is not None)
    assert field["seeing_wind_frame_start"] == get_input(modifier, FIRST_FRAME) == first, "solvers feel it there, too"
    bpy.ops.seeing_wind.bake()
    assert np.abs(shown(box, first + 4) - shown(box, first)).max() > 0.001
    bpy.ops.seeing_wind.resimulate()
    assert not [note for note in notes_of(scene, "resimulate") if "begins with" in note], "said once"


def test_a_linked_wind_that_does_not_blow_in_the_scene_is_refused(scene, checks, stand_in, tmp_path):
    checks["swirl_field"](scene)
    bpy.data.libraries.write(str(tmp_path / "wind.blend"), {bpy.data.objects["Wind"]})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "wind.blend"), link=True) as (_, into):
        into.objects = ["Wind"]
    scene = bpy.context.scene
    scene.collection.objects.link(into.objects[0])
    scene.frame_start, scene.frame_end = 1001, 1014
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    with pytest.raises(RuntimeError, match="linked from another file. It blew from frame 5 to 11, and the scene lasts from 1001 to 1014"):
        bpy.ops.seeing_wind.resimulate()


def test_files_for_other_programs_are_for_the_frames_that_the_scene_plays(field, tmp_path, capfd):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1001, 1014
    assert [list(frames_of(scene, field)), field["seeing_wind_frame_start"]] == [[*range(6, 12)], 5]
    assert said_of_frames(scene, frames_of(scene, field)) == "frames 6 to 11, none of which the scene plays: it lasts from 1001 to 1014"
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    assert said_of_frames(scene, frames_of(scene, field)) == "frames 1002 to 1007"
    scene.frame_end = 1020
    assert bpy.ops.seeing_wind.export_field(format="FGA") == {"FINISHED"}
    assert f"Exported FGA to {tmp_path / 'Wind.Scene_field'}, for frames 1002 to 1020" in capfd.readouterr().out
    assert opened(Path(scene.seeing_wind.recovered_take) / "field.safetensors")[0]["frames"] == "19", "it is made anew"
    bpy.ops.seeing_wind.conform(field=field.name, real_time=True)
    assert list(frames_of(scene, field)) == [*range(1002, 1014)], "each of its frames lasts two"
    assert rows_at(field, np.arange(1002, 1014) - 0.5, 6).tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]
    field["seeing_wind_loop"], scene.frame_start = True, 1011
    assert list(frames_of(scene, field)) == [*range(1012, 1021)]
    assert rows_at(field, np.arange(1012, 1021) - 0.5, 6).tolist() == [5, 5, 0, 0, 1, 1, 2, 2, 3]


def test_of_several_winds_it_is_the_selected_one(field):
    scene = bpy.context.scene
    other = field.copy()
    other.name = "A Wind"
    scene.collection.objects.link(other)
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    with pytest.raises(RuntimeError, match="several winds: A Wind, Wind. Select the one"):
        bpy.ops.seeing_wind.resimulate()
    field.select_set(True)
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"} and scene.seeing_wind.field_object == field
    said = "The bodies move in Wind alone: A Wind is left out. Tick All Fields to let every field of the scene act"
    assert said in notes_of(scene, "resimulate")
    field.select_set(False)
    assert lone_wind(scene) == field, "as the last time"
    other.select_set(True)
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"} and scene.seeing_wind.field_object == other
    field.hide_viewport = True
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}
    assert not [note for note in notes_of(scene, "resimulate") if "left out" in note]


def test_a_scene_with_a_take_of_its_own_keeps_it(recovered):
    assert lone_wind(recovered) is None


def test_without_any_wind_it_is_said(scene, stand_in):
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    with pytest.raises(RuntimeError, match="no recovered field"):
        bpy.ops.seeing_wind.resimulate()


def recover(workplace: Path, take: Path) -> set[str]:
    return bpy.ops.seeing_wind.recover(clip=str(workplace / "clip.mp4"), box=(20, 20, 44, 44), distance=2.0, take=str(take))


@pytest.mark.parametrize("take_is_gone", [False, True])
def test_a_recovery_leaves_a_wind_that_was_simulated_in_as_it_is(field, workplace, tmp_path, take_is_gone):
    """It is no result of a former recovery, also when the folder that was made of it has been deleted."""
    scene = bpy.context.scene
    before = (field["seeing_wind_density"], len(samples_of(field).data.vertices), field.field.texture)
    cube("Box", (0.3, 0.0, 0.6))
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    if take_is_gone:
        shutil.rmtree(scene.seeing_wind.recovered_take)
    assert recover(workplace, tmp_path / "own.take") == {"FINISHED"}
    assert (field["seeing_wind_density"], len(samples_of(field).data.vertices), field.field.texture) == before
    made = scene.seeing_wind.field_object
    assert made.name == "Recovered Wind" and scene.seeing_wind.arrows_object.name == "Recovered Wind Arrows"
    assert field.name in scene.objects and lone_wind(scene) is None, "the scene has a recovery of its own now"
    assert [note for note in notes_of(scene) if note.startswith("Wind stays: solvers feel both winds")]
    assert recover(workplace, tmp_path / "own.take") == {"FINISHED"} and scene.seeing_wind.field_object == made
    assert (field["seeing_wind_density"], len(samples_of(field).data.vertices), field.field.texture) == before


def test_a_recovery_that_fails_takes_no_lone_wind_into_its_folder(scene, checks, stand_in, workplace, monkeypatch, tmp_path):
    """While the file is unsaved, what an unfinished recovery left in the temporary folder goes along; this is none of it."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    checks["swirl_field"](scene)
    scene.frame_end = 14
    cube("Box", (0.3, 0.0, 0.6))
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    assert tmp_path / "temporary" in Path(scene.seeing_wind.recovered_take).parents
    monkeypatch.setenv("SEEING_WIND_FAKE", "error")
    with pytest.raises(RuntimeError, match="outside the frame"):
        recover(workplace, tmp_path / "own.take")
    assert not (tmp_path / "own.take" / "field.safetensors").exists() and not (tmp_path / "own.take" / "take.toml").exists()


def test_the_take_of_a_lone_wind_is_made_again(field):
    """Also when it was deleted since: all that it holds is in the file."""
    cube("Box", (0.3, 0.0, 0.6))
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    shutil.rmtree(bpy.context.scene.seeing_wind.recovered_take)
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}


def test_a_wind_of_a_file_with_another_unit_is_converted(field):
    """The engine is given the same field in metres."""
    scene, given = bpy.context.scene, []
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    for unit in (1.0, 0.01):
        scene.unit_settings.scale_length = unit
        assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}
        metadata, arrays = opened(Path(scene.seeing_wind.recovered_take) / "field.safetensors")
        given.append((json.loads(metadata["box"]), arrays["force"]))
    np.testing.assert_allclose(given[1][0], given[0][0], rtol=1e-5)
    np.testing.assert_allclose(given[1][1], given[0][1], rtol=1e-5)


@pytest.mark.parametrize("redone", [True, False])
def test_an_undo_while_it_is_simulated_takes_neither_wind_nor_frames_back(field, monkeypatch, redone):
    """What the job has changed when it began is no step of its own yet."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1001, 1014
    box = cube("Box", (0.3, 0.0, 0.6))
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.ed.undo_push(message="Insert")
    cube("Later")
    bpy.ops.ed.undo_push(message="Later")
    monkeypatch.setattr(job_operator, "blocks", lambda context: False)
    operator, window = resimulating(scene), Window(scene)
    assert operator.execute(window) == {"RUNNING_MODAL"}
    bpy.ops.ed.undo()
    if redone:
        bpy.ops.ed.redo()
    scene = bpy.context.scene
    settings = scene.seeing_wind
    assert settings.recovered_take == "" and scene.objects["Wind"]["seeing_wind_frame_start"] == 5
    assert step_until_over(operator, window) == {"FINISHED"}
    assert settings.field_object == scene.objects["Wind"] and settings.field_object["seeing_wind_frame_start"] == 1001
    assert state("resimulate") == "done" and bpy.ops.seeing_wind.bake() == {"FINISHED"}
    box = scene.objects["Box"]
    assert np.abs(shown(box, 1005) - shown(box, 1001)).max() > 0.001
