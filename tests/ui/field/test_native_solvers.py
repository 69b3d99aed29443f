"""What Blender's own solvers feel, calibrated by one function; the measurements are those of tests/blender/native_solvers_check.py."""

from __future__ import annotations

import re

import bpy
import numpy as np
import pytest
from mathutils import Euler, Vector

from seeing_wind.engine.errors import UsageError
from seeing_wind.ui.field.samples import sample_wind_group, samples_of
from seeing_wind.ui.field.solvers.calibration import calibrate_object
from seeing_wind.ui.field.solvers.matter import matter


@pytest.mark.parametrize(
    ("name", "interval", "moved"),
    [("rigid bodies", 2, True), ("cloth of 2x2 faces", 0, False), ("hair", 5, False), ("Sample Wind", 2, True), ("Sample Wind", 5, False)],
)
def test_solvers_accelerate_by_force_over_density(scene, solvers, name, interval, moved):
    field = solvers["checks"]["swirl_field"](scene)
    if moved:
        field.location += Vector((0.4, 1.0, -0.3))
        field.rotation_euler = Euler((0.5, -0.7, 1.1))
    kind, measure = solvers["KINDS"][name]
    angle, size = solvers["worst"](field, measure(field, interval), interval)
    assert angle < solvers["BARS"][kind][0] and size < solvers["BARS"][kind][1]


@pytest.mark.parametrize("fps", [24, 60])
def test_cloth_falls_as_fast_as_the_clip(scene, solvers, fps):
    """Blender counts a cloth's gravity per frame; the clip's frame rate decides how long one is."""
    field = solvers["checks"]["swirl_field"](scene)
    field.field.strength = 0.0
    scene.render.fps = fps
    obj = solvers["patches"](np.zeros((200, 3)), 1, 0.05)
    cloth = obj.modifiers.new("Cloth", "CLOTH")
    calibrate_object(scene, obj, field)
    found = solvers["first_move"](obj, cloth.point_cache, 1, solvers["middles"], cloth.settings.quality)
    assert np.allclose(found, [0.0, 0.0, -9.81], atol=0.02)


def test_calibrating_twice_changes_nothing_more(scene, solvers):
    field = solvers["checks"]["swirl_field"](scene)
    obj = solvers["patches"](np.zeros((1, 3)), 2, 0.05)
    cloth = obj.modifiers.new("Cloth", "CLOTH")
    first = calibrate_object(scene, obj, field)
    weights = (cloth.settings.effector_weights.texture, cloth.settings.effector_weights.gravity)
    assert calibrate_object(scene, obj, field) == first
    assert weights == (cloth.settings.effector_weights.texture, cloth.settings.effector_weights.gravity)


def test_subdivided_cloth_gets_the_same_acceleration(scene, solvers):
    """The mesh that the solver gets counts, not the one that is edited."""
    field = solvers["checks"]["swirl_field"](scene)
    weights = []
    for levels in (0, 1):
        obj = solvers["patches"](np.zeros((1, 3)), 2, 0.05)
        subdivision = obj.modifiers.new("Subdivision", "SUBSURF")
        subdivision.subdivision_type, subdivision.levels = "SIMPLE", levels
        cloth = obj.modifiers.new("Cloth", "CLOTH")
        calibrate_object(scene, obj, field)
        weights.append(cloth.settings.effector_weights.texture)
    # 9 and 25 vertices of the same mass on the same area
    assert weights[1] / weights[0] == pytest.approx(25 / 9, rel=1e-4)


def test_one_weight_for_all_rigid_bodies_is_said_and_can_be_met_by_mass(scene, solvers):
    field = solvers["checks"]["swirl_field"](scene)
    bpy.ops.rigidbody.world_add()
    cubes = []
    for mass in (1.0, 3.0):
        bpy.ops.mesh.primitive_cube_add(size=0.1)
        bpy.ops.rigidbody.object_add()
        bpy.context.object.rigid_body.mass = mass
        cubes.append(bpy.context.object)
    calibrate_object(scene, cubes[0], field)
    weight = scene.rigidbody_world.effector_weights.texture
    said = calibrate_object(scene, cubes[1], field, density=240.0, set_mass=True)
    assert cubes[0].name in said[0] and "one weight" in said[0]
    assert scene.rigidbody_world.effector_weights.texture == pytest.approx(weight)
    assert cubes[1].rigid_body.mass == pytest.approx(240.0 * 1.0 / 120.0)


def test_what_cannot_be_set_is_said(scene, solvers):
    field = solvers["checks"]["swirl_field"](scene)
    obj = solvers["patches"](np.zeros((1, 3)), 2, 0.05)
    with pytest.raises(UsageError, match="no physics"):
        calibrate_object(scene, obj, field)
    obj.modifiers.new("Soft", "SOFT_BODY")
    assert "not set" in calibrate_object(scene, obj, field)[0]
    cloth = obj.modifiers.new("Cloth", "CLOTH").settings
    cloth.mass = 5000.0
    with pytest.raises(UsageError, match="200"):
        calibrate_object(scene, obj, field)
    cloth.mass = 0.05
    assert any("Quality Steps" in line for line in calibrate_object(scene, obj, field))
    with pytest.raises(UsageError, match="no recovered force field"):
        calibrate_object(scene, obj, obj)
    with pytest.raises(UsageError, match="above zero"):
        matter(scene, field, density=-1.0)


def test_strength_slider_reaches_geometry_nodes_and_the_group_is_an_asset(scene, solvers):
    field = solvers["checks"]["swirl_field"](scene)
    field.field.strength *= 2.0
    # twice the strength is as much as half the density: the truth is for DENSITY
    angle, size = solvers["worst"](field, solvers["felt_by_sample_wind"](field, 2), 2)
    assert size == pytest.approx(1.0, abs=0.05) and angle < 1.0
    group = sample_wind_group()
    assert group.asset_data is not None and group is sample_wind_group()
    assert samples_of(field).hide_viewport and samples_of(field).parent == field


@pytest.mark.parametrize(("reach", "near", "far"), [
    ("FADE", (0.4, 0.9), (0.0, 0.0)), ("HOLD", (1.0, 1.0), (1.0, 1.0)), ("CONTINUE", (0.8, 1.0), (0.2, 0.7)),
])  # fmt: skip
def test_sample_wind_ends_beside_the_box_as_it_is_told(scene, solvers, reach, near, far):
    """Against the wind at the nearest place of the box, a quarter and three lengths away from it."""
    checks = solvers["checks"]
    field = checks["swirl_field"](scene, reach)
    middle = checks["CENTRE"]
    ends = middle + np.array([[0.5, 0.0, 0.0], [0.75, 0.0, 0.0], [3.5, 0.0, 0.0]])
    found = np.linalg.norm(solvers["sample_wind"](field, ends, 2)[1], axis=1)
    share = found[1:] / found[0]
    assert near[0] - 1e-4 <= share[0] <= near[1] + 1e-4 and far[0] - 1e-4 <= share[1] <= far[1] + 1e-4


@pytest.mark.parametrize("name", ["rigid bodies", "cloth of 2x2 faces", "hair"])
def test_the_frame_rate_of_the_scene_is_no_matter(scene, solvers, name):
    """A clip frame is a frame, whatever its length."""
    scene.render.fps, scene.render.fps_base = 60, 1.001
    field = solvers["checks"]["swirl_field"](scene)
    kind, measure = solvers["KINDS"][name]
    angle, size = solvers["worst"](field, measure(field, 2), 2)
    assert angle < solvers["BARS"][kind][0] and size < solvers["BARS"][kind][1]


def test_rigid_bodies_wait_for_what_drives_the_textures(scene, solvers, tmp_path):
    """Blender evaluates in several threads: whatever no relation orders may come too late, and show the frame before."""
    solvers["checks"]["swirl_field"](scene)
    bpy.ops.rigidbody.world_add()
    graph = tmp_path / "graph.dot"
    bpy.context.evaluated_depsgraph_get().debug_relations_graphviz(filepath=str(graph))
    text, before = graph.read_text(), {}
    for first, then in re.findall(r'"(\d+)" ?-> ?"(\d+)"', text):
        before.setdefault(then, []).append(first)
    drivers = re.findall(r'"(\d+)" \[[^\n]*label="DRIVER\(color_ramp', text)
    waiting = re.findall(r'"(\d+)" \[[^\n]*label="RIGIDBODY_REBUILD\(', text)
    waited_for = set()
    while waiting:
        for each in set(before.get(waiting.pop(), ())) - waited_for:
            waited_for.add(each)
            waiting.append(each)
    bpy.ops.rigidbody.world_remove()
    assert len(drivers) == 13 and set(drivers) <= waited_for
