"""What makes a simulation or a bake stale, and what does not."""

from __future__ import annotations

import bpy
import numpy as np

from seeing_wind.ui import freshness
from seeing_wind.ui.bake.animation import curves_of
from seeing_wind.ui.bake.motion import is_intact
from seeing_wind.ui.bake.plan import mark_of
from seeing_wind.ui.edit.resimulate.geometry import forget_geometry
from tests.ui.edit.edits import state
from tests.ui.meshes import cube, group, shown


def test_only_what_has_changed_is_baked_again(workplace, recovered) -> None:
    one, two = cube("One"), cube("Two")
    for obj in (one, two):
        group(obj, "Top", {0: 1.0})
        bpy.ops.seeing_wind.insert_mesh(object=obj.name, pin_group="Top")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    keys = one.data.shape_keys
    curves_of(keys)[0].keyframe_points[-1].co.x = 30.0
    bpy.ops.seeing_wind.scale_mass(object="Two", factor=2.0)
    assert state("resimulate") == "stale" and state("bake") == "stale" and is_intact(two), "stale, and still there"
    bpy.ops.seeing_wind.resimulate()
    before = shown(two, 13)
    bpy.ops.seeing_wind.bake()
    assert one.data.shape_keys == keys and curves_of(keys)[0].keyframe_points[-1].co.x == 30.0
    assert not np.allclose(shown(two, 13), before)
    bpy.ops.seeing_wind.bake(force=True)
    assert curves_of(one.data.shape_keys)[0].keyframe_points[-1].co.x == 13.0
    bpy.ops.seeing_wind.bake(object="Two", way="POINT_CACHE", frames=(3, 9))
    assert mark_of(two)["way"] == "POINT_CACHE" and mark_of(one)["way"] == "SHAPE_KEYS"
    assert state("bake") == "stale", "one of two is baked as the settings say"
    bpy.ops.seeing_wind.clear_bake()
    assert mark_of(one) is None and mark_of(two) is None and state("bake") == "idle" and state("resimulate") == "done"


def test_geometry_and_weights_make_results_stale_and_playing_does_not(workplace, recovered) -> None:
    obj = cube("Box")
    group(obj, "Top", {0: 1.0})
    bpy.ops.seeing_wind.insert_mesh(pin_group="Top")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
    for frame in (1, 6, 13):
        recovered.frame_set(frame)
        freshness.refresh(recovered)
        assert state("bake") == "done"
    obj.vertex_groups["Top"].add([0], 0.5, "REPLACE")
    obj.data.update()
    forget_geometry()
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"


def test_a_rigid_body_stays_fresh_while_it_plays(workplace, recovered) -> None:
    obj = cube("Box")
    bpy.ops.seeing_wind.insert_mesh()
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    assert mark_of(obj)["way"] == "TRANSFORM"
    rest = np.load(workplace / "out.edit.take" / "meshes" / "Box.npz")["vertices"]
    for frame in (1, 6, 13):
        recovered.frame_set(frame)
        bpy.context.view_layer.update()
        freshness.refresh(recovered)
        assert state("resimulate") == "done" and state("bake") == "done"
    bpy.ops.seeing_wind.resimulate()
    np.testing.assert_allclose(np.load(workplace / "out.edit.take" / "meshes" / "Box.npz")["vertices"], rest, atol=1e-6)


def test_an_object_on_a_moving_parent_stays_fresh_while_it_plays(workplace, recovered) -> None:
    obj, carrier = cube("Box"), bpy.data.objects.new("Carrier", None)
    recovered.collection.objects.link(carrier)
    obj.parent = carrier
    for frame, x in ((1, 0.0), (13, 1.0)):
        carrier.location.x = x
        carrier.keyframe_insert("location", frame=frame)
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    for frame in (1, 6, 13):
        recovered.frame_set(frame)
        freshness.refresh(recovered)
        assert state("resimulate") == "done"
    carrier.keyframe_insert("location", frame=20)
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"


def test_what_stands_aside_is_as_fresh_in_a_file_that_was_just_opened(workplace, recovered, tmp_path) -> None:
    """Blender has not evaluated then where anything stands: no place may be taken for one that has changed."""
    held, falls = cube("Held", (0.4, -0.2, 0.3)), cube("Falls", (-0.4, 0.1, 0.3))
    group(held, "Top", {0: 1.0})
    for obj, pins in ((held, "Top"), (falls, "")):
        obj.rotation_euler.z = 0.3
        bpy.ops.seeing_wind.insert_mesh(object=obj.name, pin_group=pins)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    recovered.frame_set(7)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "aside.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "aside.blend"))
    assert (state("resimulate"), state("bake")) == ("done", "done")
