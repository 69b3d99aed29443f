"""What the operators of an edit write for the engine, and what they refuse."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from seeing_wind.ui import freshness
from seeing_wind.ui.bake import bodies
from seeing_wind.ui.bake.animation import curves_of
from seeing_wind.ui.bake.motion import is_intact
from seeing_wind.ui.bake.plan import mark_of
from seeing_wind.ui.edit import panel as panel_edit
from seeing_wind.ui.edit.resimulate import edit_export
from tests.ui.edit.edits import state, written
from tests.ui.meshes import cube, group, held_cube, shown


def test_the_engine_reads_what_the_panel_says(workplace, recovered) -> None:
    held, table = cube("Held"), cube("Table", (0.0, 0.0, -0.5))
    group(held, "Top", {0: 1.0, 1: 0.25})
    bpy.ops.seeing_wind.insert_mesh(object="Held", mass=0.25, velocity=(1.0, 0.0, 0.0), start_frame=2, pin_group="Top")
    bpy.ops.seeing_wind.scale_stiffness(factor=3.0)
    bpy.ops.seeing_wind.insert_collider(object="Table", kind="STICKY")
    recovered.seeing_wind.use_floor, recovered.seeing_wind.floor_height = True, -0.75
    bpy.ops.seeing_wind.resimulate()
    edit = written(workplace)
    (body,) = edit["body"]
    assert (body["mass"], body["youngs_modulus_scale"], body["start_frame"], body["velocity"]) == (0.25, 3.0, 2, [1.0, 0.0, 0.0])
    assert np.load(workplace / "out.edit.take" / body["pin"]).tolist() == [0, 1]
    assert np.load(workplace / "out.edit.take" / body["pin_weights"]).tolist() == [1.0, 0.25]
    floor, wall = edit["collider"]
    assert floor["plane"] == [0.0, 0.0, -0.75, 0.0, 0.0, 1.0] and (wall["kind"], wall["mesh"]) == ("sticky", "colliders/Table.npz")
    with np.load(workplace / "out.edit.take" / wall["mesh"]) as mesh:
        assert mesh["vertices"][:, 2].mean() == pytest.approx(-0.5)
    table.location.z -= 0.1
    bpy.context.view_layer.update()
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"


def test_pins_go_with_the_bone_that_holds_them(workplace, recovered) -> None:
    held = cube("Held")
    group(held, "Top", {0: 1.0, 1: 1.0})
    bpy.ops.object.armature_add()
    rig = bpy.context.object
    held.modifiers.new("Armature", "ARMATURE").object = rig
    group(held, "Bone", dict.fromkeys(range(8), 1.0))
    bone = rig.pose.bones[0]
    for frame, height in ((1, 0.0), (13, 0.5)):
        bone.location = (0.0, height, 0.0)  # along the bone, which is upright
        bone.keyframe_insert("location", frame=frame)
    bpy.ops.seeing_wind.insert_mesh(object="Held", pin_group="Top")
    bpy.ops.seeing_wind.resimulate()
    (body,) = written(workplace)["body"]
    way, pins = (np.load(workplace / "out.edit.take" / body[name]) for name in ("pin_path", "pin"))
    frames = [shown(held, frame)[pins] for frame in range(1, 14)]
    assert np.ptp(way[:, 0, 2]) == pytest.approx(0.5, abs=1e-5)
    np.testing.assert_allclose(way, frames, atol=1e-6)
    assert state("resimulate") == "done"
    bone.keyframe_insert("location", frame=7)
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"
    rig.animation_data_clear()
    bpy.ops.seeing_wind.resimulate()
    assert "pin_path" not in written(workplace)["body"][0]


def test_a_body_that_was_deleted_while_it_was_simulated_is_told(workplace, recovered, monkeypatch, capfd) -> None:
    """A window's job leaves the user free to do so."""
    cube("Stays")
    bpy.ops.seeing_wind.insert_mesh(object="Stays")
    bpy.ops.seeing_wind.insert_mesh(object=cube("Goes").name)
    real = edit_export.write_edit

    def and_delete(*args, **more):
        bpy.data.scenes[0].collection.objects.unlink(bpy.data.objects["Goes"])
        return real(*args, **more)

    monkeypatch.setattr(edit_export, "write_edit", and_delete)
    bpy.ops.seeing_wind.resimulate()
    said = capfd.readouterr().out
    assert "Goes was deleted while it was simulated" in said and "Stays was deleted" not in said


def test_field_strength_is_read_from_its_keyframes(workplace, recovered) -> None:
    cube("Free")
    bpy.ops.seeing_wind.insert_mesh()
    settings = recovered.seeing_wind
    settings.field_strength = 0.5
    bpy.ops.seeing_wind.resimulate()
    assert written(workplace)["field_strength"] == 0.5
    for frame, value in ((1, 0.0), (7, 3.0)):
        settings.field_strength = value
        recovered.keyframe_insert("seeing_wind.field_strength", frame=frame)
    for curve in curves_of(recovered):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"
    bpy.ops.seeing_wind.resimulate()
    np.testing.assert_allclose(written(workplace)["field_strength"], [0.0, 0.5, 1.0, 1.5, 2.0, 2.5] + [3.0] * 6, atol=1e-6)
    for frame in (1, 4, 9):
        recovered.frame_set(frame)
        freshness.refresh(recovered)
        assert state("resimulate") == "done", "scrubbing through keyframes changes nothing"


def test_a_strength_that_is_no_number_is_refused_in_a_sentence(workplace, recovered) -> None:
    cube("Free")
    bpy.ops.seeing_wind.insert_mesh()
    settings = recovered.seeing_wind
    settings.field_strength = float("nan")
    with pytest.raises(RuntimeError, match="strength is no number in all of 12 frames. Correct Field Strength here and") as raised:
        bpy.ops.seeing_wind.resimulate()
    assert "nan" not in str(raised.value)
    for frame, value in ((1, 1.0), (5, float("nan"))):
        settings.field_strength = value
        recovered.keyframe_insert("seeing_wind.field_strength", frame=frame)
    for point in curves_of(recovered)[0].keyframe_points:
        point.interpolation = "CONSTANT"
    with pytest.raises(RuntimeError, match="strength is no number in 8 of 12 frames."):
        bpy.ops.seeing_wind.resimulate()


def test_parts_of_the_recovered_object_are_let_go(workplace, recovered) -> None:
    obj = recovered.seeing_wind.recovered_object
    group(obj, "Rim", {0: 1.0, 5: 1.0})
    bpy.ops.seeing_wind.free_recovered(vertex_group="Rim")
    bpy.ops.seeing_wind.resimulate()
    (body,) = written(workplace)["body"]
    assert body["mesh"] == "recovered" and np.load(workplace / "out.edit.take" / body["free"]).tolist() == [0, 5]
    bpy.ops.seeing_wind.free_recovered()
    assert state("resimulate") == "stale"
    bpy.ops.seeing_wind.resimulate()
    assert len(np.load(workplace / "out.edit.take" / written(workplace)["body"][0]["free"])) == 16


def test_modifiers_that_make_vertices_move_a_copy_and_subdivision_stays(workplace, recovered) -> None:
    plain, bevelled = cube("Plain"), cube("Bevelled")
    for obj in (plain, bevelled):
        group(obj, "Top", {0: 1.0})
    bevelled.modifiers.new("Bevel", "BEVEL").width = 0.01
    for obj in (plain, bevelled):
        obj.modifiers.new("Subdivision", "SUBSURF")
        bpy.ops.seeing_wind.insert_mesh(object=obj.name, pin_group="Top")
    bpy.ops.seeing_wind.resimulate()
    assert np.load(workplace / "out.edit.take" / "meshes" / "Plain.npz")["vertices"].shape == (8, 3)
    bpy.ops.seeing_wind.bake()
    copy = recovered.seeing_wind.bodies[1].baked_copy
    assert recovered.seeing_wind.bodies[0].baked_copy is None and len(shown(plain, 5)) == 26
    assert copy is not None and bevelled.hide_viewport and bevelled.hide_render and bodies.HIDDEN in bevelled
    assert [modifier.type for modifier in copy.modifiers] == ["SUBSURF"] and np.ptp(shown(copy, 13) - shown(copy, 1)) > 0.1
    rest = np.load(workplace / "out.edit.take" / "meshes" / "Bevelled.npz")["vertices"]
    bpy.ops.seeing_wind.resimulate()
    np.testing.assert_array_equal(np.load(workplace / "out.edit.take" / "meshes" / "Bevelled.npz")["vertices"], rest)
    bpy.ops.seeing_wind.clear_bake()
    assert recovered.seeing_wind.bodies[1].baked_copy is None and not bevelled.hide_viewport and not bevelled.hide_render
    assert copy not in bpy.data.objects.values()


def test_vertex_groups_of_the_recovered_object_outlive_a_reload(workplace, recovered) -> None:
    obj = recovered.seeing_wind.recovered_object
    group(obj, "Stalk", {0: 1.0, 3: 0.25})
    bpy.ops.seeing_wind.insert_mesh(recovered=True)
    bpy.ops.seeing_wind.pin_vertices(vertex_group="Stalk")
    bpy.ops.seeing_wind.build_scene()
    obj = recovered.seeing_wind.recovered_object
    weights = {vertex.index: element.weight for vertex in obj.data.vertices for element in vertex.groups}
    assert weights == pytest.approx({0: 1.0, 3: 0.25}) and bpy.ops.seeing_wind.resimulate() == {"FINISHED"}


def test_a_linked_object_with_the_name_of_another_is_not_gone(workplace, recovered, tmp_path) -> None:
    cube("Same")
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {bpy.data.objects["Same"]})
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, into):
        into.objects = ["Same"]
    linked = into.objects[0]
    recovered.collection.objects.link(linked)
    both = [obj for obj in recovered.objects if obj.name == "Same"]
    assert len(both) == 2 and not any(panel_edit.is_gone(obj, recovered) for obj in both)
    recovered.collection.objects.unlink(linked)
    assert panel_edit.is_gone(linked, recovered)


def test_an_object_in_edit_mode_is_simulated_as_it_is_and_baked_later(workplace, recovered) -> None:
    obj = cube("Box")
    bpy.ops.seeing_wind.insert_mesh()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.resize(value=(2.0, 2.0, 2.0))
    bpy.ops.seeing_wind.resimulate()
    assert np.ptp(np.load(workplace / "out.edit.take" / "meshes" / "Box.npz")["vertices"], axis=0) == pytest.approx(0.4)
    with pytest.raises(RuntimeError, match="Edit Mode"):
        bpy.ops.seeing_wind.bake()
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.seeing_wind.bake()
    assert is_intact(obj)


def test_no_body_is_baked_where_one_of_them_cannot_be(workplace, recovered) -> None:
    first, second = held_cube("First"), cube("Second", (1.0, 0.0, 0.0))
    bpy.ops.seeing_wind.insert_mesh(object="First", pin_group="Top")
    bpy.ops.seeing_wind.insert_mesh(object="Second")
    bpy.ops.seeing_wind.resimulate()
    bpy.context.view_layer.objects.active = second
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Second is in Edit Mode"):
        bpy.ops.seeing_wind.bake()
    assert mark_of(first) is None and first.data.shape_keys is None, "an operator that was refused has no undo step"
    bpy.ops.object.mode_set(mode="OBJECT")
    with pytest.raises(RuntimeError, match="First does not stay rigid"):
        bpy.ops.seeing_wind.bake(way="TRANSFORM")
    second.modifiers.new("More Vertices", "SUBSURF")
    bpy.ops.object.modifier_add(type="TRIANGULATE")
    bpy.ops.seeing_wind.resimulate()
    with pytest.raises(RuntimeError, match="hold 0 of the simulated frames"):
        bpy.ops.seeing_wind.bake(object="Second", way="SHAPE_KEYS", frames=(500, 600))
    kept = bpy.context.scene.seeing_wind
    assert not kept.bake_use_frames and kept.bake_way == "AUTO", "the options of a call that was refused are given back"
    assert not second.hide_render and "Second Simulated" not in bpy.data.objects, "no copy stands in for it without a motion"


def test_nothing_is_baked_in_another_unit_than_the_winds(workplace, recovered) -> None:
    box = cube("Box")
    bpy.ops.seeing_wind.insert_mesh()
    bpy.ops.seeing_wind.resimulate()
    bpy.context.scene.unit_settings.scale_length = 0.01
    with pytest.raises(RuntimeError, match="was made for a unit scale of 1, and the scene's is 0.01"):
        bpy.ops.seeing_wind.bake()
    assert mark_of(box) is None and box.data.shape_keys is None
    bpy.context.scene.unit_settings.scale_length = 1.0
    bpy.ops.seeing_wind.bake()
    assert mark_of(box) is not None


def test_what_makes_no_sense_is_refused(workplace, recovered) -> None:
    cube("Box")
    with pytest.raises(RuntimeError, match="no edit to duplicate"):
        bpy.ops.seeing_wind.duplicate_edit()
    bpy.ops.seeing_wind.insert_mesh()
    with pytest.raises(RuntimeError, match="neither bodies nor colliders"):
        bpy.ops.seeing_wind.insert_collider()
    with pytest.raises(RuntimeError, match="no collider"):
        bpy.ops.seeing_wind.remove_collider()
    with pytest.raises(RuntimeError, match="no vertex group 'Nowhere'"):
        bpy.ops.seeing_wind.free_recovered(vertex_group="Nowhere")
    with pytest.raises(RuntimeError, match="Nothing is simulated"):
        bpy.ops.seeing_wind.bake()
