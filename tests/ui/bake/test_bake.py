"""Absolute shape keys: the simulated vertices come back frame by frame, and the former mesh when the bake is cleared."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Euler

from seeing_wind.engine.errors import UsageError
from seeing_wind.ui.bake.motion import bake_motion, bake_shape_keys, baked_copy, clear_bake
from seeing_wind.ui.bake.plan import SHAPE_KEYS, Plan
from seeing_wind.ui.bake.shapes import evaluation_time_curves
from tests.ui.meshes import shown


@pytest.fixture
def grid(scene) -> bpy.types.Object:
    """A grid of 25 vertices that is placed, turned and scaled."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4)
    grid = bpy.context.object
    grid.location, grid.rotation_euler, grid.scale = (1.0, 2.0, 3.0), Euler((0.3, 0.2, -0.5)), (1.0, 2.0, 0.5)
    bpy.context.view_layer.update()
    return grid


def motion_of(obj: bpy.types.Object, frames: int, seed: int = 0) -> np.ndarray:
    """A random motion (frames + 1, V, 3) that starts from the mesh."""
    rest = shown(obj, 1)
    return rest + np.cumsum(np.random.default_rng(seed).normal(scale=0.05, size=(frames + 1, *rest.shape)), axis=0)


def test_keys_play_back_every_frame(grid):
    motion = motion_of(grid, 12)
    key = bake_shape_keys(grid, motion, 7, 24.0)
    assert not key.use_relative and len(key.key_blocks) == 13
    assert [point.interpolation for curve in evaluation_time_curves(key) for point in curve.keyframe_points] == ["LINEAR", "LINEAR"]
    for frame in range(13):
        assert np.abs(shown(grid, 7 + frame) - motion[frame]).max() < 1e-5
    assert np.abs(shown(grid, 1) - motion[0]).max() < 1e-5 and np.abs(shown(grid, 40) - motion[-1]).max() < 1e-5
    assert np.abs(shown(grid, 9.5) - 0.5 * (motion[2] + motion[3])).max() < 1e-4


def test_bake_replaces_a_former_one_and_clears(grid):
    mesh_before, world_before = np.array([v.co[:] for v in grid.data.vertices]), shown(grid, 1)
    bake_shape_keys(grid, motion_of(grid, 12), 1, 24.0)
    motion = world_before + np.linspace(0.0, 1.0, 5)[:, None, None]
    key = bake_shape_keys(grid, motion, 1, 24.0)
    assert len(key.key_blocks) == 5 and len(bpy.data.shape_keys) == 1 and len(bpy.data.actions) == 1
    assert np.abs(shown(grid, 5) - motion[-1]).max() < 1e-5
    assert clear_bake(grid) and not clear_bake(grid)
    assert grid.data.shape_keys is None and not bpy.data.actions
    assert np.array_equal(mesh_before, [v.co[:] for v in grid.data.vertices])


def test_a_moving_object_is_baked_right_between_frames_before_frame_0(grid, scene):
    """Twice as many clip frames as scene frames, before and after frame 0, on an object that keyframes move."""
    for frame, place in ((-6, 0.0), (6, 12.0)):
        grid.location.x = place
        grid.keyframe_insert("location", index=0, frame=frame)
    scene.render.fps = 24
    motion = motion_of(grid, 8)
    scene.frame_set(-3, subframe=0.5)
    bake_motion(grid, motion, Plan(-2, 48.0, SHAPE_KEYS, frames_follow_time=True), scene)
    assert scene.frame_current_final == -2.5
    for number in range(9):
        assert np.abs(shown(grid, -2.0 + 0.5 * number) - motion[number]).max() < 1e-5


def test_speed_is_kept_at_another_frame_rate(grid):
    bpy.context.scene.render.fps = 60
    motion = motion_of(grid, 4)
    bake_motion(grid, motion, Plan(1, 30.0, SHAPE_KEYS, frames_follow_time=True))
    assert np.abs(shown(grid, 1 + 2 * 3) - motion[3]).max() < 1e-5


def test_scene_units(grid):
    bpy.context.scene.unit_settings.scale_length = 0.1
    motion = motion_of(grid, 4)
    bake_shape_keys(grid, 0.1 * motion, 1, 24.0)
    assert np.abs(shown(grid, 4) - motion[3]).max() < 1e-5


def test_moving_object_and_modifiers_do_not_add_to_the_motion(grid):
    grid.keyframe_insert("location", frame=1)
    grid.location.x += 5.0
    grid.keyframe_insert("location", frame=10)
    wave = grid.modifiers.new("Wave", "WAVE")
    motion = motion_of(grid, 8)
    bake_shape_keys(grid, motion, 1, 24.0)
    assert not wave.show_viewport
    assert np.abs(shown(grid, 6) - motion[5]).max() < 1e-5
    clear_bake(grid)
    assert wave.show_viewport and wave.show_render


def test_copy_takes_a_bake_where_modifiers_make_vertices(grid):
    grid.modifiers.new("Subdivision", "SUBSURF").levels = 1
    motion = motion_of(grid, 3)
    with pytest.raises(UsageError, match="25 vertices, the simulation 81"):
        bake_shape_keys(grid, motion, 1, 24.0)
    copy = baked_copy(grid, bpy.context.evaluated_depsgraph_get(), "Grid Simulated", grid.users_collection[0])
    bake_shape_keys(copy, motion, 1, 24.0)
    assert np.abs(shown(copy, 4) - motion[3]).max() < 1e-5


def test_playback_survives_save_and_load(grid, tmp_path):
    motion = motion_of(grid, 6)
    bake_shape_keys(grid, motion, 3, 24.0)
    name = grid.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "baked.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "baked.blend"))
    assert np.abs(shown(bpy.data.objects[name], 8) - motion[5]).max() < 1e-5


def test_what_cannot_be_baked_is_refused_and_left_alone(grid):
    motion = motion_of(grid, 4)
    with pytest.raises(UsageError, match="finite"):
        bake_shape_keys(grid, np.where(np.arange(25)[:, None] == 3, np.nan, motion), 1, 24.0)
    with pytest.raises(UsageError, match="no mesh"):
        bake_shape_keys(bpy.data.objects.new("Empty", None), motion, 1, 24.0)
    grid.shape_key_add(name="Basis")
    with pytest.raises(UsageError, match="shape keys of its own"):
        bake_shape_keys(grid, motion, 1, 24.0)
    assert grid.data.shape_keys is not None and "seeing_wind_bake" not in grid
