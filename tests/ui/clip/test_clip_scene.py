"""The clip's scene: Blender's camera against the engine's, the clip's frames at their frames, the recovered object's pixels."""

from __future__ import annotations

import dataclasses
import math

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Vector

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import ClipError, UsageError
from seeing_wind.engine.records import Camera
from seeing_wind.ui.clip.clip_scene import create_recovered_object, setup_clip_scene

FRAMES = 5


@pytest.fixture
def clip(tmp_path):
    """A clip of 12 grey frames, 64 x 48; frame k has the value 10 + 20 k."""
    cv2 = pytest.importorskip("cv2")
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 24, (64, 48))
    for frame in range(12):
        writer.write(np.full((48, 64, 3), 10 + 20 * frame, np.uint8))
    writer.release()
    return path


def turned(seed: float) -> np.ndarray:
    """A camera pose near the front view."""
    pose = front_view(3.0)
    pose[:3, :3] = np.array(Euler((0.1 * seed, -0.2, 0.15 * seed)).to_matrix()) @ pose[:3, :3]
    pose[:3, 3] += [0.3 * seed, 0.1, 0.2]
    return pose


CAMERAS = {
    "plain": Camera(640, 360, 700.0, 700.0, 319.5, 179.5, front_view(3.0)),
    "off centre": Camera(640, 360, 700.0, 700.0, 287.3, 203.9, turned(1.0)),
    "upright": Camera(360, 640, 500.0, 500.0, 170.0, 330.0, turned(-0.5)),
    "wide pixels": Camera(480, 270, 400.0, 500.0, 250.0, 120.0, turned(0.4)),
    "tall pixels": Camera(480, 270, 500.0, 400.0, 230.0, 140.0, turned(0.7)),
    "moving": Camera(640, 360, 650.0, 650.0, 310.0, 185.0, np.stack([turned(0.3 * k) for k in range(FRAMES + 1)])),
}


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_blender_s_camera_sees_what_the_engine_s_does(scene, clip, name, unit):
    camera = CAMERAS[name]
    scene.unit_settings.scale_length = unit
    obj = setup_clip_scene(scene, clip, dataclasses.asdict(camera), 24.0, 0, FRAMES, frame_start=3)
    points = np.random.default_rng(0).uniform([-0.8, -0.5, -0.5], [0.8, 0.5, 0.5], (30, 3))
    for frame in (0, 2, FRAMES):
        scene.frame_set(3 + frame)
        bpy.context.view_layer.update()
        expected, depth = camera.project(points, frame)
        seen = np.array([world_to_camera_view(scene, obj, Vector(point / unit))[:] for point in points])
        # Blender's frame runs from 0 to 1, bottom to top; its pixel (0, 0) covers -0.5..0.5 in ours
        pixels = np.stack([seen[:, 0] * camera.width - 0.5, (1.0 - seen[:, 1]) * camera.height - 0.5], axis=-1)
        assert np.abs(pixels - expected).max() < 0.01
        assert np.allclose(seen[:, 2] * unit, depth, rtol=1e-5)


def test_scene_takes_the_clip_s_time_and_size(scene, clip):
    obj = setup_clip_scene(scene, clip, dataclasses.asdict(CAMERAS["plain"]), 30.19, 4, FRAMES)
    assert math.isclose(scene.render.fps / scene.render.fps_base, 30.19, rel_tol=1e-6)
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (1, 1 + FRAMES, 1)
    assert (scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage) == (640, 360, 100)
    assert scene.camera == obj and obj.data.show_background_images and obj.data.background_images[0].clip == scene.active_clip
    again = setup_clip_scene(scene, clip, dataclasses.asdict(CAMERAS["moving"]), 24.0, 0, FRAMES)
    assert again == obj and len(bpy.data.cameras) == 1 and len(bpy.data.movieclips) == 1 and len(obj.data.background_images) == 1


@pytest.mark.skipif(bpy.app.version >= (5, 0), reason="the compositor is set up in Blender 4's way")
def test_clip_s_frames_stand_at_their_frames(scene, clip, tmp_path):
    """Rendered through the compositor: scene frame 7 shows clip frame 0 of the take, which is clip frame 3 of the file."""
    setup_clip_scene(scene, clip, dataclasses.asdict(CAMERAS["plain"]), 24.0, 3, FRAMES, frame_start=7)
    scene.use_nodes = True
    nodes = scene.node_tree.nodes
    nodes.clear()
    source, result = nodes.new("CompositorNodeMovieClip"), nodes.new("CompositorNodeComposite")
    source.clip = scene.active_clip
    scene.node_tree.links.new(source.outputs["Image"], result.inputs["Image"])
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    scene.render.image_settings.file_format = "PNG"
    for frame, clip_frame in ((7, 3), (10, 6)):
        scene.frame_set(frame)
        scene.render.filepath = str(tmp_path / f"frame_{frame}.png")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        image.colorspace_settings.name = "Non-Color"
        assert 255.0 * image.pixels[4 * 1000] == pytest.approx(10 + 20 * clip_frame, abs=4.0)


def test_recovered_object_wears_the_frame(scene):
    frame = np.random.default_rng(0).integers(0, 255, (6, 8, 3), dtype=np.uint8)
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    uv = np.array([[0.1, 0.2], [0.9, 0.2], [0.9, 0.8], [0.1, 0.8]])
    obj = create_recovered_object(scene, "Leaf", vertices, np.array([[0, 1, 2], [0, 2, 3]]), uv, frame)
    mesh = obj.data
    found = {loop.vertex_index: mesh.uv_layers.active.uv[loop.index].vector[:] for loop in mesh.loops}
    assert np.allclose([found[k] for k in range(4)], uv, atol=1e-6)
    texture = next(node for node in mesh.materials[0].node_tree.nodes if node.type == "TEX_IMAGE")
    pixels = np.array(texture.image.pixels[:]).reshape(6, 8, 4)
    assert np.allclose(255.0 * pixels[::-1, :, :3], frame, atol=0.6) and texture.image.packed_file is not None


def test_recovered_object_covers_its_own_pixels_in_a_render(scene, clip, tmp_path):
    """A sheet textured with the frame and rendered through the camera is the frame again, to a fraction of a pixel."""
    width, height = 96, 64
    camera = Camera(width, height, 100.0, 100.0, 44.0, 35.5, turned(0.4))
    row, column = np.mgrid[0:height, 0:width]
    frame = np.stack([4 * (row % 50) + 20, 2 * column + 20, 100 + 60 * np.sin(0.2 * column + 0.1 * row)], axis=-1).astype(np.uint8)
    # a sheet a little larger than the frame, as fine as an affine texture needs under perspective
    px, py = np.meshgrid(np.linspace(-8.0, width + 8.0, 40), np.linspace(-8.0, height + 8.0, 30))
    vertices = camera.unproject(np.stack([px, py], axis=-1), 2.5 + 0.004 * px).reshape(-1, 3)
    uv = np.stack([(px + 0.5) / width, 1.0 - (py + 0.5) / height], axis=-1).reshape(-1, 2)
    corner = np.arange(30 * 40).reshape(30, 40)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[:-1, 1:].ravel(), corner[1:, 1:].ravel(), corner[1:, :-1].ravel()
    create_recovered_object(scene, "Sheet", vertices, np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)]), uv, frame)
    setup_clip_scene(scene, clip, dataclasses.asdict(camera), 24.0, 0, FRAMES)
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 16, False
    scene.render.image_settings.file_format, scene.render.filepath = "PNG", str(tmp_path / "sheet.png")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    image.colorspace_settings.name = "Non-Color"
    rendered = 255.0 * np.array(image.pixels[:]).reshape(height, width, -1)[::-1, :, :3]
    smooth = (row % 50 > 2) & (row % 50 < 47) & (row > 2) & (row < height - 3) & (column > 2) & (column < width - 3)
    difference = (rendered - frame)[smooth]
    # the first two channels change by 4 and 2 per pixel: their mean differences are shifts in y and x
    assert abs(difference[:, 0].mean()) < 0.4 and abs(difference[:, 1].mean()) < 0.3
    assert np.abs(difference).mean() < 3.0


def test_bad_clip_and_camera_are_refused(scene, clip, tmp_path):
    camera = dataclasses.asdict(CAMERAS["plain"])
    with pytest.raises(ClipError, match="no file"):
        setup_clip_scene(scene, tmp_path / "none.mp4", camera, 24.0, 0, FRAMES)
    text = tmp_path / "text.mp4"
    text.write_text("no video")
    with pytest.raises(ClipError):
        setup_clip_scene(scene, text, camera, 24.0, 0, FRAMES)
    with pytest.raises(UsageError, match="lacks fx"):
        setup_clip_scene(scene, clip, {key: value for key, value in camera.items() if key != "fx"}, 24.0, 0, FRAMES)
    with pytest.raises(UsageError, match="poses"):
        setup_clip_scene(scene, clip, dataclasses.asdict(CAMERAS["moving"]), 24.0, 0, FRAMES + 2)
    assert scene.camera is None and not bpy.data.movieclips


def test_a_clip_chosen_in_a_saved_file_is_named_beside_it_and_nothing_stands_in_front(workplace, stand_in, tmp_path):
    bpy.ops.wm.read_factory_settings(use_empty=False)
    bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "chosen.blend"))
    assert bpy.ops.seeing_wind.choose_clip(filepath=str(workplace / "clip.mp4")) == {"FINISHED"}
    scene = bpy.context.scene
    assert scene.seeing_wind.clip == "//clip.mp4" and scene.objects["Cube"].hide_get() and scene.objects["Cube"].hide_render
    assert scene.view_layers[0].objects.active is None, "what is hidden is not worked on"
    assert scene.camera.data.display_size < 0.5
    # a shot of the user's own is left alone
    bpy.ops.wm.read_factory_settings(use_empty=False)
    scene = bpy.context.scene
    scene.render.fps = 50
    bpy.ops.seeing_wind.choose_clip(filepath=str(workplace / "clip.mp4"))
    assert not scene.objects["Cube"].hide_get() and not scene.objects["Cube"].hide_render


def test_the_field_of_view_can_be_given_as_a_focal_length(scene, stand_in):
    settings = scene.seeing_wind
    settings.focal_length = 18.0
    assert settings.fov == pytest.approx(90.0, abs=1e-3)
    settings.fov = 2.0 * np.degrees(np.arctan(18.0 / 50.0))
    assert settings.focal_length == pytest.approx(50.0, rel=1e-5)
