"""A field object that was duplicated works by itself."""

from __future__ import annotations

import runpy
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.ui.field.display import SLOWS, said_of_override, share
from seeing_wind.ui.field.library import copies
from seeing_wind.ui.field.library.copies import copies_in, make_independent
from seeing_wind.ui.field.samples import samples_of
from tests.ui.extension import switched_on
from tests.ui.meshes import cube

WIND_CHECK = runpy.run_path(str(Path(__file__).resolve().parents[2] / "blender" / "wind_check.py"), run_name="checks")


def duplicated(field: bpy.types.Object, linked: bool = False) -> bpy.types.Object:
    """By Shift+D or Alt+D."""
    for obj in bpy.context.scene.objects:
        obj.select_set(obj == field)
    bpy.context.view_layer.objects.active = field
    bpy.ops.object.duplicate(linked=linked)
    return bpy.context.view_layer.objects.active


def test_a_duplicate_turns_and_blows_by_itself(scene, checks):
    """Turned, moved and half as strong: it is felt as a field of its own that was made so, and the first as before."""
    field = checks["swirl_field"](scene)
    copy = duplicated(field)
    assert copies_in(scene) == [copy]
    copy.field.strength *= 0.5
    make_independent(copy)
    assert copies_in(scene) == [] and share(copy) == pytest.approx(0.5)
    assert samples_of(copy).parent == copy and samples_of(field).parent == field and copy.field.texture != field.field.texture
    copy.rotation_euler.z, copy.location.x = 0.5 * np.pi, 10.0
    field.field.strength = 0.0
    points, interval = np.random.default_rng(0).uniform(*checks["BOX"], (60, 3)) - checks["CENTRE"], 2
    bpy.context.view_layer.update()
    moved = np.array(copy.matrix_world)
    at, found = checks["released_accelerations"](scene, copy, points @ moved[:3, :3].T + moved[:3, 3], checks["FRAME_START"] + interval)
    local = (at - moved[:3, 3]) @ moved[:3, :3]
    truth = checks["swirl"](local + checks["CENTRE"], interval) @ moved[:3, :3].T * 0.5 / checks["DENSITY"]
    angle, size = checks["worst_errors"](found, truth)
    assert angle < 1.0 and size < 0.02
    bpy.data.objects.remove(field)
    assert samples_of(copy) is not None, "the copy outlives its original"


def test_a_library_override_is_felt_as_it_is_turned(scene, stand_in, checks, tmp_path):
    """Of a linked wind: moved and turned, and after the file was saved and opened again."""
    checks["swirl_field"](scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "wind.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "wind.blend"), link=True) as (there, wanted):
        wanted.objects = [name for name in there.objects if "Samples" not in name]
    bpy.context.scene.collection.objects.link(wanted.objects[0])
    field = wanted.objects[0].override_create(remap_local_usages=True)
    field.rotation_euler.z, field.location.x = 0.5 * np.pi, 10.0
    bpy.context.view_layer.update()
    assert said_of_override(field)
    assert bpy.ops.seeing_wind.turn_override(field=field.name) == {"FINISHED"} == bpy.ops.seeing_wind.turn_override(field=field.name)
    assert not said_of_override(field) and len([each for each in field.modifiers if "Turned" in each.name]) == 1
    points, interval = np.random.default_rng(0).uniform(*checks["BOX"], (60, 3)) - checks["CENTRE"], 2
    for _ in range(2):
        scene, field = bpy.context.scene, next(obj for obj in bpy.data.objects if obj.override_library is not None)
        bpy.context.view_layer.update()
        moved = np.array(field.matrix_world)
        places = points @ moved[:3, :3].T + moved[:3, 3]
        at, found = checks["released_accelerations"](scene, field, places, checks["FRAME_START"] + interval)
        local = (at - moved[:3, 3]) @ moved[:3, :3]
        truth = checks["swirl"](local + checks["CENTRE"], interval) @ moved[:3, :3].T / checks["DENSITY"]
        angle, size = checks["worst_errors"](found, truth)
        assert angle < 1.0 and size < 0.02
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    (tmp_path / "wind.blend").rename(tmp_path / "moved.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    with pytest.raises(RuntimeError, match="values under .* are gone. Link it again"):
        bpy.ops.seeing_wind.turn_override()
    own = checks["swirl_field"](bpy.context.scene)
    with pytest.raises(RuntimeError, match="no library override"):
        bpy.ops.seeing_wind.turn_override(field=own.name)


def test_what_is_no_copy_is_left_alone(scene, checks):
    field = checks["swirl_field"](scene)
    other = checks["swirl_field"](scene)
    bpy.ops.mesh.primitive_cube_add()
    assert copies_in(scene) == [] and samples_of(field) != samples_of(other)


@pytest.mark.parametrize("how", ["duplicate", "linked", "copy"])
def test_in_the_background_it_is_so_at_the_next_frame(scene, stand_in, checks, how):
    """By a script, which leaves Blender no time between its lines."""
    field = checks["swirl_field"](scene)
    if how == "copy":
        copy = field.copy()
        scene.collection.objects.link(copy)
    else:
        copy = duplicated(field, linked=how == "linked")
    copy.rotation_euler.z = 0.5 * np.pi
    scene.frame_set(2)
    assert samples_of(copy).parent == copy and copy.field.texture != field.field.texture and copy.data != field.data
    assert samples_of(field).parent == field and copies_in(scene) == []


def test_files_with_copies_are_mended_when_they_are_opened(scene, checks, workplace, tmp_path, monkeypatch):
    field = checks["swirl_field"](scene)
    duplicated(field)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    with switched_on(monkeypatch, workplace):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
        first, second = (bpy.data.objects[name] for name in ("Wind", "Wind.001"))
        assert samples_of(second).parent == second and first.field.texture != second.field.texture


def test_a_copy_is_made_independent_before_it_is_calibrated_for(scene, stand_in, checks):
    copy = duplicated(checks["swirl_field"](scene))
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.modifiers.new("Dust", "PARTICLE_SYSTEM")
    bpy.ops.seeing_wind.calibrate(field=copy.name)
    assert samples_of(copy).parent == copy


def test_copies_and_what_is_left_of_deleted_winds_are_mended_before_a_re_simulation(scene, stand_in, checks, tmp_path, monkeypatch):
    """By a script in a window: there a change of the frame leaves it to a timer, which does not run between the script's lines."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    bpy.app.handlers.frame_change_pre.remove(copies._before_frame)
    deleted, dust = WIND_CHECK["steady"](scene), WIND_CHECK["dust"](scene)
    bpy.ops.seeing_wind.calibrate(object=dust.name)
    bpy.data.objects.remove(deleted)
    copy = duplicated(checks["swirl_field"](scene))
    cube("Box")
    assert bpy.ops.seeing_wind.insert_mesh(object="Box") == {"FINISHED"}
    assert copies_in(scene) == [copy] and "Wind Still Air" in scene.objects
    copy.select_set(True)
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"} and scene.seeing_wind.field_object == copy
    assert samples_of(copy).parent == copy and copies_in(scene) == []
    assert "Wind Still Air" not in bpy.data.objects


@pytest.mark.parametrize("how", ["operator", "data"])
def test_still_air_goes_with_its_wind(scene, stand_in, how):
    """A particle that was thrown goes on as fast, also when its wind is deleted while the file is worked on by a script."""
    field, dust = WIND_CHECK["steady"](scene), WIND_CHECK["dust"](scene)
    bpy.ops.seeing_wind.calibrate(object=dust.name)
    scene.frame_set(1)
    assert "Wind Still Air" in scene.objects
    dust.particle_systems[0].settings.normal_factor = 1.0
    if how == "data":
        bpy.data.objects.remove(field)
    else:
        with bpy.context.temp_override(selected_objects=[field]):
            bpy.ops.object.delete()
    dust.particle_systems[0].seed += 1
    assert WIND_CHECK["dust_speeds"](dust, scene, 10) == pytest.approx(1.0, abs=1e-4)
    assert "Wind Still Air" not in bpy.data.objects


def test_still_air_of_a_deleted_wind_goes_on_in_its_copy(scene, stand_in):
    field, dust = WIND_CHECK["steady"](scene), WIND_CHECK["dust"](scene)
    bpy.ops.seeing_wind.calibrate(object=dust.name, density=5.0)
    before = WIND_CHECK["dust_speeds"](dust, scene, 20)
    copy = duplicated(field)
    scene.frame_set(1)
    bpy.data.objects.remove(field)
    dust.particle_systems[0].seed += 1
    assert WIND_CHECK["dust_speeds"](dust, scene, 20) == pytest.approx(before, rel=0.01)
    assert [obj[SLOWS] for obj in scene.objects if SLOWS in obj] == [copy]


def test_a_file_with_the_still_air_of_a_deleted_wind_is_mended_when_it_is_opened(scene, stand_in, tmp_path):
    field, dust = WIND_CHECK["steady"](scene), WIND_CHECK["dust"](scene)
    bpy.ops.seeing_wind.calibrate(object=dust.name)
    bpy.data.objects.remove(field)
    assert "Wind Still Air" in scene.objects
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert "Wind Still Air" not in bpy.data.objects


def test_the_add_on_makes_it_so_by_itself(scene, stand_in, checks, monkeypatch):
    registered = []
    monkeypatch.setattr(bpy.app.timers, "register", lambda function, **_: registered.append(function))
    field = checks["swirl_field"](scene)
    copy = duplicated(field)
    bpy.context.view_layer.update()
    assert registered and registered[0]() is None
    assert samples_of(copy).parent == copy and samples_of(field).parent == field
