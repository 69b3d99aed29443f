"""A field object that was duplicated works by itself."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from seeing_wind.ui.field.display import said_of_override, share
from seeing_wind.ui.field.library.copies import copies_in, make_independent
from seeing_wind.ui.field.samples import samples_of


def duplicated(field: bpy.types.Object) -> bpy.types.Object:
    """By Shift+D."""
    for obj in bpy.context.scene.objects:
        obj.select_set(obj == field)
    bpy.context.view_layer.objects.active = field
    bpy.ops.object.duplicate()
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


def test_the_add_on_makes_it_so_by_itself(scene, stand_in, checks, monkeypatch):
    registered = []
    monkeypatch.setattr(bpy.app.timers, "register", lambda function, **_: registered.append(function))
    field = checks["swirl_field"](scene)
    copy = duplicated(field)
    bpy.context.view_layer.update()
    assert registered and registered[0]() is None
    assert samples_of(copy).parent == copy and samples_of(field).parent == field
