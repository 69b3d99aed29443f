"""How several edits of one field live in one scene: duplicated, compared and removed."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from seeing_wind.ui.bake.motion import is_intact
from seeing_wind.ui.bake.plan import mark_of
from tests.ui.edit.edits import state, written
from tests.ui.meshes import cube, group, shown


def test_a_duplicated_edit_stands_beside_the_first_and_each_keeps_its_own(workplace, recovered) -> None:
    settings, first = recovered.seeing_wind, cube("Flag")
    group(first, "Top", {0: 1.0, 1: 1.0})
    bpy.ops.seeing_wind.insert_mesh(pin_group="Top")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    bpy.ops.seeing_wind.duplicate_edit()
    assert [edit.name for edit in settings.edits] == ["Edit 1", "Edit 2"] and settings.active_edit == 1
    second = settings.bodies[0].object
    assert second != first and second.data != first.data and mark_of(second) is None and state("resimulate") == "idle"
    bpy.ops.seeing_wind.scale_mass(factor=4.0)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    here, there = shown(first, 13) - shown(first, 1), shown(second, 13) - shown(second, 1)
    np.testing.assert_allclose(there, here / 4.0, atol=1e-5)
    np.testing.assert_allclose(shown(second, 1), shown(first, 1) + np.array(settings.offset), atol=1e-5)
    with np.load(workplace / "out.edit_2.take" / written(workplace, "out.edit_2.take")["body"][0]["mesh"]) as mesh:
        np.testing.assert_allclose(mesh["vertices"], shown(first, 1), atol=1e-5, err_msg="simulated in the same place of the field")
    settings.active_edit = 0
    assert settings.bodies[0].mass_scale == 1.0 and settings.bodies[0].object == first and tuple(settings.offset) == (0.0, 0.0, 0.0)
    assert state("resimulate") == "done" and state("bake") == "done", "nothing of the first was lost"
    settings.active_edit = 1
    assert settings.bodies[0].mass_scale == 4.0 and state("bake") == "done"
    bpy.ops.seeing_wind.remove_edit()
    assert len(settings.edits) == 1 and settings.bodies[0].object == first and is_intact(first)
    with pytest.raises(RuntimeError, match="only one edit"):
        bpy.ops.seeing_wind.remove_edit()


def everything() -> list[int]:
    """How many objects, meshes, actions and collections the file has."""
    data = bpy.data
    return [len(each) for each in (data.objects, data.meshes, data.actions, data.collections, data.shape_keys)]


def test_a_removed_edit_leaves_none_of_its_copies(workplace, recovered) -> None:
    settings = recovered.seeing_wind
    cube("Plain")
    cube("Bevelled", (1.0, 0.0, 0.0)).modifiers.new("Bevel", "BEVEL")
    for name in ("Plain", "Bevelled"):
        bpy.ops.seeing_wind.insert_mesh(object=name)
    bpy.ops.seeing_wind.insert_mesh(recovered=True)
    before = everything()
    for baked in (False, True):
        bpy.ops.seeing_wind.duplicate_edit()
        if baked:
            bpy.ops.seeing_wind.resimulate()
            bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
            assert sum(body.baked_copy is not None for body in settings.bodies) == 2
        assert everything() != before and bpy.ops.seeing_wind.remove_edit() == {"FINISHED"}
        assert everything() == before and [body.called for body in settings.bodies] == ["Plain", "Bevelled", "Recovered Object"]
        settings.edits.clear()


def test_a_removed_edit_leaves_what_is_the_user_s_or_used_by_him(workplace, recovered) -> None:
    """His own objects with their motion, which Clear Bake takes off; copies that he named, put elsewhere, or points at."""
    settings = recovered.seeing_wind
    for name in ("Own", "Named", "Moved", "Target"):
        cube(name)
        bpy.ops.seeing_wind.insert_mesh(object=name)
    bpy.ops.seeing_wind.duplicate_edit()
    copies = [body.object for body in settings.bodies]
    copies[1].name = "Mine"
    recovered.collection.objects.link(copies[2])
    bpy.data.objects["Own"].constraints.new("TRACK_TO").target = copies[3]
    kept = [obj.name for obj in copies[1:]]
    settings.active_edit = 0
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    settings.active_edit = 1
    bpy.ops.seeing_wind.remove_edit()
    assert copies[0] not in bpy.data.objects.values() and all(name in recovered.objects for name in kept)
    bpy.ops.seeing_wind.duplicate_edit()
    settings.active_edit = 0
    own = settings.bodies[0].object
    bpy.ops.seeing_wind.remove_edit()
    assert own.name in recovered.objects and mark_of(own) is not None, "the first edit is the user's objects"
    assert bpy.ops.seeing_wind.clear_bake() == {"FINISHED"} and mark_of(own) is None
