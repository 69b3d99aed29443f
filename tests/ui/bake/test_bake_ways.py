"""Every way to keep a motion plays it back, leaves the user's own things alone, and can be taken off again."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from seeing_wind.engine.errors import TakeError, UsageError
from seeing_wind.ui.bake.animation import curves_of
from seeing_wind.ui.bake.motion import bake_motion, clear_bake, is_intact
from seeing_wind.ui.bake.plan import MARK, Plan, mark_of
from seeing_wind.ui.bake.rigid import rigid_fit
from tests.ui.meshes import shown

WAYS = [
    "SHAPE_KEYS",
    "POINT_CACHE",
    pytest.param("ALEMBIC", marks=pytest.mark.skipif(not bpy.app.build_options.alembic, reason="no Alembic")),
    pytest.param("USD", marks=pytest.mark.skipif(not bpy.app.build_options.usd, reason="no USD")),
]
FILES = WAYS[2:]
"""What other programs read."""


@pytest.fixture
def grid(scene) -> bpy.types.Object:
    """A grid of 25 vertices that is placed, turned and scaled, under a parent that is too."""
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    parent.location, parent.rotation_euler, parent.scale = (0.5, -1.0, 0.2), Euler((0.4, 0.0, 0.3)), (1.5, 1.5, 1.5)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4)
    grid = bpy.context.object
    grid.parent = parent
    grid.location, grid.rotation_euler, grid.scale = (1.0, 2.0, 3.0), Euler((0.3, 0.2, -0.5)), (1.0, 2.0, 0.5)
    bpy.context.view_layer.update()
    return grid


def bending(obj: bpy.types.Object, frames: int = 12) -> np.ndarray:
    """A random motion (frames + 1, V, 3) that starts from the mesh."""
    rest = shown(obj, 1)
    return rest + np.cumsum(
        np.random.default_rng(0).normal(scale=0.05, size=(frames + 1, *rest.shape)) * (np.arange(frames + 1) > 0)[:, None, None], axis=0
    )


def tumbling(obj: bpy.types.Object, frames: int = 24) -> np.ndarray:
    """A rigid motion (frames + 1, V, 3) of more than one full turn."""
    rest = shown(obj, 1)
    turns = [np.array(Matrix.Rotation(0.4 * t, 3, "X") @ Matrix.Rotation(-0.25 * t, 3, "Z")) for t in range(frames + 1)]
    centre = rest.mean(axis=0)
    return np.stack([(rest - centre) @ turn.T + centre + [0.1 * t, 0.0, -0.01 * t**2] for t, turn in enumerate(turns)])


def plan(way: str, tmp_path: Path, **more) -> Plan:
    return Plan(7, 24.0, way, cache=tmp_path / "bodies" / "Ein Körper", **more)


@pytest.mark.parametrize("way", WAYS)
def test_every_way_plays_back_every_frame_and_is_cleared(grid, tmp_path, way) -> None:
    before, motion = shown(grid, 1), bending(grid)
    baked = bake_motion(grid, motion, plan(way, tmp_path))
    assert baked.way == way and baked.frames == 13 and is_intact(grid)
    for frame in range(13):
        assert np.abs(shown(grid, 7 + frame) - motion[frame]).max() < 1e-5
    assert np.abs(shown(grid, 1) - motion[0]).max() < 1e-5 and np.abs(shown(grid, 40) - motion[-1]).max() < 1e-5
    assert clear_bake(grid) and not clear_bake(grid)
    assert np.abs(shown(grid, 9) - before).max() < 1e-6
    assert not grid.modifiers and grid.data.shape_keys is None and not bpy.data.actions and not bpy.data.cache_files


@pytest.mark.parametrize("way", ["SHAPE_KEYS", "POINT_CACHE"])
def test_the_keyframes_can_be_edited(grid, tmp_path, way) -> None:
    """Twice as slow: the last keyframe is moved by hand, as in the Graph Editor."""
    motion = bending(grid)
    bake_motion(grid, motion, plan(way, tmp_path))
    curve = curves_of(grid if way == "POINT_CACHE" else grid.data.shape_keys)[0]
    curve.keyframe_points[-1].co.x = 7 + 24
    curve.update()
    assert np.abs(shown(grid, 7 + 10) - motion[5]).max() < 1e-5


def test_a_point_cache_is_a_pc2_file(grid, tmp_path) -> None:
    motion = bending(grid, 4)
    bake_motion(grid, motion, plan("POINT_CACHE", tmp_path))
    (path,) = (tmp_path / "bodies").glob("*.pc2")
    data = path.read_bytes()
    assert struct.unpack("<12siiffi", data[:32]) == (b"POINTCACHE2\0", 1, 25, 0.0, 1.0, 5)
    local = np.frombuffer(data[32:], "<f4").reshape(5, 25, 3)
    world = np.array(grid.matrix_world)
    np.testing.assert_allclose(local @ world[:3, :3].T + world[:3, 3], motion, atol=1e-5)


@pytest.mark.parametrize("way", ["SHAPE_KEYS", "POINT_CACHE"])
@pytest.mark.parametrize("name", ["plain", "ein Wind è 风"])
def test_playback_survives_save_and_load_at_any_path(grid, tmp_path, way, name) -> None:
    folder = tmp_path / name
    folder.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{name}.blend"))
    motion, obj = bending(grid), grid.name
    bake_motion(grid, motion, plan(way, folder))
    bpy.ops.wm.save_mainfile()
    moved = tmp_path / "moved"
    folder.rename(moved)  # the file and its caches together, to another computer
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(moved / f"{name}.blend"))
    for frame in (7, 12, 19):
        assert np.abs(shown(bpy.data.objects[obj], frame) - motion[frame - 7]).max() < 1e-5


def test_the_nearest_rigid_motion_is_found_and_its_residual_measured(grid) -> None:
    motion = tumbling(grid)
    fit = rigid_fit(motion)
    assert fit.residual < 1e-5
    again = np.einsum("tij,vj->tvi", fit.rotation, motion[0]) + fit.translation[:, None]
    np.testing.assert_allclose(again, motion, atol=1e-5)
    np.testing.assert_allclose(np.linalg.det(fit.rotation), 1.0, atol=1e-9)
    motion[5, 3] += [0.0, 0.0, 0.02]
    assert rigid_fit(motion).residual == pytest.approx(0.02, rel=0.2)


def test_what_stays_rigid_gets_location_and_rotation(grid, tmp_path) -> None:
    motion, before = tumbling(grid), (grid.rotation_mode, tuple(grid.location), tuple(grid.rotation_euler))
    assert bake_motion(grid, motion, plan("AUTO", tmp_path)).way == "TRANSFORM"
    assert {curve.data_path for curve in curves_of(grid)} == {"location", "rotation_quaternion"} and grid.data.shape_keys is None
    for frame in range(25):
        assert np.abs(shown(grid, 7 + frame) - motion[frame]).max() < 2e-5
    between = shown(grid, 7 + 9.5)  # the curves take the short way round between frames
    assert np.abs(between - 0.5 * (motion[9] + motion[10])).max() < 0.1
    assert clear_bake(grid) and (grid.rotation_mode, tuple(grid.location), tuple(grid.rotation_euler)) == before
    assert grid.animation_data is None and np.abs(shown(grid, 9) - motion[0]).max() < 1e-6


def test_a_mirrored_object_stays_where_it_is(tmp_path) -> None:
    """Three corners of a triangle of three lengths, on an object with one negative scale."""
    mesh = bpy.data.meshes.new("Mirrored")
    mesh.from_pydata([(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.2, 0.1)], [], [(0, 1, 2)])
    obj = bpy.data.objects.new("Mirrored", mesh)
    bpy.context.scene.collection.objects.link(obj)
    obj.scale, obj.rotation_euler = (-1.0, 1.5, 1.0), (0.4, -0.2, 0.7)
    bpy.context.view_layer.update()
    motion = tumbling(obj)
    assert bake_motion(obj, motion, plan("AUTO", tmp_path)).way == "TRANSFORM"
    for frame in (0, 9, 24):
        assert np.abs(shown(obj, 7 + frame) - motion[frame]).max() < 2e-5


def test_what_bends_or_moves_already_does_not(grid, tmp_path) -> None:
    assert bake_motion(grid, bending(grid), plan("AUTO", tmp_path)).way == "SHAPE_KEYS"
    clear_bake(grid)
    with pytest.raises(UsageError, match="bends by"):
        bake_motion(grid, bending(grid), plan("TRANSFORM", tmp_path))
    motion = tumbling(grid)
    grid.constraints.new("COPY_LOCATION")
    assert bake_motion(grid, motion, plan("AUTO", tmp_path)).way == "SHAPE_KEYS"
    with pytest.raises(UsageError, match="constraints"):
        bake_motion(grid, motion, plan("TRANSFORM", tmp_path))


def test_a_very_large_motion_goes_to_a_point_cache(grid, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("seeing_wind.ui.bake.motion.LARGE", 25 * 13 * 12 - 1)
    assert bake_motion(grid, bending(grid), plan("AUTO", tmp_path)).way == "POINT_CACHE"
    clear_bake(grid)
    assert bake_motion(grid, bending(grid), Plan(7, 24.0)).way == "SHAPE_KEYS", "there is no place for a file"


@pytest.mark.parametrize("way", ["SHAPE_KEYS", "POINT_CACHE", "TRANSFORM"])
def test_a_range_of_frames(grid, tmp_path, way) -> None:
    motion = tumbling(grid)
    assert bake_motion(grid, motion, plan(way, tmp_path, frames=(10, 15))).frames == 6
    for frame, clip_frame in ((7, 3), (10, 3), (13, 6), (15, 8), (31, 8)):
        assert np.abs(shown(grid, frame) - motion[clip_frame]).max() < 2e-5
    with pytest.raises(UsageError, match="hold 1 of the simulated frames"):
        bake_motion(grid, motion, plan(way, tmp_path, frames=(1, 7)))


@pytest.mark.parametrize("way", ["SHAPE_KEYS", "POINT_CACHE", "TRANSFORM"])
def test_the_same_motion_is_not_baked_twice_and_edited_keyframes_stay(grid, tmp_path, way) -> None:
    motion = tumbling(grid)
    first = plan(way, tmp_path, stamp="one")
    assert not bake_motion(grid, motion, first).kept
    owner = grid.data.shape_keys if way == "SHAPE_KEYS" else grid
    curves_of(owner)[0].keyframe_points[-1].co.x = 99.0
    assert bake_motion(grid, motion, first).kept
    assert curves_of(owner)[0].keyframe_points[-1].co.x == 99.0
    assert not bake_motion(grid, motion, plan(way, tmp_path, stamp="two")).kept
    if way == "POINT_CACHE":
        for path in (tmp_path / "bodies").glob("*.pc2"):
            path.unlink()
        assert not bake_motion(grid, motion, plan(way, tmp_path, stamp="two")).kept, "its file is gone"


def test_subdivision_and_materials_stay_on_top(grid, tmp_path) -> None:
    motion = bending(grid)
    grid.data.materials.append(bpy.data.materials.new("Silk"))
    subdivision = grid.modifiers.new("Subdivision", "SUBSURF")
    for way in ("SHAPE_KEYS", "POINT_CACHE"):
        bake_motion(grid, motion, plan(way, tmp_path))
        assert subdivision.show_viewport and len(shown(grid, 10)) == 81 and grid.modifiers[-1] == subdivision
        subdivision.show_viewport = False
        assert np.abs(shown(grid, 10) - motion[3]).max() < 1e-5
        subdivision.show_viewport = True
    solidify = grid.modifiers.new("Solidify", "SOLIDIFY")
    bake_motion(grid, motion, plan("SHAPE_KEYS", tmp_path))
    assert solidify.show_viewport, "what was added to a baked object acts on top of the motion"
    assert grid.data.materials[0].name == "Silk"


def test_keyframes_of_the_user_s_own_are_left_alone(grid, tmp_path) -> None:
    grid["heat"] = 0.0
    grid.keyframe_insert('["heat"]', frame=1)
    motion = tumbling(grid)
    for way in ("TRANSFORM", "POINT_CACHE"):
        bake_motion(grid, motion, plan(way, tmp_path))
        clear_bake(grid)
        assert [curve.data_path for curve in curves_of(grid)] == ['["heat"]']


def test_a_bake_of_an_older_version_is_cleared(grid) -> None:
    bend = grid.modifiers.new("Bend", "SIMPLE_DEFORM")
    bake_motion(grid, bending(grid), Plan(1, 24.0, "SHAPE_KEYS"))
    assert json.loads(grid[MARK])["slept"] == [["Bend", True, True]]
    grid[MARK] = "Bend"
    assert mark_of(grid)["way"] == "SHAPE_KEYS" and clear_bake(grid)
    assert bend.show_viewport and bend.show_render and grid.data.shape_keys is None


@pytest.mark.parametrize("former", ["SHAPE_KEYS", "POINT_CACHE", "TRANSFORM"])
def test_a_bake_that_cannot_be_written_leaves_the_former_one(grid, tmp_path, former) -> None:
    grid.modifiers.new("Bend", "SIMPLE_DEFORM")
    motion = tumbling(grid, 12) if former == "TRANSFORM" else bending(grid)
    bake_motion(grid, motion, plan(former, tmp_path))
    frames = (7, 12, 19)
    before = [shown(grid, frame) for frame in frames]
    (tmp_path / "a file").write_text("no folder")
    with pytest.raises(TakeError, match="Cannot write"):
        bake_motion(grid, motion, plan("POINT_CACHE", tmp_path / "a file"))
    assert is_intact(grid) and mark_of(grid)["way"] == former
    np.testing.assert_allclose([shown(grid, frame) for frame in frames], before, atol=1e-6)
    assert clear_bake(grid) and grid.modifiers["Bend"].show_viewport and len(grid.modifiers) == 1


def test_modifiers_wake_when_a_file_cannot_be_written(grid, tmp_path, monkeypatch) -> None:
    def fail(*_: object) -> None:
        raise UsageError("no Alembic", "none")

    monkeypatch.setattr("seeing_wind.ui.bake.cache.bake_file", fail)
    monkeypatch.setattr("seeing_wind.ui.bake.motion.way_for", lambda *_: "ALEMBIC")
    grid.modifiers.new("Bend", "SIMPLE_DEFORM")
    with pytest.raises(UsageError):
        bake_motion(grid, bending(grid), plan("ALEMBIC", tmp_path))
    assert grid.modifiers["Bend"].show_viewport and mark_of(grid) is None


@pytest.mark.parametrize("way", FILES)
def test_a_file_for_other_programs_that_cannot_be_written_is_told(grid, tmp_path, way) -> None:
    (tmp_path / "bodies").write_text("no folder")
    objects, meshes = len(bpy.data.objects), len(bpy.data.meshes)
    with pytest.raises(TakeError, match="Cannot write .*Körper"):
        bake_motion(grid, bending(grid), plan(way, tmp_path))
    assert mark_of(grid) is None and (len(bpy.data.objects), len(bpy.data.meshes)) == (objects, meshes)


@pytest.mark.parametrize("way", FILES)
def test_a_file_for_other_programs_is_kept_for_an_undo_and_leaves_the_scene_as_it_was(grid, scene, tmp_path, way) -> None:
    scene.frame_start, scene.frame_end, scene.use_preview_range, scene.frame_preview_end = 3, 5, True, 9
    motions = [bending(grid), 2.0 * bending(grid)]
    for motion in (*motions, motions[0]):
        bake_motion(grid, motion, plan(way, tmp_path))
        assert np.abs(shown(grid, 13) - motion[6]).max() < 1e-5, "the one of its own content is played"
    assert len([path for path in (tmp_path / "bodies").iterdir() if not path.name.startswith(".")]) == 2
    assert (scene.frame_start, scene.frame_end, scene.frame_preview_end) == (3, 5, 9)
    assert grid.select_get() and bpy.context.view_layer.objects.active == grid
    assert not [obj.name for obj in bpy.data.objects if obj.name.startswith("SeeingWind")]


@pytest.mark.skipif(not bpy.app.build_options.usd, reason="no USD")
def test_a_usd_file_cannot_begin_before_frame_zero(grid, scene, tmp_path) -> None:
    scene.frame_start, scene.frame_end = 3, 5
    with pytest.raises(UsageError, match="cannot begin at frame -20"):
        bake_motion(grid, bending(grid), Plan(-20, 24.0, "USD", cache=tmp_path / "body"))
    assert (scene.frame_start, scene.frame_end) == (3, 5) and mark_of(grid) is None
