"""Round after round of Re-simulate and Bake leaves no more in the file than the first one."""

from __future__ import annotations

import bpy
import pytest

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


@pytest.fixture
def linked(recovered, tmp_path) -> bpy.types.Object:
    """A box of another file."""
    box = cube("Box")
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {box})
    bpy.data.objects.remove(box)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, into):
        into.objects = ["Box"]
    recovered.collection.objects.link(into.objects[0])
    return into.objects[0]


@pytest.mark.parametrize("name", ["", "Box", "Box Simulated"])
def test_what_stood_in_for_a_body_that_was_taken_off_the_list_can_be_cleared(recovered, linked, name) -> None:
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    first = blocks()
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
    bpy.ops.seeing_wind.remove_body()
    assert "Box Simulated" in recovered.objects, "the motion stays"
    assert bpy.ops.seeing_wind.clear_bake(object=name) == {"FINISHED"}
    assert blocks() == first and "Box Simulated" not in recovered.objects and linked.visible_get()


def test_a_hidden_original_is_shown_again_and_an_own_motion_is_cleared(recovered) -> None:
    """Of bodies that were taken off the list: one with a copy in its place, one that moved itself."""
    thick, plain, kept = cube("Thick"), cube("Plain"), cube("Kept")
    thick.modifiers.new("Thick", "SOLIDIFY")
    for name in ("Thick", "Plain", "Kept"):
        bpy.ops.seeing_wind.insert_mesh(object=name)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
    assert thick.hide_render and MARK in plain
    recovered.seeing_wind.active_body = 0
    for _ in range(2):
        bpy.ops.seeing_wind.remove_body()
    bpy.ops.seeing_wind.clear_bake()
    assert MARK not in kept and MARK in plain and thick.hide_render, "those of the list come first"
    bpy.ops.seeing_wind.clear_bake()
    assert MARK not in plain and not thick.hide_render and "Thick Simulated" not in recovered.objects


def test_a_body_that_is_inserted_again_has_its_copy_again(recovered, linked) -> None:
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
    first = blocks()
    bpy.ops.seeing_wind.remove_body()
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.scale_mass(factor=3.0)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    assert blocks() == first and "Box Simulated.001" not in recovered.objects


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
