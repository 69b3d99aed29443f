"""A recovered force and a wind in one scene: what moves feels one of them, with the weight that suits it."""

from __future__ import annotations

import runpy
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.ui.field.display import FELT, SLOWS, arrows_of
from seeing_wind.ui.field.library.arrows import show_arrows
from tests.ui.jobs import recover

CHECK = runpy.run_path(str(Path(__file__).resolve().parents[2] / "blender" / "wind_check.py"), run_name="checks")
FORCE, BREEZE = "A Force", "The Breeze"

pytestmark = pytest.mark.usefixtures("stand_in")


def both(scene: bpy.types.Scene) -> None:
    """A force of 300 N/m³ along X, felt as such, and a wind of 1.5 m/s upwards."""
    for name, kind in ((FORCE, "FORCE"), (BREEZE, "WIND")):
        CHECK["steady"](scene, kind).name = name


def moved(obj: bpy.types.Object, scene: bpy.types.Scene) -> np.ndarray:
    """How far its particles, or its mesh, go in ten frames (3,) [m]."""
    if not len(obj.particle_systems):
        found = CHECK["places"](obj, scene, 11)
        return found[-1] - found[0]
    obj.particle_systems[0].seed += 1
    seen = []
    for frame in range(1, 12):
        scene.frame_set(frame)
        system = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
        seen.append(np.mean([particle.location[:] for particle in system.particles], axis=0))
    return seen[-1] - seen[0]


@pytest.mark.parametrize("kind", ["dust", "sheet", "ball"])
def test_each_is_felt_as_if_it_were_the_only_one(scene, kind):
    obj, alone = CHECK[kind](scene), []
    for field in ("FORCE", "WIND"):
        made = CHECK["steady"](scene, field)
        bpy.ops.seeing_wind.calibrate(object=obj.name)
        alone.append(moved(obj, scene))
        for each in [each for each in scene.objects if each == made or each.parent == made]:
            bpy.data.objects.remove(each)
    both(scene)
    for name, truth in zip((FORCE, BREEZE, FORCE), (*alone, alone[0]), strict=True):
        assert bpy.ops.seeing_wind.calibrate(object=obj.name, field=name) == {"FINISHED"}
        assert moved(obj, scene) == pytest.approx(truth, abs=0.01 * np.abs(truth).max())
        other = BREEZE if name == FORCE else FORCE
        assert f"Not felt: {other}, as one weight cannot suit" in scene.seeing_wind.calibrations[-1].said


def test_a_wind_that_is_felt_by_others_does_not_slow_what_feels_the_force(scene):
    first, second = CHECK["dust"](scene), CHECK["dust"](scene)
    made = CHECK["steady"](scene, "FORCE")
    bpy.ops.seeing_wind.calibrate(object=first.name)
    truth = moved(first, scene)
    CHECK["steady"](scene, "WIND").name = BREEZE
    bpy.ops.seeing_wind.calibrate(object=second.name, field=BREEZE)
    assert moved(first, scene) == pytest.approx(truth, abs=1e-3)
    scene.seeing_wind.field_kind = "FORCE"
    bpy.ops.seeing_wind.apply_to_field(field=BREEZE)
    weights = first.particle_systems[0].settings.effector_weights
    assert weights.collection is None, "both are forces now"
    assert made.name in scene.objects


def test_what_feels_a_wind_does_not_feel_a_force_that_is_loaded_later(scene, workplace):
    recover(workplace)
    take = scene.seeing_wind.recovered_take
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    obj = CHECK["dust"](scene)
    CHECK["steady"](scene, "WIND").name = BREEZE
    bpy.ops.seeing_wind.calibrate(object=obj.name)
    weights = obj.particle_systems[0].settings.effector_weights
    assert weights.collection is None, "there is nothing else to feel"
    before = moved(obj, scene)
    assert bpy.ops.seeing_wind.build_scene(take=take) == {"FINISHED"}
    assert scene.seeing_wind.field_object.name not in weights.collection.objects and BREEZE in weights.collection.objects
    assert moved(obj, scene) == pytest.approx(before, abs=1e-3)


def test_force_fields_of_blenders_own_are_felt_beside_either(scene):
    obj = CHECK["dust"](scene)
    both(scene)
    bpy.ops.object.effector_add(type="WIND", location=(0.0, 0.0, -5.0))
    own = bpy.context.object
    bpy.ops.seeing_wind.calibrate(object=obj.name, field=FORCE)
    collection = obj.particle_systems[0].settings.effector_weights.collection
    assert {each.name for each in collection.objects} == {FORCE, own.name}
    bpy.ops.seeing_wind.calibrate(object=obj.name, field=BREEZE)
    collection = obj.particle_systems[0].settings.effector_weights.collection
    assert {each.name for each in collection.objects} == {BREEZE, f"{BREEZE} Still Air", own.name}


def test_only_this_wind_is_only_this_wind(scene):
    """Both stand in the scene's own collection, from which nothing could be left out."""
    obj = CHECK["dust"](scene)
    both(scene)
    bpy.ops.seeing_wind.calibrate(object=obj.name, field=BREEZE, alone=True)
    weights = obj.particle_systems[0].settings.effector_weights
    assert {each.name for each in weights.collection.objects} == {BREEZE, f"{BREEZE} Still Air"}
    found = moved(obj, scene)
    assert found[2] > 0.01 and abs(found[0]) < 1e-3
    bpy.ops.seeing_wind.calibrate(object=obj.name, field=FORCE)
    assert moved(obj, scene)[0] > 0.1 and BREEZE not in weights.collection.objects


def test_a_collection_of_the_users_own_stays_and_is_named(scene):
    obj, chosen = CHECK["dust"](scene), bpy.data.collections.new("Mine")
    both(scene)
    for name in (FORCE, BREEZE):
        chosen.objects.link(scene.objects[name])
    weights = obj.particle_systems[0].settings.effector_weights
    weights.collection = chosen
    bpy.ops.seeing_wind.calibrate(object=obj.name, field=FORCE)
    assert weights.collection == chosen
    assert f"The effector collection has {BREEZE}, too: take winds out" in scene.seeing_wind.calibrations[-1].said


def test_what_belongs_to_a_field_is_not_made_in_the_collection_that_feels_it(scene):
    obj = CHECK["dust"](scene)
    both(scene)
    bpy.ops.seeing_wind.calibrate(object=obj.name, field=BREEZE)
    field = scene.objects[BREEZE]
    show_arrows(scene, field)
    assert not any(FELT in each for each in arrows_of(field, scene).users_collection)


def test_two_winds_slow_once(scene):
    """Far from the second, and calibrated for either, a particle reaches the speed of the first; also without that which came first."""
    obj, first = CHECK["dust"](scene), CHECK["steady"](scene)
    second = CHECK["steady"](scene)
    second.name, second.location.x = BREEZE, 100.0
    bpy.ops.seeing_wind.apply_to_field(field=BREEZE)  # its reach is that of the settings: Fade
    for field in (first, second, first):
        bpy.ops.seeing_wind.calibrate(object=obj.name, field=field.name, density=5.0)
        obj.particle_systems[0].seed += 1
        assert CHECK["dust_speeds"](obj, scene, 30)[-1] == pytest.approx(CHECK["SPEED"], rel=0.01)
        assert len([each for each in scene.objects if SLOWS in each]) == 1
    bpy.ops.seeing_wind.calibrate(object=obj.name, field=BREEZE, density=5.0, alone=True)
    obj.location.x = 100.0
    obj.particle_systems[0].seed += 1
    assert CHECK["dust_speeds"](obj, scene, 30)[-1] == pytest.approx(CHECK["SPEED"], rel=0.01)
    bpy.data.objects.remove(first)
    bpy.context.view_layer.update()
    obj.particle_systems[0].seed += 1
    assert CHECK["dust_speeds"](obj, scene, 30)[-1] == pytest.approx(CHECK["SPEED"], rel=0.01)
    assert [each[SLOWS] for each in scene.objects if SLOWS in each] == [second]


def test_what_feels_a_field_does_not_show_it_where_its_collection_is_hidden(scene):
    obj = CHECK["dust"](scene)
    both(scene)
    bpy.ops.seeing_wind.calibrate(object=obj.name, field=BREEZE)
    field, home = scene.objects[BREEZE], bpy.data.collections.new("Home")
    scene.collection.children.link(home)
    scene.collection.objects.unlink(field)
    home.objects.link(field)
    before = moved(obj, scene)
    bpy.context.view_layer.layer_collection.children["Home"].hide_viewport = True
    bpy.context.view_layer.update()
    assert not field.visible_get() and moved(obj, scene) == pytest.approx(before, abs=1e-6)
    assert before[2] > 0.01
