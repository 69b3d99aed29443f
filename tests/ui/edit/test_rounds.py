"""Round after round of Re-simulate and Bake leaves no more in the file than the first one."""

from __future__ import annotations

import bpy

from seeing_wind.ui.bake.plan import MARK
from tests.ui.meshes import cube


def blocks() -> dict[str, int]:
    """How many of each kind the file has."""
    kinds = ("objects", "meshes", "shape_keys", "actions", "node_groups", "materials")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


def test_rounds_leave_no_keys_behind_and_the_file_can_be_saved(recovered, tmp_path) -> None:
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
    first = blocks()
    for factor in (3.0, 5.0):
        bpy.ops.seeing_wind.scale_mass(factor=factor)
        bpy.ops.seeing_wind.resimulate()
        bpy.ops.seeing_wind.bake()
        assert blocks() == first
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "round.blend"))
    assert all(key.user.shape_keys == key for key in bpy.data.shape_keys)


def test_a_bake_is_cleared_whole_from_a_copy_that_the_user_made(recovered) -> None:
    obj = cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
    keys = len(bpy.data.shape_keys)
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.duplicate()
    copy = bpy.context.object
    assert copy != obj and MARK in copy
    bpy.ops.seeing_wind.insert_mesh(object=copy.name)
    bpy.ops.seeing_wind.clear_bake(object=copy.name)
    assert len(bpy.data.shape_keys) == keys
    assert all(key.user.shape_keys == key for key in bpy.data.shape_keys)
