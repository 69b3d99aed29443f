"""A field object that was duplicated works by itself."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from seeing_wind.ui.field.display import share
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
