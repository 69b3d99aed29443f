"""A recovered wind in another shot: appended or linked, calibrated by name or selection, at another frame rate, from a moved project."""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from seeing_wind.ui.field.display import field_at_hand, out_of_time, said_of_wind
from seeing_wind.ui.field.samples import read_samples, samples_of
from seeing_wind.ui.scene_units import said_of_units, unit_of
from tests.ui.jobs import now, recover

pytestmark = pytest.mark.usefixtures("stand_in")


def sheet(name: str = "Sheet") -> bpy.types.Object:
    bpy.ops.mesh.primitive_grid_add(size=0.5)
    obj = bpy.context.object
    obj.name = name
    obj.modifiers.new("Cloth", "CLOTH")
    return obj


def weight(obj: bpy.types.Object) -> float:
    return obj.modifiers["Cloth"].settings.effector_weights.texture


@pytest.fixture
def library(checks, tmp_path) -> Path:
    """A file with the swirl as a field object."""
    checks["swirl_field"](bpy.context.scene)
    path = tmp_path / "wind.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return path


def brought(path: Path, link: bool) -> bpy.types.Object:
    with bpy.data.libraries.load(str(path), link=link) as (_, wanted):
        wanted.objects = ["Wind"]
    bpy.context.scene.collection.objects.link(wanted.objects[0])
    return wanted.objects[0]


@pytest.mark.parametrize("link", [False, True])
def test_an_appended_or_linked_field_is_calibrated_and_carries_its_values(library, checks, link: bool) -> None:
    field, obj = brought(library, link), sheet()
    assert bpy.ops.seeing_wind.calibrate() == {"FINISHED"} and weight(obj) > 0.0
    angle, size = checks["field_errors"](bpy.context.scene, field, 2)
    assert angle < 1.0 and size < 0.02
    assert samples_of(field) is not None
    if link:
        with pytest.raises(RuntimeError, match="linked"):
            bpy.ops.seeing_wind.apply_to_field(field="Wind")
        with pytest.raises(RuntimeError, match="linked"):
            bpy.ops.seeing_wind.conform(field="Wind")
    else:
        bpy.context.scene.seeing_wind.field_reach = "HOLD"
        assert bpy.ops.seeing_wind.apply_to_field() == {"FINISHED"} and field["seeing_wind_reach"] == "HOLD"


@pytest.mark.parametrize("how", ["shown", "played", "calibrate", "apply_to_field", "export_field"])
def test_an_appended_field_is_converted_to_the_scenes_unit(library, monkeypatch, tmp_path, how: str) -> None:
    """As a wind of the library is; nothing but its place in the scene stays."""
    timers: list = []
    monkeypatch.setattr(bpy.app.timers, "register", lambda function, **_: timers.append(function))
    scene = bpy.context.scene
    scene.unit_settings.scale_length = 0.01
    field = brought(library, False)
    field["seeing_wind_take"] = "of.take"  # a force of one's own, not a wind of the library
    before, place = read_samples(samples_of(field)), tuple(field.location)
    assert unit_of(field) == 1.0
    if how == "shown":
        bpy.context.view_layer.update()
        timers[-1]()
    elif how == "played":
        scene.frame_set(2)
    else:
        sheet()
        given = {"filepath": str(tmp_path / "vdb"), "format": "VDB"} if how == "export_field" else {}
        monkeypatch.setattr("seeing_wind.ui.field.vdb.write_vdb", lambda scene, field, folder: [])
        assert getattr(bpy.ops.seeing_wind, how)(field="Wind", **given) == {"FINISHED"}
    after = read_samples(samples_of(field))
    for name in ("points", "force"):
        np.testing.assert_allclose(getattr(after, name), 100.0 * getattr(before, name), rtol=1e-5)
    assert said_of_units(field, scene) == "" and tuple(field.location) == place


def test_a_field_in_two_scenes_of_different_units_is_left_as_it_is(library) -> None:
    scene, other = bpy.context.scene, bpy.data.scenes.new("Other")
    other.unit_settings.scale_length = 0.01
    field = brought(library, False)
    other.collection.objects.link(field)
    other.frame_set(2)
    assert unit_of(field) == 1.0 and said_of_units(field, scene) == ""
    assert "place, size and strength are wrong. Set Unit Scale to 1" in said_of_units(field, other)


def test_the_selected_field_is_exported_whose_ever_it_is(library, workplace, tmp_path, monkeypatch) -> None:
    written: list[str] = []
    monkeypatch.setattr("seeing_wind.ui.field.vdb.write_vdb", lambda scene, field, folder: written.append(field.name) or [])
    field = brought(library, False)
    assert bpy.ops.seeing_wind.export_field(format="VDB", filepath=str(tmp_path / "vdb")) == {"FINISHED"}
    with pytest.raises(RuntimeError, match="without its take, which PLY"):
        bpy.ops.seeing_wind.export_field(format="PLY", filepath=str(tmp_path / "ply"))
    recover(workplace)
    own = bpy.context.scene.seeing_wind.field_object
    bpy.ops.object.select_all(action="DESELECT")
    field.select_set(True)
    bpy.ops.seeing_wind.export_field(format="VDB", filepath=str(tmp_path / "vdb"))
    field.select_set(False)
    bpy.ops.seeing_wind.export_field(format="VDB", filepath=str(tmp_path / "vdb"))
    assert written == [field.name, field.name, own.name] and field != own


def test_of_several_fields_the_selected_or_named_one_is_meant(library) -> None:
    first, second = brought(library, False), brought(library, False)
    second["seeing_wind_density"] = 12.0
    obj = sheet()
    with pytest.raises(RuntimeError, match="several recovered fields"):
        bpy.ops.seeing_wind.calibrate()
    bpy.ops.seeing_wind.calibrate(field=first.name)
    light = weight(obj)
    second.select_set(True)
    assert field_at_hand(bpy.context) == second
    no_window = SimpleNamespace(scene=bpy.context.scene)
    assert field_at_hand(no_window) == bpy.context.scene.seeing_wind.field_object, "as at the start of a script"
    bpy.ops.seeing_wind.calibrate()
    assert weight(obj) / light == pytest.approx(10.0, rel=1e-5)
    with pytest.raises(RuntimeError, match="no recovered force field"):
        bpy.ops.seeing_wind.calibrate(field=obj.name)
    with pytest.raises(RuntimeError, match="is the wind itself"):
        bpy.ops.seeing_wind.calibrate(object=second.name)


@pytest.mark.parametrize("link", [False, True])
def test_a_wind_from_another_file_is_a_wind_here_and_all_is_calibrated_at_once(tmp_path, link: bool) -> None:
    check = runpy.run_path(str(Path(__file__).resolve().parents[2] / "blender" / "wind_check.py"), run_name="checks")
    check["steady"](bpy.context.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "wind.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    with pytest.raises(RuntimeError, match="no recovered field"):
        bpy.ops.seeing_wind.calibrate(every=True)
    field = brought(tmp_path / "wind.blend", link)
    with pytest.raises(RuntimeError, match="Nothing in this scene feels wind"):
        bpy.ops.seeing_wind.calibrate(every=True)
    cloth, dust = check["sheet"](scene), check["dust"](scene)
    broken = sheet("Broken")
    broken.modifiers["Cloth"].settings.time_scale = 3.0
    assert bpy.ops.seeing_wind.calibrate(every=True, areal_density=0.1, density=5.0) == {"FINISHED"}
    assert {each.object for each in scene.seeing_wind.calibrations} == {cloth, dust}
    bpy.data.objects.remove(broken)
    assert said_of_wind(field) == "Wind: 1.5 m/s (Beaufort 1) in the mean, gusts up to 1.5 m/s (Beaufort 1)"
    way = check["drag_way"](check["DRAG"] * check["SPEED"] / 0.1, 16)[0][15]
    assert check["places"](cloth, scene, 16)[15, 2] + 0.9 == pytest.approx(way, rel=0.06)


def test_two_fields_of_a_scene_add_up(library, checks) -> None:
    """Twice the same swirl is felt as twice as strong by what was calibrated for one of them."""
    first, second = brought(library, False), brought(library, False)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=0.02, location=checks["CENTRE"])
    obj = bpy.context.object
    settings = obj.modifiers.new("Dust", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.frame_start, settings.frame_end, settings.lifetime, settings.normal_factor = 20, 1, 1, 500, 0.0
    scene.use_gravity = False
    bpy.ops.seeing_wind.calibrate(object=obj.name, field=first.name)
    strength, places = first.field.strength, []
    for factors in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)):
        first.field.strength, second.field.strength = (strength * factor for factor in factors)
        for frame in range(1, 4):
            scene.frame_set(frame)
        system = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
        places.append(np.mean([particle.location[:] for particle in system.particles], axis=0))
    one, both = places[1] - places[0], places[2] - places[0]
    assert both == pytest.approx(2.0 * one, rel=0.02, abs=1e-6) and np.linalg.norm(one) > 1e-3


def test_another_frame_rate_is_said_and_mended_by_one_click(library, checks) -> None:
    """Rigid bodies moved 1.94 times as far per frame at 24 instead of 29.92 frames a second, without a word. Cloth does not."""
    brought(library, False)
    scene, obj = bpy.context.scene, sheet()
    scene.render.fps, scene.render.fps_base = 30, 30 / 29.92
    bpy.ops.seeing_wind.calibrate(density=300.0)
    bpy.ops.rigidbody.world_add()
    bpy.ops.mesh.primitive_cube_add(size=0.1)
    bpy.ops.rigidbody.object_add()
    cube, weights = bpy.context.object, scene.rigidbody_world.effector_weights
    bpy.ops.seeing_wind.calibrate(density=300.0)
    before, cloth = weights.texture, weight(obj)
    assert not out_of_time(scene)
    scene.render.fps, scene.render.fps_base = 24, 1.0
    assert [each.object for each in out_of_time(scene)] == [cube]
    bpy.ops.seeing_wind.calibrate_again()
    assert not out_of_time(scene) and weights.texture / before == pytest.approx((24.0 / 29.92) ** 2, rel=1e-4)
    bpy.ops.seeing_wind.calibrate(object=obj.name, density=300.0)
    assert weight(obj) == cloth
    bpy.data.objects.remove(cube)
    scene.render.fps = 50
    assert not out_of_time(scene), "what was deleted is no matter"


def test_a_project_that_was_moved_works(workplace, tmp_path) -> None:
    home = tmp_path / "before"
    home.mkdir()
    shutil.copy(workplace / "clip.mp4", home / "clip.mp4")
    scene = bpy.context.scene
    recover(workplace, clip=str(home / "clip.mp4"), take=str(home / "clip.take"))
    bpy.ops.wm.save_as_mainfile(filepath=str(home / "shot.blend"))
    assert (scene.seeing_wind.clip, scene.seeing_wind.take) == ("//clip.mp4", "//clip.take")
    assert now(scene)["recover"].state == "done"
    home.rename(tmp_path / "after")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "after" / "shot.blend"))
    scene = bpy.context.scene
    assert now(scene)["clip"].state == "done" and now(scene)["recover"].state == "done"
    # saved elsewhere, the paths lead to the same files
    (tmp_path / "deep" / "er").mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "deep" / "er" / "shot.blend"))
    assert Path(bpy.path.abspath(scene.seeing_wind.clip)).resolve() == (tmp_path / "after" / "clip.mp4").resolve()
    assert np.isfinite(scene.seeing_wind.field_object["seeing_wind_fps"])
