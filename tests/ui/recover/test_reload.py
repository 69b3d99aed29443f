"""Reload puts new results into the objects that are there: what the user has tied to them stays tied."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import bpy
import pytest

from seeing_wind.ui.field.node_groups import get_input, set_input
from seeing_wind.ui.field.samples import SAMPLE_WIND, samples_of
from seeing_wind.ui.job import takes
from tests.ui.jobs import notes_of

pytestmark = pytest.mark.usefixtures("stand_in")

MADE = ("field_object", "arrows_object", "recovered_object")


@pytest.fixture
def recovered(stand_in, workplace) -> bpy.types.Scene:
    """A scene with results."""
    bpy.ops.seeing_wind.recover(clip=str(workplace / "clip.mp4"), box=(20, 20, 44, 44), distance=2.0, take=str(workplace / "one.take"))
    return bpy.context.scene


def made(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    return [getattr(scene.seeing_wind, name) for name in MADE] + [samples_of(scene.seeing_wind.field_object)]


def arrows_modifier(scene: bpy.types.Scene) -> bpy.types.Modifier:
    return next(each for each in scene.seeing_wind.arrows_object.modifiers if each.type == "NODES")


def shown(obj: bpy.types.Object, frame: int) -> list[tuple]:
    """Vertices of an object as it plays."""
    bpy.context.scene.frame_set(frame)
    return [tuple(vertex.co) for vertex in obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices]


def follower(target: bpy.types.Object, kind: str) -> bpy.types.Object:
    empty = bpy.data.objects.new(kind, None)
    bpy.context.scene.collection.objects.link(empty)
    empty.constraints.new(kind).target = target
    return empty


def test_constraints_drivers_and_modifiers_of_the_user_survive(recovered) -> None:
    settings = recovered.seeing_wind
    before = [obj.session_uid for obj in made(recovered)]
    tied = [follower(settings.recovered_object, kind) for kind in ("CHILD_OF", "COPY_LOCATION")]
    tied.append(follower(settings.field_object, "COPY_ROTATION"))
    settings.recovered_object.modifiers.new("Smooth", "SUBSURF")
    settings.recovered_object.vertex_groups.new(name="Held").add([0], 1.0, "REPLACE")
    driver = tied[0].driver_add("location", 0).driver
    driver.variables.new().targets[0].id = settings.field_object
    child = bpy.data.objects.new("Child", None)
    recovered.collection.objects.link(child)
    child.parent = settings.field_object
    shapes, looks = shown(settings.recovered_object, 5), len(shown(settings.arrows_object, 5))
    bpy.ops.seeing_wind.build_scene()
    assert [obj.session_uid for obj in made(recovered)] == before
    targets = [empty.constraints[0].target for empty in tied]
    assert targets == [settings.recovered_object, settings.recovered_object, settings.field_object]
    assert driver.variables[0].targets[0].id == settings.field_object == child.parent
    assert settings.recovered_object.vertex_groups.keys() == ["Held"] and "Smooth" in settings.recovered_object.modifiers
    assert shown(settings.recovered_object, 5) == shapes and len(shown(settings.arrows_object, 5)) == looks


def test_nothing_piles_up(recovered) -> None:
    pools = ("objects", "meshes", "node_groups", "shape_keys", "collections", "actions")
    bpy.ops.seeing_wind.build_scene()
    before = {pool: len([each for each in getattr(bpy.data, pool) if each.users]) for pool in pools}
    stacks = [[modifier.name for modifier in obj.modifiers] for obj in made(recovered)]
    bpy.ops.seeing_wind.build_scene()
    assert {pool: len([each for each in getattr(bpy.data, pool) if each.users]) for pool in pools} == before
    assert [[modifier.name for modifier in obj.modifiers] for obj in made(recovered)] == stacks
    assert bpy.data.node_groups[SAMPLE_WIND].interface.items_tree["Wind"].default_value == samples_of(recovered.seeing_wind.field_object)


def blocks() -> dict[str, list[str]]:
    """Names of all that the file holds, used or not, but for keys, which Blender names anew."""
    pools = ("actions", "collections", "images", "materials", "meshes", "node_groups", "objects", "textures", "worlds")
    return {pool: sorted(each.name for each in getattr(bpy.data, pool)) for pool in pools}


@pytest.mark.parametrize("field", ["FORCE", "WIND"])
def test_reload_leaves_no_orphans(recovered, workplace: Path, tmp_path: Path, field: str) -> None:
    bpy.ops.seeing_wind.recover(field=field)
    before = blocks()
    assert not any(re.search(r"\.00\d", name) for names in before.values() for name in names)
    for _ in range(2):
        bpy.ops.seeing_wind.build_scene()
        assert blocks() == before
    samples = samples_of(recovered.seeing_wind.field_object)
    samples.hide_select = samples.hide_viewport = False
    with bpy.context.temp_override(selected_objects=[samples]):
        bpy.ops.object.delete()
    bpy.ops.seeing_wind.build_scene()
    assert blocks() == before, "deleted by hand"
    bpy.data.objects.remove(samples_of(recovered.seeing_wind.field_object))
    bpy.ops.seeing_wind.build_scene()
    assert blocks() == before, "removed by a script"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.seeing_wind.build_scene()
    assert blocks() == before


def test_what_the_user_still_uses_of_a_former_result_stays(recovered) -> None:
    obj = recovered.seeing_wind.recovered_object
    material = obj.data.materials[0]
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    cube.data.materials.append(material)
    bpy.ops.seeing_wind.build_scene()
    (kept,) = cube.data.materials
    assert kept == material and any(node.type == "TEX_IMAGE" and node.image is not None for node in kept.node_tree.nodes)
    assert obj.data.materials[0] != material


def test_the_look_is_the_users_and_the_first_frame_that_of_the_results(recovered) -> None:
    set_input(arrows_modifier(recovered), "Density", 0.25)
    recovered.seeing_wind.frame_start = 11
    bpy.ops.seeing_wind.build_scene()
    assert get_input(arrows_modifier(recovered), "Density") == 0.25 and get_input(arrows_modifier(recovered), "First Frame") == 11
    assert recovered.seeing_wind.field_object["seeing_wind_frame_start"] == 11


def test_a_second_take_leaves_the_first_ones_field_alone(recovered, workplace: Path) -> None:
    first = made(recovered)
    names = [obj.name for obj in first]
    bpy.ops.seeing_wind.recover(take=str(workplace / "two.take"))
    second = made(recovered)
    assert [obj.name for obj in first] == names and not set(first) & set(second)
    assert all(obj.name in recovered.objects for obj in first + second)
    assert {Path(obj["seeing_wind_take"]).name for obj in (first[0], second[0])} == {"one.take", "two.take"}
    assert first[0].users_collection != second[0].users_collection
    assert any("stays" in text for text in notes_of(recovered))
    # the next run of the second goes into its own objects
    bpy.ops.seeing_wind.recover(take=str(workplace / "two.take"))
    assert made(recovered) == second


def test_a_take_that_was_moved_comes_into_its_own_objects(recovered, workplace: Path) -> None:
    before = [obj.session_uid for obj in made(recovered)]
    (workplace / "one.take").rename(workplace / "moved.take")
    bpy.ops.seeing_wind.build_scene(take=str(workplace / "moved.take"))
    assert [obj.session_uid for obj in made(recovered)] == before


def test_a_projects_own_take_goes_before_the_same_take_beside_the_project(recovered, workplace: Path, tmp_path: Path) -> None:
    inner = tmp_path / "project" / "v2"
    inner.mkdir(parents=True)
    take = Path(recovered.seeing_wind.recovered_take)
    for folder in (inner.parent, inner):
        shutil.copytree(take, folder / "own.take")
    bpy.ops.seeing_wind.build_scene(take=str(inner / "own.take"))
    bpy.ops.wm.save_as_mainfile(filepath=str(inner / "p.blend"))
    assert takes.recovered(bpy.context.scene.seeing_wind) == inner / "own.take"


def test_a_field_that_was_deleted_in_the_viewport_comes_back_with_its_name(recovered) -> None:
    """Blender keeps what is deleted there as long as the settings point at it."""
    before, field = {obj.name for obj in bpy.data.objects}, recovered.seeing_wind.field_object
    with bpy.context.temp_override(selected_objects=[field]):
        bpy.ops.object.delete()
    bpy.ops.seeing_wind.build_scene()
    assert {obj.name for obj in bpy.data.objects} == before


def test_nothing_is_left_of_a_field_that_was_deleted(recovered) -> None:
    before = {obj.name for obj in bpy.data.objects}
    bpy.data.objects.remove(recovered.seeing_wind.field_object)
    bpy.ops.seeing_wind.build_scene()
    assert {obj.name for obj in bpy.data.objects} == before


def test_an_object_in_edit_mode_takes_the_results_too(recovered) -> None:
    obj = recovered.seeing_wind.recovered_object
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    former = obj.data.session_uid
    bpy.ops.seeing_wind.build_scene()
    assert recovered.seeing_wind.recovered_object == obj and obj.mode == "OBJECT" and obj.data.session_uid != former
    assert obj.data.users == 1 and obj.data.shape_keys is not None


@pytest.mark.parametrize("name", MADE)
def test_what_was_deleted_is_made_anew(recovered, name: str) -> None:
    bpy.data.objects.remove(getattr(recovered.seeing_wind, name))
    bpy.ops.seeing_wind.build_scene()
    assert all(obj is not None and obj.name in recovered.objects for obj in made(recovered))
    field = recovered.seeing_wind.field_object
    assert field.field.type == "TEXTURE" and field.field.shape == "POINTS" and recovered.seeing_wind.arrows_object.parent == field


def test_reload_after_everything_was_deleted_makes_it_once(recovered) -> None:
    before = sorted(obj.name for obj in recovered.objects)
    for obj in list(recovered.objects):
        obj.hide_select = obj.hide_viewport = False
        obj.hide_set(False)
    bpy.ops.object.select_all(action="SELECT")
    bpy.ops.object.delete()
    assert not len(recovered.objects) and bpy.ops.seeing_wind.build_scene() == {"FINISHED"}
    assert sorted(obj.name for obj in recovered.objects) == sorted(obj.name for obj in bpy.data.objects) == before
    assert len(bpy.data.collections) == 1 and all(obj.users_scene for obj in bpy.data.objects)
