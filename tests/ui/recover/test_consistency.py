"""Two scenes, two takes, linked objects, awkward paths: the file stays consistent and nothing raises."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

import seeing_wind.ui as ui
from seeing_wind.ui import freshness
from seeing_wind.ui.bake.motion import is_intact
from seeing_wind.ui.bake.plan import mark_of
from seeing_wind.ui.field.samples import read_samples, samples_of
from seeing_wind.ui.job import status
from tests.ui.meshes import held_cube, world

pytestmark = pytest.mark.usefixtures("stand_in")


def recover(workplace: Path, take: str = "Blatt ß.take") -> None:
    """By the panel's own steps."""
    bpy.ops.seeing_wind.choose_clip(filepath=str(workplace / "clip.mp4"))
    bpy.ops.seeing_wind.draw_box(box=(20.0, 20.0, 44.0, 44.0))
    assert bpy.ops.seeing_wind.recover(distance=2.0, take=str(workplace / take)) == {"FINISHED"}


def test_renaming_duplicating_and_deleting_at_any_moment(workplace) -> None:
    recover(workplace)
    scene = bpy.context.scene
    one, two, wall = held_cube("One"), held_cube("Two"), held_cube("Wall")
    for obj in (one, two):
        bpy.ops.seeing_wind.insert_mesh(object=obj.name, pin_group="Top")
    bpy.ops.seeing_wind.insert_collider(object="Wall")
    one.name, two.name = "Zwei", "Eins"
    bpy.ops.seeing_wind.resimulate()
    one.name = "Renamed after the simulation"
    bpy.ops.seeing_wind.bake()
    assert is_intact(one) and is_intact(two)
    # Shift D on a baked object and on the field: the copies belong to nobody
    for obj in (one, scene.seeing_wind.field_object):
        copy = obj.copy()
        copy.data = obj.data.copy()
        scene.collection.objects.link(copy)
    bpy.context.view_layer.update()
    # X in the viewport: the object leaves the scene, but the list keeps it alive
    with bpy.context.temp_override(selected_objects=[one, wall, scene.seeing_wind.field_object, scene.seeing_wind.arrows_object]):
        bpy.ops.object.delete()
    freshness.refresh_all()
    with pytest.raises(RuntimeError, match="gone"):
        bpy.ops.seeing_wind.resimulate()
    scene.seeing_wind.active_body = 0
    bpy.ops.seeing_wind.remove_body()
    with pytest.raises(RuntimeError, match="collider Wall is gone"):
        bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.remove_collider()
    bpy.ops.seeing_wind.resimulate()
    bpy.data.objects.remove(two)
    with pytest.raises(RuntimeError, match="gone"):
        bpy.ops.seeing_wind.bake()
    bpy.ops.seeing_wind.clear_bake()
    bpy.ops.seeing_wind.build_scene()
    assert scene.seeing_wind.field_object.name in scene.objects


def test_two_takes_and_two_scenes_in_one_file(workplace) -> None:
    recover(workplace)
    first = bpy.context.scene
    held_cube("Flag")
    bpy.ops.seeing_wind.insert_mesh(pin_group="Top")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    field, kept = first.seeing_wind.field_object, mark_of(bpy.data.objects["Flag"])
    second = bpy.data.scenes.new("Second")
    bpy.context.window.scene = second
    recover(workplace, "andere.take")
    held_cube("Ball")
    bpy.ops.seeing_wind.insert_mesh(pin_group="Top", mass_scale=2.0)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    assert second.seeing_wind.field_object not in (None, field) and first.seeing_wind.field_object == field
    assert second.seeing_wind.simulated_take != first.seeing_wind.simulated_take
    assert [obj.name for obj in first.objects if obj.name in second.objects] == []
    assert mark_of(bpy.data.objects["Flag"]) == kept
    freshness.refresh_all()
    for scene in (first, second):
        assert {str(status.of(scene.session_uid).steps[name].state) for name in status.STEPS} == {"done"}
    bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "zwei Szenen.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "zwei Szenen.blend"))
    first, second = bpy.data.scenes["Scene"], bpy.data.scenes["Second"]
    for scene in (first, second):
        assert {str(status.of(scene.session_uid).steps[name].state) for name in status.STEPS} == {"done"}, "reopened"
    # another take in the first scene replaces what the first showed, edits stay and are stale
    bpy.context.window.scene = first
    bpy.ops.seeing_wind.build_scene(take=str(workplace / "andere.take"))
    assert first.seeing_wind.recovered_take.endswith("andere.take") and len(first.seeing_wind.bodies) == 1
    assert status.of(first.session_uid).steps["resimulate"].state == "stale" and is_intact(bpy.data.objects["Flag"])


def test_linked_objects_are_moved_by_a_copy(workplace, tmp_path) -> None:
    held_cube("Linked")
    library = tmp_path / "Bibliothek ü.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    recover(workplace)
    scene = bpy.context.scene
    with bpy.data.libraries.load(str(library), link=True) as (_, into):
        into.objects = ["Linked"]
    linked = bpy.data.objects["Linked"]
    scene.collection.objects.link(linked)
    bpy.context.view_layer.update()
    bpy.ops.seeing_wind.insert_mesh(object="Linked", pin_group="Top")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    copy = scene.seeing_wind.bodies[0].baked_copy
    assert copy is not None and copy.library is None and mark_of(copy)["way"] == "SHAPE_KEYS" and mark_of(linked) is None
    bpy.ops.seeing_wind.duplicate_edit()
    assert scene.seeing_wind.bodies[0].object.library is None
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mit Verweis.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "mit Verweis.blend"))
    assert bpy.context.scene.seeing_wind.edits[0].bodies[0].object.library is not None


def test_what_is_baked_plays_in_a_blender_that_knows_nothing_of_us(workplace, tmp_path) -> None:
    recover(workplace)
    scene, shown = bpy.context.scene, {}
    for name, way in (("Bends", "SHAPE_KEYS"), ("Large", "POINT_CACHE"), ("Rigid", "TRANSFORM")):
        held_cube(name)
        bpy.ops.seeing_wind.insert_mesh(object=name, pin_group="" if way == "TRANSFORM" else "Top")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "gebacken.blend"))
    for name, way in (("Bends", "SHAPE_KEYS"), ("Large", "POINT_CACHE"), ("Rigid", "TRANSFORM")):
        bpy.ops.seeing_wind.bake(object=name, way=way)
    bpy.ops.wm.save_mainfile()
    for frame in (1, 7, 13):
        scene.frame_set(frame)
        shown[frame] = {name: world(bpy.data.objects[name]) for name in ("Bends", "Large", "Rigid")}
    ui.unregister()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "gebacken.blend"))
    assert not hasattr(bpy.context.scene, "seeing_wind")
    for frame, places in shown.items():
        bpy.context.scene.frame_set(frame)
        for name, place in places.items():
            np.testing.assert_allclose(world(bpy.data.objects[name]), place, atol=1e-6)
    assert all(np.abs(shown[13][name] - shown[1][name]).max() > 0.1 for name in shown[1])
    ui.register()


def test_a_clip_that_begins_before_frame_zero(workplace, tmp_path) -> None:
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 30, 1.001
    scene.seeing_wind.frame_start = -20
    recover(workplace, "negativ.take")
    assert not scene.use_preview_range, "a scene of 29.97 frames a second is somebody's own"
    bpy.ops.seeing_wind.match_scene(parts={"RANGE"})
    assert scene.use_preview_range and (scene.frame_preview_start, scene.frame_preview_end) == (-20, -8)
    falls = held_cube("Falls")
    bpy.ops.seeing_wind.insert_mesh(object="Falls", pin_group="Top")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
    low = []
    for frame in (-20, -8, 5):
        scene.frame_set(frame)
        low.append(world(falls)[:, 2].min())
    assert low[0] - low[1] == pytest.approx(0.5 * 3.0 * (12 / 24.0) ** 2, abs=1e-5) and low[2] == low[1]
    with pytest.raises(RuntimeError, match="begins at frame -20"):
        bpy.ops.seeing_wind.render_composite(filepath=str(tmp_path / "x.mp4"))
    scene.seeing_wind.frame_start = 1
    bpy.ops.seeing_wind.build_scene()
    assert not scene.use_preview_range and (scene.frame_start, scene.frame_end) == (1, 13)


def test_small_units_and_a_linked_scene_beside(workplace, tmp_path) -> None:
    """A scene in centimetres; a second one linked from another file is looked at and left alone."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "Bibliothek.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "Bibliothek.blend"), link=True) as (there, here):
        here.scenes = list(there.scenes)
    freshness.refresh_all()
    scene = bpy.context.scene
    scene.unit_settings.scale_length, scene.gravity = 0.01, (0.0, 0.0, -981.0)
    recover(workplace, "klein.take")
    bpy.ops.mesh.primitive_cube_add(size=20.0, location=(30.0, 0.0, 0.0))
    falls = bpy.context.object
    bpy.ops.seeing_wind.insert_mesh(object=falls.name)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    low = []
    for frame in (1, 13):
        scene.frame_set(frame)
        low.append(world(falls)[:, 2].min())
    assert low == pytest.approx([-10.0, -10.0 - 100.0 * 0.5 * 3.0 * (12 / 24.0) ** 2], abs=1e-3)
    assert np.ptp(read_samples(samples_of(scene.seeing_wind.field_object)).box, axis=0).max() == pytest.approx(120.0, rel=1e-3)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mit Szene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "mit Szene.blend"))
    linked = next(scene for scene in bpy.data.scenes if scene.library)
    bpy.context.window.scene = linked
    freshness.refresh_all()
    assert {str(step.state) for step in status.of(linked.session_uid).steps.values()} == {"idle"}
    clip, ops = str(workplace / "clip.mp4"), bpy.ops.seeing_wind
    for call in (lambda: ops.recover(clip=clip, box=(20, 20, 44, 44)), lambda: ops.choose_clip(filepath=clip)):
        with pytest.raises(RuntimeError, match="linked from another file"):
            call()


@pytest.mark.parametrize("kind", ["LINK_COPY", "FULL_COPY"])
def test_a_copied_scene_recovers_without_taking_from_its_original(workplace, kind) -> None:
    recover(workplace)
    bpy.context.scene.seeing_wind.take = ""
    first = bpy.context.scene
    shown = [first.seeing_wind.field_object, first.seeing_wind.arrows_object, first.seeing_wind.recovered_object]
    bpy.ops.scene.new(type=kind)
    second = bpy.context.scene
    assert bpy.ops.seeing_wind.recover(distance=3.0) == {"FINISHED"}
    assert all(obj.name in first.objects and obj.name not in second.objects for obj in shown)
    assert shown == [first.seeing_wind.field_object, first.seeing_wind.arrows_object, first.seeing_wind.recovered_object]
    assert second.seeing_wind.field_object.name in second.objects and second.seeing_wind.field_object not in shown
    assert second.seeing_wind.recovered_take != first.seeing_wind.recovered_take


def test_two_scenes_with_one_take_keep_their_simulations_apart(workplace) -> None:
    recover(workplace)
    bpy.ops.seeing_wind.insert_mesh(recovered=True)
    bpy.ops.seeing_wind.resimulate()
    first = bpy.context.scene
    bpy.ops.scene.new(type="FULL_COPY")
    second = bpy.context.scene
    bpy.ops.seeing_wind.scale_mass(factor=4.0)
    bpy.ops.seeing_wind.resimulate()
    fallen = {}
    for scene in (first, second):
        bpy.context.window.scene = scene
        bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
        scene.frame_set(1)
        before = world(scene.seeing_wind.bodies[0].baked_copy)
        scene.frame_set(13)
        fallen[scene] = (before - world(scene.seeing_wind.bodies[0].baked_copy))[:, 2].mean()
    assert fallen[first] == pytest.approx(4.0 * fallen[second], rel=1e-3) and fallen[second] > 0.05
