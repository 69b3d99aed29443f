"""A conformed clip: background, composite, mattes, camera, recovered object and bake show the same moment at every scene frame."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.engine.record_arrays import to_arrays
from seeing_wind.engine.take import Take
from seeing_wind.ui import freshness
from seeing_wind.ui.clip.inputs.clips import scene_frame
from seeing_wind.ui.clip.inputs.pace import Pace, frame_by_frame
from seeing_wind.ui.composite.composite import set_up
from seeing_wind.ui.job.take_reading import field_summary, read_seen
from tests.ui.composite.rendering import render
from tests.ui.edit.edits import state
from tests.ui.jobs import recover
from tests.ui.meshes import cube, group, shown

FRAMES = 13
PLATE = np.array([20, 120, 40])


@pytest.fixture
def recovered(scene, stand_in, workplace):
    """A recovery of the clip in which a square goes two pixels a frame to the right, and the object 0.02 m."""
    assert recover(workplace) == {"FINISHED"}
    return scene


def conform(scene, fps: int, **options) -> None:
    scene.render.fps, scene.render.fps_base = fps, 1.0
    assert bpy.ops.seeing_wind.conform(**options) == {"FINISHED"}


def numbers(scene, fps: int) -> dict[int, int]:
    """The clip frame that is nearest to each scene frame, a later one before an earlier one, without the code under test."""
    frames = range(scene.seeing_wind.frame_start, scene.frame_end + 1)
    return {frame: min(FRAMES - 1, int(np.floor((frame - frames[0]) * 24.0 / fps + 0.5 + 1e-9))) for frame in frames}


def of_object(scene, frame: int) -> float:
    """Which frame the recovered object stands at."""
    scene.frame_set(frame)
    evaluated = scene.seeing_wind.recovered_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    places = [(evaluated.matrix_world @ vertex.co).x for vertex in evaluated.data.vertices]
    return float(np.mean(places)) / 0.02


@pytest.mark.parametrize("fps", [20, *(pytest.param(fps, marks=pytest.mark.slow) for fps in (30, 60))])
def test_the_composite_shows_the_frame_at_which_object_and_bake_are(recovered, tmp_path, fps) -> None:
    scene = recovered
    box = cube("Box", location=(0.0, 0.0, 8.0))
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
    fallen = {t: shown(box, scene.seeing_wind.frame_start + t)[:, 2].mean() for t in range(FRAMES)}
    set_up(scene, plate="CLIP", samples=1)
    conform(scene, fps)
    for frame, clip_frame in list(numbers(scene, fps).items())[:: max(fps // 12, 1)]:
        scene.frame_set(frame)
        row = render(tmp_path / f"{frame}.png")[30].mean(axis=1)
        assert np.flatnonzero(row > 145)[0] == pytest.approx(20 + 2 * clip_frame, abs=1.01), frame
        assert abs(of_object(scene, frame) - clip_frame) < 0.51
        nearest = min(fallen, key=lambda t: abs(fallen[t] - shown(box, frame)[:, 2].mean()))
        assert abs(nearest - clip_frame) <= 1 and scene_frame(scene.active_clip, clip_frame) in (frame - 1, frame, frame + 1)
    conform(scene, 24, real_time=False)
    scene.frame_set(4)
    assert np.flatnonzero(render(tmp_path / "back.png")[30].mean(axis=1) > 145)[0] == pytest.approx(26, abs=1.01)
    assert scene.active_clip.frame_start == 1 and not scene.active_clip.animation_data.drivers


@pytest.mark.parametrize("first", ["composite", pytest.param("conform", marks=pytest.mark.slow)])
def test_the_plate_covers_the_object_of_the_frame_that_is_shown(recovered, tmp_path, first) -> None:
    scene, fps = recovered, 36
    bpy.ops.seeing_wind.insert_mesh(recovered=True)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    steps = [lambda: set_up(scene, samples=1, grain=0.0), lambda: conform(scene, fps)]
    for step in steps if first == "composite" else steps[::-1]:
        step()
    for body in scene.seeing_wind.bodies:
        body.baked_copy.hide_render = True  # nothing but clip and plate
    for frame, clip_frame in list(numbers(scene, fps).items())[::4]:
        scene.frame_set(frame)
        row = render(tmp_path / f"{frame}.png")[32]
        plate = np.abs(row - PLATE).max(axis=1) < 8
        assert plate[22 + 2 * clip_frame : 42 + 2 * clip_frame].all() and not (row.mean(axis=1) > 145).any(), frame


def test_the_card_holds_out_the_outline_of_the_frame_that_is_shown(recovered, tmp_path) -> None:
    """A red wall behind the object is seen round the outline, and not in it."""
    scene, fps = recovered, 36
    bpy.ops.mesh.primitive_plane_add(size=20.0, location=(0.0, 3.0, 0.0), rotation=(np.pi / 2, 0.0, 0.0))
    material = bpy.data.materials.new("Red")
    material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"].inputs
    surface["Emission Color"].default_value, surface["Emission Strength"].default_value = (1.0, 0.0, 0.0, 1.0), 1.0
    bpy.context.object.data.materials.append(material)
    set_up(scene, plate="CLIP", samples=1, grain=0.0, shutter=0.0)
    conform(scene, fps)
    for frame, clip_frame in list(numbers(scene, fps).items())[::4]:
        scene.frame_set(frame)
        row = render(tmp_path / f"{frame}.png")[32]
        red = row[:, 0] - row[:, 1] > 80
        held = np.flatnonzero(~red)
        assert held[0] == pytest.approx(20 + 2 * clip_frame, abs=2) and held[-1] == pytest.approx(43 + 2 * clip_frame, abs=2), frame


@pytest.mark.parametrize("fps", [pytest.param(30, marks=pytest.mark.slow), 20])
def test_a_camera_that_moves_stands_where_the_frame_that_is_shown_was_taken(recovered, workplace, fps) -> None:
    scene = recovered
    take = Take(Path(scene.seeing_wind.recovered_take))
    camera = read_seen(take, field_summary(take)).camera
    poses = np.repeat(np.asarray(camera.camera_to_world)[None], FRAMES, axis=0)
    poses[:, 0, 3] += 0.1 * np.arange(FRAMES)
    moved = dataclasses.replace(camera, camera_to_world=poses)
    take.write_arrays("observation.npz", take.read_arrays("observation.npz") | to_arrays(moved, "camera."))
    assert bpy.ops.seeing_wind.build_scene() == {"FINISHED"}
    for _ in range(2):
        conform(scene, fps)
        for frame, clip_frame in numbers(scene, fps).items():
            scene.frame_set(frame)
            assert scene.seeing_wind.camera_object.matrix_world.translation.x == pytest.approx(0.1 * clip_frame, abs=1e-5)
        assert bpy.ops.seeing_wind.build_scene() == {"FINISHED"}, "Reload keeps the pace"
    conform(scene, 24, real_time=False)
    scene.frame_set(8)
    assert scene.seeing_wind.camera_object.matrix_world.translation.x == pytest.approx(0.7, abs=1e-5)


def test_a_clip_whose_first_frame_is_used_late_or_that_has_an_offset(recovered) -> None:
    scene, clip = recovered, recovered.active_clip
    conform(scene, 30)
    assert [scene_frame(clip, frame) for frame in (0, 1, 4, 8)] == [1, 2, 6, 11]
    with frame_by_frame(clip):
        assert [scene_frame(clip, frame) for frame in (0, 1, 4, 8)] == [1, 2, 5, 9] and clip.frame_start == 1
    scene.frame_set(11)
    assert clip.frame_start == 11 - 8 and Pace(1, 1.25).shown(11) == 8


def test_a_preview_stays_up_to_date_as_long_as_it_has_all_that_is_seen(recovered) -> None:
    scene = recovered
    obj = cube("Box")
    group(obj, "Top", {0: 1.0})
    bpy.ops.seeing_wind.insert_mesh(object="Box", pin_group="Top")
    assert bpy.ops.seeing_wind.preview_edit() == {"FINISHED"}
    conform(scene, 30)
    freshness.refresh(scene)
    assert (state("edit_preview"), state("bake")) == ("done", "done")
    conform(scene, 24, real_time=False)
    freshness.refresh(scene)
    assert (state("edit_preview"), state("bake")) == ("done", "done")
    # a range of its own shows less of the clip at a higher rate, and more at a lower one
    scene.seeing_wind.follows = set()
    scene.frame_end = 7
    bpy.ops.seeing_wind.preview_edit()
    conform(scene, 48)
    freshness.refresh(scene)
    assert (state("edit_preview"), state("bake")) == ("done", "done")
    conform(scene, 12)
    freshness.refresh(scene)
    assert state("edit_preview") == "stale"
