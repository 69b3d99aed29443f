"""A body that its own modifiers or shape keys move is shown where it was simulated, not moved by them once more."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from seeing_wind.engine.take import Take
from seeing_wind.ui.job import takes
from tests.ui.jobs import recover
from tests.ui.meshes import cube, shown

pytestmark = pytest.mark.usefixtures("stand_in")


def displaced(obj: bpy.types.Object) -> None:
    """Rises by 0.3 m."""
    modifier = obj.modifiers.new("Rig", "DISPLACE")
    modifier.direction, modifier.mid_level = "Z", 0.0
    for frame, strength in ((1, 0.0), (13, 0.3)):
        modifier.strength = strength
        modifier.keyframe_insert("strength", frame=frame)


def on_a_bone(obj: bpy.types.Object) -> None:
    """Turned in the first frame already; moves by 0.3 m."""
    rig = bpy.data.objects.new("Armature", bpy.data.armatures.new("Armature"))
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    rig.data.edit_bones.new("Bone").tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.modifiers.new("Rig", "ARMATURE").object = rig
    obj.vertex_groups.new(name="Bone").add(range(8), 1.0, "REPLACE")
    bone = rig.pose.bones["Bone"]
    for frame, away in ((1, 0.0), (13, 0.3)):
        bone.matrix_basis = Matrix.Translation((0.0, away, 0.0)) @ Matrix.Rotation(0.5, 4, "X")
        bone.keyframe_insert("location", frame=frame)
        bone.keyframe_insert("rotation_quaternion", frame=frame)


def keyed(obj: bpy.types.Object) -> None:
    """Moves by 0.3 m by a shape key of the user's."""
    obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="Away")
    for point in key.data:
        point.co.x += 0.3
    for frame, value in ((1, 0.0), (13, 1.0)):
        key.value = value
        key.keyframe_insert("value", frame=frame)


def simulated(scene: bpy.types.Scene) -> np.ndarray:
    """(T+1, V, 3) of the body whose object was inserted."""
    result = next(body.result for body in scene.seeing_wind.bodies if body.object)
    return Take(takes.simulated(scene.seeing_wind)).read_arrays(f"bodies/{result}.npz")["vertices"]


@pytest.mark.parametrize(("moved", "way"), [(displaced, "AUTO"), (displaced, "TRANSFORM"), (on_a_bone, "AUTO"), (keyed, "AUTO")])
def test_keys_of_location_and_rotation_do_not_add_to_it(scene, workplace, moved, way) -> None:
    recover(workplace)
    moved(cube("Box"))
    obj = scene.objects["Box"]
    own = shown(obj, 13)
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    for _ in range(2):  # and where there is a bake already
        assert bpy.ops.seeing_wind.bake(way=way, force=True) == {"FINISHED"}
        carrier = next(body.baked_copy or body.object for body in scene.seeing_wind.bodies if body.object)
        for frame in (1, 7, 13):
            np.testing.assert_allclose(shown(carrier, frame), simulated(scene)[frame - 1], atol=1e-5)
        assert carrier.data.shape_keys is None, "it stays rigid"
    assert bpy.ops.seeing_wind.clear_bake() == {"FINISHED"}
    np.testing.assert_allclose(shown(obj, 13), own, atol=1e-6)


def test_modifiers_that_stand_still_stay_awake(scene, workplace) -> None:
    """They give the object its shape, and keys of location and rotation take it along."""
    recover(workplace)
    obj = cube("Box")
    obj.modifiers.new("Solidify", "SOLIDIFY").thickness = 0.05
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    assert bpy.ops.seeing_wind.bake(way="AUTO") == {"FINISHED"}
    assert obj.modifiers["Solidify"].show_viewport and obj.data.shape_keys is None
    np.testing.assert_allclose(shown(obj, 13), simulated(scene)[12], atol=1e-5)
