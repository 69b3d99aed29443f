"""A take of the command line or a batch, loaded into a new file: the panel is filled, and one can go on."""

from __future__ import annotations

import re
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.engine.reading import read_arrays
from seeing_wind.engine.take import Take
from seeing_wind.ui import freshness
from seeing_wind.ui.composite import composite
from seeing_wind.ui.job import takes
from seeing_wind.ui.recover.simulated import import_bodies
from tests.ui.edit.edits import written
from tests.ui.jobs import notes_of, now, recover
from tests.ui.meshes import cube, group

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture
def take(stand_in, workplace, tmp_path) -> Path:
    """As the engine leaves it: a stage with its settings each."""
    folder = tmp_path / "out.take"
    recover(workplace, take=str(folder))
    clip = str(workplace / "clip.mp4")
    observed = {"clip": clip, "box": [20.0, 20.0, 44.0, 44.0], "distance": 2.5, "frames": [2, 9], "fov": 40.0, "seed": 4}
    observed["correct"] = [5.0, 20.5, 12.0, 1.0, 3.0, 30.0, 11.0, 0.0]
    Take(folder).finish("observe", "o", observed | {"mask": "/gone.png"})
    made = {"material": "paper", "density": 800.0, "law": "corotated", "particles": 500, "head_material": "flower_head"}
    Take(folder).finish("build", "b", made)
    Take(folder).finish("solve", "s", {"gravity": [0.0, 0.0, -3.0], "iterations": 7, "stiffness": "free"})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return folder


def test_reload_into_a_new_file_fills_the_panel(take, workplace) -> None:
    bpy.ops.seeing_wind.build_scene(take=str(take))
    settings = bpy.context.scene.seeing_wind
    assert Path(settings.clip) == workplace / "clip.mp4"
    assert tuple(settings.box) == (20.0, 20.0, 44.0, 44.0) and settings.object_mode == "BOX"
    assert settings.distance == pytest.approx(2.5) and settings.scale_mode == "DISTANCE" and tuple(settings.frames) == (2, 9)
    assert settings.use_frames and settings.fov == pytest.approx(40.0) and settings.camera_mode == "FOV"
    assert (settings.material, settings.use_density, settings.density, settings.law) == ("paper", True, 800.0, "COROTATED")
    assert (settings.head_material, settings.leaf_material) == ("flower_head", "PRESET")
    assert settings.gravity_mode == "CUSTOM" and settings.gravity[2] == pytest.approx(-3.0) and settings.iterations == 7
    points = [(one.clip_frame, tuple(one.place), one.beside) for one in settings.corrections]
    assert points == [(5, (20.5, 12.0), False), (3, (30.0, 11.0), True)]
    assert settings.mask == "", "a file that is gone is left out"
    steps = now(bpy.context.scene)
    assert steps["clip"].state == "done" and steps["object"].state == "done"


@pytest.mark.parametrize(
    "given, unit, mode",
    [
        ([0.0, 0.0, -9.81], 1.0, "SCENE"), ([0.0, 0.0, -9.81], 0.1, "SCENE"), ([0.0, 0.0, 0.0], 1.0, "NONE"),
        ([0.0, 0.0, -9.8], 1.0, "CUSTOM"), ([0.0, 9.81, 0.0], 1.0, "CUSTOM"),
    ],
)  # fmt: skip
def test_a_gravity_that_is_a_preset_reads_as_one(take, given, unit, mode) -> None:
    Take(take).finish("solve", "s", {"gravity": given})
    scene = bpy.context.scene
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", unit
    scene.gravity = (0.0, 0.0, -9.81 / unit)
    bpy.ops.seeing_wind.build_scene(take=str(take))
    assert scene.seeing_wind.gravity_mode == mode


def test_the_scene_s_gravity_is_no_preset_while_it_is_off(take) -> None:
    Take(take).finish("solve", "s", {"gravity": [0.0, 0.0, -9.81]})
    bpy.context.scene.use_gravity = False
    bpy.ops.seeing_wind.build_scene(take=str(take))
    assert bpy.context.scene.seeing_wind.gravity_mode == "CUSTOM"


@pytest.mark.parametrize("given, mode", [([0.0, 0.0, -3.0], "SAME"), ([0.0, 0.0, 0.0], "NONE"), ([0.0, 0.0, -9.81], "CUSTOM")])
def test_a_gravity_of_an_edit_that_is_a_preset_reads_as_one(take, simulated, given, mode) -> None:
    edit = take.parent / "edit.toml"
    edit.write_text(re.sub(r"gravity = .*", f"gravity = {given}", edit.read_text()))
    bpy.ops.seeing_wind.build_scene(take=str(take))
    scene = bpy.context.scene
    import_bodies(scene, simulated, scene.seeing_wind.frame_start)
    assert scene.seeing_wind.edit_gravity_mode == mode and tuple(scene.seeing_wind.edit_gravity) == pytest.approx(given)


def test_settings_that_are_there_are_left_alone(take, workplace) -> None:
    settings = bpy.context.scene.seeing_wind
    settings.clip, settings.distance, settings.box = str(workplace / "clip.mp4"), 7.0, (1.0, 2.0, 30.0, 40.0)
    bpy.ops.seeing_wind.build_scene(take=str(take))
    assert settings.distance == 7.0 and tuple(settings.box) == (1.0, 2.0, 30.0, 40.0)
    settings.clip, settings.box = str(workplace / "other.mp4"), (0.0, 0.0, 0.0, 0.0)
    bpy.ops.seeing_wind.build_scene(take=str(take))
    assert settings.distance == 7.0 and settings.clip.endswith("other.mp4")


def test_a_scene_with_the_same_clip_and_nothing_marked_is_filled(take, workplace) -> None:
    bpy.ops.seeing_wind.choose_clip(filepath=str(workplace / "clip.mp4"))
    bpy.ops.seeing_wind.build_scene(take=str(take))
    settings = bpy.context.scene.seeing_wind
    assert tuple(settings.box) == (20.0, 20.0, 44.0, 44.0) and settings.distance == pytest.approx(2.5)


@pytest.fixture
def simulated(take) -> Path:
    """A re-simulation by the command line: its edit stands elsewhere. Returns its take."""
    bpy.ops.seeing_wind.build_scene(take=str(take))
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.insert_mesh(recovered=True)
    bpy.ops.seeing_wind.scale_mass(object="Box", factor=3.0)
    bpy.context.scene.seeing_wind.field_strength = 0.5
    bpy.ops.seeing_wind.resimulate()
    mine = Path(bpy.context.scene.seeing_wind.simulated_take)
    theirs = mine.with_name("out.edit.take")
    assert mine == theirs, "nobody else's was there"
    text = (mine / "edit.toml").read_text()
    (take.parent / "edit.toml").write_text(text)
    (mine / "edit.toml").unlink()
    Take(theirs).finish("resimulate", "r", {"source": str(take), "edit": str(take.parent / "edit.toml")})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return theirs


def test_the_edit_list_is_filled_and_the_object_wears_its_frame(take, simulated) -> None:
    bpy.ops.seeing_wind.build_scene(take=str(take))
    scene = bpy.context.scene
    made = import_bodies(scene, simulated, scene.seeing_wind.frame_start)
    settings = scene.seeing_wind
    box, own = settings.bodies
    assert box.object == made["Box"] and box.mass_scale == 3.0 and own.is_recovered
    assert settings.field_strength == 0.5 and settings.edit_gravity_mode == "SAME"
    assert [material.name for material in own.baked_copy.data.materials] == [m.name for m in settings.recovered_object.data.materials]
    uv = [np.array([each.vector[:] for each in mesh.uv_layers.active.uv]) for mesh in (own.baked_copy.data, settings.recovered_object.data)]
    assert np.allclose(*uv)
    # the clip's object moves anew, so it must not be seen a second time
    assert composite.set_up(scene).behind == "moving plate"


def test_what_others_have_simulated_is_not_written_over(take, simulated) -> None:
    bpy.ops.seeing_wind.build_scene(take=str(take))
    scene = bpy.context.scene
    before = {path: path.stat().st_mtime_ns for path in simulated.rglob("*") if path.is_file()}
    cube("Other")
    bpy.ops.seeing_wind.insert_mesh(object="Other")
    bpy.ops.seeing_wind.resimulate()
    mine = Path(scene.seeing_wind.simulated_take)
    assert mine.name == "out.edit.2.take" and {path: path.stat().st_mtime_ns for path in simulated.rglob("*") if path.is_file()} == before
    bpy.ops.seeing_wind.resimulate()
    assert takes.edit_folder(scene.seeing_wind, take) == mine, "one's own is used again"


def test_pins_floor_and_colliders_of_an_edit_are_there_again(take) -> None:
    """Simulated again from the file, the edit says what it said."""
    bpy.ops.seeing_wind.build_scene(take=str(take))
    scene = bpy.context.scene
    box = cube("Box", (0.1, 0.2, 0.3))
    cube("Table", (0.0, 0.0, -1.0))
    group(box, "Top", {0: 1.0, 3: 0.25})
    bpy.ops.seeing_wind.insert_mesh(object="Box", pin_group="Top")
    bpy.ops.seeing_wind.insert_collider(object="Table", friction=0.7)
    settings = scene.seeing_wind
    settings.use_floor, settings.floor_height, settings.floor_friction, settings.edit_preroll = True, -2.0, 0.6, 7
    bpy.ops.seeing_wind.resimulate()
    folder = Path(settings.simulated_take)
    first = written(folder.parent, folder.name)
    before = {name: read_arrays(folder / name) for name in (first["collider"][1]["mesh"], first["body"][0]["mesh"])}
    pins = [np.load(folder / first["body"][0][name]) for name in ("pin", "pin_weights")]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.seeing_wind.build_scene(take=str(take))
    scene = bpy.context.scene
    import_bodies(scene, folder, scene.seeing_wind.frame_start)
    freshness.refresh(scene)
    assert [now(scene)[step].state for step in ("resimulate", "bake")] == ["done"] * 2, "nothing has changed since"
    scene.seeing_wind.bodies[0].mass_scale = 2.0
    assert [now(scene)[step].state for step in ("resimulate", "bake")] == ["stale"] * 2
    scene.seeing_wind.bodies[0].mass_scale = 1.0
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}
    folder = Path(scene.seeing_wind.simulated_take)
    again = written(folder.parent, folder.name)
    assert again["preroll"] == 7 and again["collider"][0] == first["collider"][0], "the floor"
    assert {name: again["collider"][1][name] for name in ("name", "kind", "friction")} == {
        "name": "Table", "kind": "separate", "friction": pytest.approx(0.7)
    }  # fmt: skip
    for name, arrays in before.items():
        np.testing.assert_allclose(read_arrays(folder / name)["vertices"], arrays["vertices"], atol=1e-6)
    for name, values in zip(("pin", "pin_weights"), pins):
        np.testing.assert_allclose(np.load(folder / again["body"][0][name]), values, atol=1e-6)


def test_what_the_panel_cannot_take_over_is_said(take) -> None:
    bpy.ops.seeing_wind.build_scene(take=str(take))
    scene = bpy.context.scene
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    table = cube("Table", (0.0, 0.0, -1.0))
    for frame, height in ((1, -1.0), (13, -0.5)):
        table.location.z = height
        table.keyframe_insert("location", frame=frame)
    bpy.ops.seeing_wind.insert_collider(object="Table")
    bpy.ops.seeing_wind.resimulate()
    folder = Path(scene.seeing_wind.simulated_take)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.seeing_wind.build_scene(take=str(take))
    scene = bpy.context.scene
    import_bodies(scene, folder, scene.seeing_wind.frame_start)
    (note,) = notes_of(scene, "resimulate")
    assert note.startswith("Re-simulate would leave out") and note.endswith("how the collider Table moves")


def test_a_take_whose_settings_the_panel_has_is_not_called_out_of_date(take) -> None:
    bpy.ops.seeing_wind.build_scene(take=str(take))
    assert now(bpy.context.scene)["recover"].state == "stale", "its mask is gone"
    observed = Take(take).description()["stages"]["observe"]["settings"]
    Take(take).finish("observe", "o", {name: value for name, value in observed.items() if name != "mask"})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.seeing_wind.build_scene(take=str(take))
    assert now(bpy.context.scene)["recover"].state == "done"
    bpy.context.scene.seeing_wind.distance = 3.0
    assert now(bpy.context.scene)["recover"].state == "stale"
