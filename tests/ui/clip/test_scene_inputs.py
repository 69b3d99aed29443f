"""What a scene asks of the engine: its clip, proxy, gravity, and all of it in one request."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.engine.conventions import PANEL_INPUTS
from seeing_wind.engine.errors import ObjectError, UsageError
from seeing_wind.ui.clip.clip_scene import setup_clip_scene
from seeing_wind.ui.clip.frame_on_screen import box_in_frame, box_on_screen
from seeing_wind.ui.clip.inputs.clip_files import as_pattern
from seeing_wind.ui.clip.inputs.scene_inputs import scene_inputs
from seeing_wind.ui.clip.options import clip_options
from seeing_wind.ui.recover.request import RecoverRequest, scene_values
from tests.ui.clip.inputs import FRAMES, HEIGHT, WIDTH, camera, spline, with_box, written


@pytest.mark.parametrize("unit", [1.0, 0.1])
def test_a_proxy_gives_the_depth_of_each_pixel(settings, tmp_path, unit) -> None:
    """A ball: depth along the view axis against the sphere's equation, outline where the discriminant says."""
    scene, seen = bpy.context.scene, camera(0.0)
    scene.unit_settings.scale_length = unit
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(seen), 24.0, 0, FRAMES - 1, 1)
    centre = seen.unproject(np.array([50.0, 30.0]), 2.5)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.5 / unit, location=centre / unit, segments=96, ring_count=48)
    settings.proxy, settings.scale_mode, settings.object_mode = bpy.context.object, "PROXY", "PROXY"
    files = written(settings, tmp_path)
    assert "camera" in files and "mask" not in files, "the depth file is the outline as well"
    depth = np.load(files["depth"])
    assert depth.shape == (HEIGHT, WIDTH) and depth.dtype == np.float32
    column, row = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack([(column - seen.cx) / seen.fx, (row - seen.cy) / seen.fy, np.ones(column.shape)], axis=-1)
    middle = np.linalg.inv(seen.pose(0)) @ [*centre, 1.0]
    along, square = rays @ middle[:3], (rays * rays).sum(axis=-1)
    discriminant = along**2 - square * (middle[:3] @ middle[:3] - 0.25)
    expected = (along - np.sqrt(np.maximum(discriminant, 0.0))) / square
    clear = np.abs(discriminant) > 0.02
    np.testing.assert_array_equal(np.isfinite(depth)[clear], (discriminant > 0)[clear])
    hit = np.isfinite(depth) & clear
    assert hit.sum() > 500 and np.abs(depth - expected)[hit].max() < 3e-3
    settings.scale_mode = "DISTANCE"
    with pytest.raises(ObjectError, match="does not give its depth"):
        scene_inputs(scene)


def test_what_is_missing_is_told(settings, tmp_path) -> None:
    scene = bpy.context.scene
    for change, error, says in (
        ({"object_mode": "PLANE"}, ObjectError, "no plane track"),
        ({"use_tracks": True, "object_mode": "BOX"}, ObjectError, "no tracks"),
        ({"use_tracks": False, "scale_mode": "PROXY"}, UsageError, "No proxy"),
        ({"scale_mode": "DISTANCE", "camera_mode": "SOLVE"}, UsageError, "no camera solve"),
        ({"camera_mode": "SCENE"}, UsageError, "no camera"),
    ):
        for name, value in change.items():
            setattr(settings, name, value)
        with pytest.raises(error, match=says):
            scene_inputs(scene)


def test_gravity_is_the_scene_s_in_its_units(settings) -> None:
    scene = bpy.context.scene

    def gravity() -> tuple[float, ...]:
        return RecoverRequest.of(scene).recover.gravity

    with_box(settings)
    assert gravity() == (0.0, 0.0, -9.81)
    scene.unit_settings.scale_length = 0.1
    assert gravity()[2] == pytest.approx(-0.981, rel=1e-6), "what Blender's own panel shows then"
    scene.unit_settings.system = "NONE"
    assert gravity() == (0.0, 0.0, -9.81)


def test_one_request_gives_options_digest_and_files(settings, tmp_path) -> None:
    scene, mask = bpy.context.scene, bpy.data.masks.new("Leaf")
    spline(mask.layers.new(name="Outer"), [(20.5, 10.5), (60.5, 10.5), (60.5, 40.5), (20.5, 40.5)])
    settings.take, settings.object_mode, settings.mask_data = str(tmp_path / "one.take"), "BLENDER_MASK", mask
    request = RecoverRequest.of(scene)
    file = tmp_path / "one.take" / PANEL_INPUTS / "mask.png"
    words = request.arguments()
    assert words[words.index("--mask") + 1] == str(file) and request.files() == [Path(settings.clip)] and not file.exists()
    with pytest.raises(dataclasses.FrozenInstanceError):
        request.clip = ""
    request.write_inputs()
    assert file.is_file() and RecoverRequest.of(scene) == request, "the file is no setting"
    settings.take = str(tmp_path / "moved.take")
    assert RecoverRequest.of(scene).digest() == request.digest(), "nor is its place"
    mask.layers[0].splines[0].points[0].co.x += 0.05
    assert RecoverRequest.of(scene).digest() != request.digest()
    settings.object_mode = "BOX"
    with pytest.raises(ObjectError, match="No box"):
        RecoverRequest.of(scene)


def test_a_sequence_of_frames_plays_at_the_scene_s_rate(settings, tmp_path) -> None:
    assert as_pattern("/a/shot_0007.png") == "/a/shot_%04d.png" and as_pattern("/a/clip7.mp4") == "/a/clip7.mp4"
    first = tmp_path / "wind è_001.png"
    first.write_bytes(b"")
    settings.clip = str(first)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 30, 1.001
    assert clip_options(settings, scene_values(settings))[:2] == (str(tmp_path / "wind è_%03d.png"), {"fps": 29.97003, "frames": None})


def test_boxes_on_the_screen_and_in_the_frame() -> None:
    corners = np.array([[100.0, 50.0], [580.0, 370.0]])
    box = box_in_frame(corners, np.array([205.0, 300.0]), np.array([400.0, 100.0]), WIDTH, HEIGHT)
    assert box == (20.5, 13.5, 59.5, 53.5), "five screen pixels to one of the clip"
    np.testing.assert_allclose(box_on_screen(corners, box, WIDTH, HEIGHT), [[205.0, 100.0], [400.0, 300.0]], atol=0.5)
    outside = box_in_frame(corners, np.array([0.0, 0.0]), np.array([900.0, 900.0]), WIDTH, HEIGHT)
    assert outside == (0.0, 0.0, WIDTH - 1.0, HEIGHT - 1.0)


@pytest.mark.parametrize("active", [True, False])
def test_a_clip_linked_from_a_file_of_another_folder_is_chosen(settings, video, tmp_path, active: bool) -> None:
    (tmp_path / "library").mkdir()
    moved, library = tmp_path / "library" / "own.mp4", tmp_path / "library" / "clips.blend"
    moved.write_bytes(video.read_bytes())
    clip = bpy.data.movieclips.load(str(moved))
    clip.filepath = "//own.mp4"
    bpy.data.libraries.write(str(library), {clip}, path_remap="NONE")
    bpy.data.movieclips.remove(clip)
    with bpy.data.libraries.load(str(library), link=True) as (_, into):
        into.movieclips = ["own.mp4"]
    scene, linked = bpy.context.scene, into.movieclips[0]
    scene.active_clip = linked
    assert linked.library is not None and linked.filepath == "//own.mp4"
    assert bpy.ops.seeing_wind.choose_clip(**({"active": True} if active else {"filepath": str(moved)})) == {"FINISHED"}
    assert settings.clip == str(moved) and list(bpy.data.movieclips) == [linked]
    assert scene.camera.data.background_images[0].clip == linked and scene.frame_start == linked.frame_start


def test_choosing_a_clip_shows_it_and_keeps_its_place_in_time(settings, video) -> None:
    scene = bpy.context.scene
    settings.clip = ""
    with pytest.raises(RuntimeError, match="no active movie clip"):
        bpy.ops.seeing_wind.choose_clip(active=True)
    with pytest.raises(RuntimeError, match="no file .*such.mp4"):
        bpy.ops.seeing_wind.choose_clip(filepath="/no/such.mp4")
    assert settings.clip == ""
    scene.active_clip = bpy.data.movieclips.load(str(video))
    scene.active_clip.frame_start = 101
    assert bpy.ops.seeing_wind.choose_clip(active=True) == {"FINISHED"}
    assert settings.frame_start == 101 and scene.active_clip.frame_start == 101 and scene.frame_start == 101
    assert scene.camera is not None and scene.camera.data.background_images[0].clip == scene.active_clip
    assert (scene.render.resolution_x, scene.render.fps, len(bpy.data.movieclips)) == (WIDTH, 24, 1)
    assert bpy.ops.seeing_wind.draw_box(box=(20.0, 20.0, 44.0, 44.0)) == {"FINISHED"} and settings.object_mode == "BOX"
    with pytest.raises(RuntimeError, match="too small"):
        bpy.ops.seeing_wind.draw_box(box=(20.0, 20.0, 20.0, 44.0))
