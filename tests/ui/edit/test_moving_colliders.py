"""Colliders that move on their way to the engine."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from seeing_wind.ui import freshness
from tests.ui.edit.edits import state, written
from tests.ui.meshes import cube, group, shown

SCENE_FRAMES = range(1, 14)


@pytest.fixture
def table(recovered):
    """A body, and a cube below it as a collider."""
    cube("Held")
    bpy.ops.seeing_wind.insert_mesh(object="Held")
    obj = cube("Table", (0.0, 0.0, -0.5))
    bpy.ops.seeing_wind.insert_collider(object="Table")
    return obj


def way(workplace) -> np.ndarray:
    """(T+1, V, 3) that the engine reads of the only collider."""
    (wall,) = written(workplace)["collider"]
    found = np.load(workplace / "out.edit.take" / wall["mesh_path"])
    np.testing.assert_allclose(found[0], np.load(workplace / "out.edit.take" / wall["mesh"])["vertices"], atol=1e-6)
    return found


def rise(obj, frames=((1, 0.0), (13, 0.5))) -> None:
    for frame, height in frames:
        obj.location.z = height
        obj.keyframe_insert("location", frame=frame)


def test_keyframes_of_a_collider_move_it(workplace, recovered, table) -> None:
    table.rotation_euler.x = 0.4
    rise(table)
    recovered.seeing_wind.edit_preroll = 12
    bpy.ops.seeing_wind.resimulate()
    np.testing.assert_allclose(way(workplace), [shown(table, frame) for frame in SCENE_FRAMES], atol=1e-6)
    assert np.ptp(way(workplace)[:, 0, 2]) == pytest.approx(0.5, abs=1e-6) and written(workplace)["preroll"] == 12
    for frame in (1, 6, 13):
        recovered.frame_set(frame)
        freshness.refresh(recovered)
        assert state("resimulate") == "done"
    table.keyframe_insert("location", frame=7)
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"


def test_a_parent_or_a_bone_moves_a_collider(workplace, recovered, table) -> None:
    carrier = bpy.data.objects.new("Carrier", None)
    recovered.collection.objects.link(carrier)
    table.parent = carrier
    rise(carrier)
    bpy.ops.object.armature_add()
    rig = bpy.context.object
    table.modifiers.new("Armature", "ARMATURE").object = rig
    group(table, "Bone", {0: 1.0, 1: 1.0, 2: 1.0, 3: 1.0})
    for frame, height in ((1, 0.0), (13, 0.3)):
        rig.pose.bones[0].location = (0.0, height, 0.0)
        rig.pose.bones[0].keyframe_insert("location", frame=frame)
    bpy.ops.seeing_wind.resimulate()
    found = way(workplace)
    np.testing.assert_allclose(found, [shown(table, frame) for frame in SCENE_FRAMES], atol=1e-6)
    assert np.ptp(found[:, 0, 2]) == pytest.approx(0.8, abs=1e-5) and np.ptp(found[:, 7, 2]) == pytest.approx(0.5, abs=1e-5)
    rig.pose.bones[0].keyframe_insert("location", frame=7)
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"


def test_a_collider_whose_vertices_come_and_go_is_carried_along_as_it_was(workplace, recovered, table, capfd) -> None:
    rise(table)
    bevel = table.modifiers.new("Bevel", "BEVEL")
    bevel.width = 0.01
    for frame, segments in ((1, 1), (13, 3)):
        bevel.segments = segments
        bevel.keyframe_insert("segments", frame=frame)
    bpy.ops.seeing_wind.resimulate()
    assert "Table has another number of vertices in other frames" in capfd.readouterr().out
    found = way(workplace)
    np.testing.assert_allclose(found - found[:1], np.broadcast_to((found - found[:1])[:, :1], found.shape), atol=1e-6)
    assert np.ptp(found[:, 0, 2]) == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("how", ["TRANSFORM", "SHAPE_KEYS", "POINT_CACHE", "copy"])
def test_what_another_edit_has_moved_is_in_the_way_as_it_is_seen(workplace, recovered, how) -> None:
    """A cube falls in one edit, baked in any way or on a copy; in another edit a body runs into it."""
    falls = cube("Falls", (0.0, 0.0, 1.0))
    if how == "copy":
        falls.modifiers.new("Bevel", "BEVEL")
    bpy.ops.seeing_wind.insert_mesh(object="Falls")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS" if how == "copy" else how)
    carrier = recovered.seeing_wind.bodies[0].baked_copy or falls
    assert (how == "copy") == falls.hide_viewport == (carrier is not falls)
    bpy.ops.seeing_wind.duplicate_edit()
    while len(recovered.seeing_wind.bodies):
        bpy.ops.seeing_wind.remove_body()
    cube("Other", (0.0, 0.0, -3.0))
    bpy.ops.seeing_wind.insert_mesh(object="Other")
    bpy.ops.seeing_wind.insert_collider(object="Falls")
    bpy.ops.seeing_wind.resimulate()
    (wall,) = written(workplace, "out.edit_2.take")["collider"]
    found = np.load(workplace / "out.edit_2.take" / wall["mesh_path"])
    np.testing.assert_allclose(found, [shown(carrier, frame) for frame in SCENE_FRAMES], atol=2e-5)
    assert np.ptp(found[:, 0, 2]) == pytest.approx(0.5 * 3.0 * 0.25, abs=1e-4), "as far as the stand-in lets it fall"
    for frame in (1, 7):
        recovered.frame_set(frame)
        freshness.refresh(recovered)
        assert state("resimulate") == "done"
    # baked anew by the first edit, it moves otherwise
    settings = recovered.seeing_wind
    settings.active_edit = 0
    bpy.ops.seeing_wind.scale_mass(factor=2.0)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS" if how == "copy" else how)
    settings.active_edit = 1
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"


def test_a_collider_with_keyframes_goes_with_the_clock(workplace, recovered, table) -> None:
    rise(table)
    bpy.ops.seeing_wind.resimulate()
    recovered.render.fps, recovered.render.fps_base = 48, 1.0
    bpy.ops.seeing_wind.conform()
    freshness.refresh(recovered)
    assert state("resimulate") == "stale", "the clip lasts twice as many frames, its keyframes do not"
    bpy.ops.seeing_wind.resimulate()
    np.testing.assert_allclose(way(workplace), [shown(table, 1 + 2 * frame) for frame in range(13)], atol=1e-6)


def test_what_stays_has_no_way(workplace, recovered, table) -> None:
    table.keyframe_insert("location", frame=1)
    bpy.ops.seeing_wind.resimulate()
    assert "mesh_path" not in written(workplace)["collider"][0]
