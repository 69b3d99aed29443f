"""Held places by a box, a Blender mask or weight paint are the pixels of the first frame that the engine reads."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from seeing_wind.engine.record_arrays import to_arrays
from seeing_wind.engine.records import Camera
from seeing_wind.engine.take import Take
from seeing_wind.ui.clip.clip_scene import setup_clip_scene
from seeing_wind.ui.clip.inputs.camera import scene_camera
from seeing_wind.ui.clip.inputs.held import painted_pixels
from seeing_wind.ui.clip.inputs.lens import straightened
from seeing_wind.ui.clip.marked import marks_of
from seeing_wind.ui.clip.object.panel import ObjectTab
from seeing_wind.ui.job.take_reading import field_summary, read_seen
from seeing_wind.ui.recover.request import RecoverRequest
from tests.ui.clip.inputs import HEIGHT, WIDTH, camera, read_png, solve, spline, with_box, written
from tests.ui.drawn import Drawn
from tests.ui.jobs import recover
from tests.ui.meshes import group


def held(scene) -> np.ndarray:
    """The frame that Recover would be given, (H, W) bool."""
    request = RecoverRequest.of(scene)
    request.write_inputs()
    words = request.arguments()
    return read_png(Path(words[words.index("--pin") + 1]))


def test_a_box_is_held_to_the_pixel(settings, scene, tmp_path) -> None:
    settings.take = str(tmp_path / "one.take")
    with_box(settings)
    assert "--pin" not in RecoverRequest.of(scene).arguments()
    assert bpy.ops.seeing_wind.draw_box(box=(30.0, 40.0, 35.0, 44.0), marks="HELD") == {"FINISHED"}
    assert tuple(settings.box) == (20.0, 20.0, 44.0, 44.0), "the object's own box stays"
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[40:45, 30:36] = True
    np.testing.assert_array_equal(held(scene), expected)
    before = RecoverRequest.of(scene).digest()
    settings.held_box[0] = 31.0
    assert RecoverRequest.of(scene).digest() != before
    settings.held_box = (0.0, 0.0, 0.0, 0.0)
    with pytest.raises(RuntimeError, match="No box is drawn round the held part"):
        bpy.ops.seeing_wind.recover()


def test_what_is_held_may_have_a_head_and_leaves_of_other_materials(settings, scene, tmp_path) -> None:
    def menus() -> list[str]:
        layout = Drawn()
        ObjectTab.fill(SimpleNamespace(bl_space_type="VIEW_3D"), bpy.context, layout)
        return layout.menus

    settings.take = str(tmp_path / "one.take")
    with_box(settings)
    before = RecoverRequest.of(scene)
    assert menus() == ["SEEING_WIND_MT_material"] and before.build.head_material is None
    settings.held_mode, settings.held_box = "BOX", (30.0, 40.0, 35.0, 44.0)
    assert menus() == [f"SEEING_WIND_MT_{name}" for name in ("material", "head_material", "leaf_material")]
    plain = RecoverRequest.of(scene)
    assert not any(word.endswith("-material") for word in plain.arguments())
    settings.head_material, settings.leaf_material = "flower_head", "leaf"
    words = RecoverRequest.of(scene).arguments()
    assert words[words.index("--head-material") + 1] == "flower_head" and words[words.index("--leaf-material") + 1] == "leaf"
    assert RecoverRequest.of(scene).digest() != plain.digest()
    settings.held_box = (0.0, 0.0, 0.0, 0.0)
    assert len(menus()) == 3, "what is set stays in sight"
    settings.head_material = settings.leaf_material = "PRESET"
    assert len(menus()) == 1


def test_boxes_stay_in_sight_over_the_first_frame_until_their_step_folds(settings, scene, video) -> None:
    assert bpy.ops.seeing_wind.choose_clip(filepath=str(video)) == {"FINISHED"}
    scene.frame_set(settings.frame_start)
    assert marks_of(scene) == [], "nothing is marked"
    assert bpy.ops.seeing_wind.draw_box(box=(20.0, 20.0, 44.0, 44.0)) == {"FINISHED"}
    assert bpy.ops.seeing_wind.draw_box(box=(30.0, 40.0, 35.0, 44.0), marks="HELD") == {"FINISHED"}
    assert [box for box, _ in marks_of(scene)] == [(20.0, 20.0, 44.0, 44.0), (30.0, 40.0, 35.0, 44.0)]
    settings.held_mode = "FILE"
    assert [box for box, _ in marks_of(scene)] == [(20.0, 20.0, 44.0, 44.0)]
    scene.frame_set(settings.frame_start + 1)
    assert marks_of(scene) == [], "they belong to the first frame"
    scene.frame_set(settings.frame_start)
    settings.shows_object = False
    assert marks_of(scene) == []


def test_a_mask_is_held_and_a_file_that_is_not_used_is_not_asked_for(settings, scene, tmp_path) -> None:
    settings.take, settings.pin = str(tmp_path / "one.take"), str(tmp_path / "gone.png")
    with_box(settings)
    settings.held_mode = "BLENDER_MASK"
    with pytest.raises(RuntimeError, match="No mask of the held part"):
        bpy.ops.seeing_wind.recover()
    mask = settings.held_mask = bpy.data.masks.new("Stem")
    spline(mask.layers.new(name="L"), [(29.5, 39.5), (36.5, 39.5), (36.5, 44.5), (29.5, 44.5)])
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[40:45, 30:37] = True
    np.testing.assert_array_equal(held(scene), expected)
    mask.layers[0].splines[0].use_cyclic = False
    with pytest.raises(RuntimeError, match="Nothing is inside the mask Stem"):
        bpy.ops.seeing_wind.recover()


def test_recover_takes_held_places_as_keywords(stand_in, scene, workplace) -> None:
    mask = bpy.data.masks.new("Stem")
    spline(mask.layers.new(name="L"), [(29.5, 39.5), (36.5, 39.5), (36.5, 44.5), (29.5, 44.5)])
    assert recover(workplace, held_box=(30, 40, 35, 44)) == {"FINISHED"} and scene.seeing_wind.held_mode == "BOX"
    assert recover(workplace, held_mode="BLENDER_MASK", held_mask="Stem") == {"FINISHED"}
    given = Take(Path(scene.seeing_wind.recovered_take)).description()["stages"]["recover"]["settings"]["options"]
    assert read_png(Path(given[given.index("--pin") + 1])).sum() == 7 * 5
    with pytest.raises(RuntimeError, match="There is no 'Leaf'"):
        recover(workplace, held_mask="Leaf")


@pytest.mark.parametrize("distortion", [(), (-5.0, 0.0, 0.0, 0.0, 0.0)])
def test_paint_on_the_recovered_object_is_held_where_the_clip_shows_it(stand_in, scene, workplace, distortion) -> None:
    assert recover(workplace) == {"FINISHED"}
    settings = scene.seeing_wind
    take, obj = Take(Path(settings.recovered_take)), settings.recovered_object
    if distortion:
        bent = dataclasses.replace(read_seen(take, field_summary(take)).camera, distortion=distortion)
        take.write_arrays("observation.npz", take.read_arrays("observation.npz") | to_arrays(bent, "camera."))
    scene.frame_set(7)  # the object has moved on; the first frame counts
    # a grid of 4 x 4 vertices, of which the lower two rows are painted, the second of them half
    low = np.argsort([vertex.co.z for vertex in obj.data.vertices], kind="stable")
    group(obj, "Foot", {int(v): 1.0 for v in low[:4]} | {int(v): 0.5 for v in low[4:8]} | {int(v): 0.2 for v in low[8:]})
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.seeing_wind.hold_painted() == {"FINISHED"} and scene.frame_current == 7
    assert settings.held_mode == "FILE" and Path(settings.pin).parent == Path(settings.take)
    found = held(scene)
    seen = read_seen(take, field_summary(take))
    grid = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1)
    straight = straightened(seen.camera, grid)
    # rays meet the object's plane y = 0
    pose = seen.camera.pose(0)
    flat = (straight - (seen.camera.cx, seen.camera.cy)) / (seen.camera.fx, seen.camera.fy)
    rays = np.concatenate([flat, np.ones((HEIGHT, WIDTH, 1))], axis=-1)
    rays = rays @ pose[:3, :3].T
    places = pose[:3, 3] - rays * (pose[1, 3] / rays[..., 1:2])
    expected = (np.abs(places[..., 0]) < 0.2) & (places[..., 2] > -0.2) & (places[..., 2] < -0.2 + 0.4 / 3.0)
    assert expected.sum() > 100 and (found != expected).sum() <= 0.1 * expected.sum(), "but for the rim"
    assert distortion == () or (expected != held_without_lens(seen.camera)).sum() > 5, "the lens is seen at this size"


def held_without_lens(camera: Camera) -> np.ndarray:
    """The painted strip as a pinhole would show it."""
    (left, top), (right, bottom) = camera.project(np.array([[-0.2, 0.0, -0.2 + 0.4 / 3.0], [0.2, 0.0, -0.2]]))[0]
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    return (x > left) & (x < right) & (y > top) & (y < bottom)


def test_paint_on_another_mesh_is_seen_through_the_scenes_camera(settings, scene, tmp_path) -> None:
    settings.take = str(tmp_path / "one.take")
    with_box(settings)
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(camera(0.0)), 24.0, 0, 12, 1)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=1, y_subdivisions=1, size=0.4, rotation=(0.5 * np.pi, 0.0, 0.0))
    bpy.context.view_layer.update()
    proxy = bpy.context.object
    group(proxy, "All", {v: 1.0 for v in range(4)})
    assert bpy.ops.seeing_wind.hold_painted(object=proxy.name, vertex_group="All") == {"FINISHED"}
    first = settings.pin
    corners, _ = camera(0.0).project(np.array([[x, 0.0, z] for x in (-0.2, 0.2) for z in (-0.2, 0.2)]))
    rows, columns = np.nonzero(read_png(Path(first)))
    found = [[columns.min(), rows.min()], [columns.max(), rows.max()]]
    assert np.abs(np.array(found) - [corners.min(axis=0), corners.max(axis=0)]).max() < 1.5 and len(rows) > 50
    proxy.location.z += 0.1
    bpy.context.view_layer.update()
    assert bpy.ops.seeing_wind.hold_painted(object=proxy.name) == {"FINISHED"}
    assert settings.pin != first and Path(first).is_file(), "an undo finds the former frame"


def test_what_cannot_be_held_is_said(settings, scene, tmp_path) -> None:
    settings.take = str(tmp_path / "one.take")
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(camera(0.0)), 24.0, 0, 12, 1)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=1, y_subdivisions=1, size=0.4, rotation=(0.5 * np.pi, 0.0, 0.0))
    proxy = bpy.context.object

    def refused(says: str, **given) -> None:
        with pytest.raises(RuntimeError, match=says):
            bpy.ops.seeing_wind.hold_painted(**given)
        assert settings.pin == ""

    refused("no mesh 'Leaf'", object="Leaf")
    refused("no vertex group", object=proxy.name)
    group(proxy, "Faint", {v: 0.3 for v in range(4)})
    refused("sees nothing", object=proxy.name)
    group(proxy, "All", {v: 1.0 for v in range(4)})
    proxy.location.y = -10.0  # behind the camera
    bpy.context.view_layer.update()
    refused("sees nothing", vertex_group="All")
    scene.camera = None
    refused("no camera", vertex_group="All")
    settings.clip = ""
    refused("No clip is chosen", vertex_group="All")


def test_what_is_said_of_a_hidden_mesh_names_it_and_not_its_passing_copy(settings, scene, tmp_path) -> None:
    settings.take = str(tmp_path / "one.take")
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(camera(0.0)), 24.0, 0, 12, 1)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=1, y_subdivisions=1, size=0.4)
    proxy = bpy.context.object
    proxy.name = "Proxy"
    group(proxy, "None", {0: 0.0})
    proxy.hide_set(True)
    for name, says in (("Nowhere", "Proxy has no vertex group 'Nowhere'"), ("None", "No vertex of Proxy has a weight in 'None'")):
        with pytest.raises(RuntimeError, match=says):
            bpy.ops.seeing_wind.hold_painted(object="Proxy", vertex_group=name)
    group(proxy, "All", {v: 1.0 for v in range(4)})
    proxy.scale.z = proxy.scale.x = 0.0
    with pytest.raises(RuntimeError, match="Proxy has a scale of 0"):
        bpy.ops.seeing_wind.hold_painted(object="Proxy", vertex_group="All")
    assert bpy.data.objects.keys().count("Proxy.001") == 0


def test_paint_reaches_as_far_as_half_its_weight_and_is_seen_from_its_edge() -> None:
    xy = np.array([[2.0, 2.0], [12.2, 2.0], [2.0, 12.2]])
    found = painted_pixels(xy, np.array([1.0, 0.0, 0.0]), np.array([[0, 1, 2]]), 20, 20)
    y, x = np.nonzero(found)
    assert (x + y).max() == 4 + 5 and len(x) == 6 * 7 // 2
    edge = painted_pixels(np.array([[2.0, 2.0], [12.0, 2.0], [7.0, 2.0]]), np.ones(3), np.array([[0, 1, 2]]), 20, 20)
    assert np.argwhere(edge).tolist() == [[2, 2], [2, 7], [2, 12]]


def test_a_proxy_is_where_the_lens_showed_it(settings, scene, tmp_path) -> None:
    """Its depth, and with it its outline, is that of the pixels of the clip."""
    clip = bpy.data.movieclips.load(settings.clip)
    solve(clip)
    clip.tracking.camera.k1 = -0.25
    with_box(settings).object_mode = "PROXY"
    pose = np.array(scene_camera(scene)["camera_to_world"][0])
    place = pose[:3, :3] @ [-1.0, -0.6, 4.0] + pose[:3, 3]
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.6, location=place, segments=64, ring_count=32)
    settings.proxy, settings.scale_mode = bpy.context.object, "PROXY"
    bent = np.isfinite(np.load(written(settings, tmp_path)["depth"]))
    clip.tracking.camera.k1 = 0.0
    straight = np.isfinite(np.load(written(settings, tmp_path)["depth"]))
    lens = Camera(WIDTH, HEIGHT, 100.0, 100.0, 0.5 * WIDTH - 0.5, 0.5 * HEIGHT - 0.5, np.eye(4), (-0.25, 0.0, 0.0, 0.0, 0.0))
    grid = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1)
    at = np.clip(np.round(straightened(lens, grid)), 0, (WIDTH - 1, HEIGHT - 1)).astype(int)
    assert bent.sum() > 50 and (bent != straight).sum() > 5
    assert (bent != straight[at[..., 1], at[..., 0]]).sum() < 0.1 * bent.sum(), "but for the rim"
