"""A shot that is there already: Choose Clip and Reload leave it alone unless the user says so, and a clip stands where the user put it."""

from __future__ import annotations

import shutil

import bpy
import pytest

from seeing_wind.ui.recover.shown import said_of_view
from tests.ui.jobs import recover

pytestmark = pytest.mark.usefixtures("stand_in")


def shot(scene: bpy.types.Scene) -> tuple:
    """What belongs to the user's shot."""
    render = scene.render
    size = (render.resolution_x, render.resolution_y, render.pixel_aspect_x)
    looks = (scene.view_settings.view_transform, render.film_transparent, scene.camera.name if scene.camera else "")
    return (render.fps, render.fps_base, scene.frame_start, scene.frame_end, scene.frame_current, *size, *looks)


@pytest.fixture
def own(scene) -> bpy.types.Scene:
    """The shot of the review: 24 frames a second, 1920x1080, frames 1001 to 1100, a camera of the user's."""
    camera = bpy.data.objects.new("Main Camera", bpy.data.cameras.new("Main Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.frame_start, scene.frame_end = 1001, 1100
    scene.frame_set(1050)
    return scene


def test_a_shot_that_is_there_is_left_alone(own, workplace) -> None:
    before = shot(own)
    bpy.ops.seeing_wind.choose_clip(filepath=str(workplace / "clip.mp4"))
    assert shot(own) == before
    recover(workplace)
    bpy.ops.seeing_wind.build_scene()
    assert shot(own) == before
    # our camera is there all the same, with the clip behind it
    camera = own.seeing_wind.camera_object
    assert camera != own.camera and camera.data.background_images[0].clip == own.active_clip
    assert not len(own.camera.data.background_images)


def test_the_user_says_what_is_to_be_as_the_clips(own, workplace, capfd) -> None:
    recover(workplace)
    bpy.ops.seeing_wind.match_scene(parts={"SIZE", "RANGE"})
    assert "The scene keeps its own " in (said := capfd.readouterr().out) and "(Match Scene changes that)" in said
    assert (own.render.resolution_x, own.render.resolution_y) == (96, 64) and (own.frame_start, own.frame_end) == (1, 13)
    assert own.camera.name == "Main Camera" and own.view_settings.view_transform != "Standard"
    bpy.ops.seeing_wind.match_scene(parts={"CAMERA", "VIEW"})
    own.render.resolution_x = 500
    bpy.ops.seeing_wind.build_scene()
    assert own.camera == own.seeing_wind.camera_object and own.view_settings.view_transform == "Standard"
    assert own.render.resolution_x == 500, "no longer as the clip's"


@pytest.mark.parametrize("empty", [True, False])
def test_a_new_file_is_set_up_silently(workplace, empty: bool) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=empty)
    scene = bpy.context.scene
    bpy.ops.seeing_wind.choose_clip(filepath=str(workplace / "clip.mp4"))
    assert (scene.render.resolution_x, scene.frame_end, scene.view_settings.view_transform) == (96, 13, "Standard")
    assert scene.camera.get("seeing_wind_camera")


def test_a_scene_without_a_camera_gets_one(scene, workplace) -> None:
    scene.frame_start = 1001
    bpy.ops.seeing_wind.choose_clip(filepath=str(workplace / "clip.mp4"))
    assert scene.camera.get("seeing_wind_camera") and scene.frame_start == 1001


@pytest.mark.parametrize(("start", "offset", "expected"), [(101, 0, 105), (1, 0, 5), (101, 2, 103)])
def test_a_clip_stands_where_the_user_put_it(scene, workplace, start: int, offset: int, expected: int) -> None:
    """Frame 4 of a clip that begins at `start`; relative and absolute paths are the same clip."""
    bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "shot.blend"))
    clip = bpy.data.movieclips.load("//clip.mp4")
    clip.frame_start, clip.frame_offset = start, offset
    recover(workplace, frames=(4, 12))
    assert len(bpy.data.movieclips) == 1 and (clip.frame_start, clip.frame_offset) == (start, offset)
    assert scene.seeing_wind.frame_start == expected == scene.frame_start
    bpy.ops.seeing_wind.build_scene()
    assert len(bpy.data.movieclips) == 1 and scene.seeing_wind.field_object["seeing_wind_frame_start"] == expected


def test_a_clip_outside_the_shots_range_is_told(own, workplace) -> None:
    recover(workplace)
    (note,) = said_of_view(own)
    assert "at frames 1 to 13" in note and "1001 to 1100" in note
    own.seeing_wind.frame_start = 1001
    bpy.ops.seeing_wind.build_scene()
    assert not said_of_view(own)


def test_a_file_that_was_saved_first_can_be_moved_with_its_clip(scene, workplace, tmp_path) -> None:
    home, later = tmp_path / "here", tmp_path / "there"
    home.mkdir()
    shutil.copy(workplace / "clip.mp4", home / "clip.mp4")
    bpy.ops.wm.save_as_mainfile(filepath=str(home / "shot.blend"))
    assert bpy.ops.seeing_wind.choose_clip(filepath=str(home / "clip.mp4")) == {"FINISHED"}
    bpy.ops.wm.save_mainfile()
    home.rename(later)
    bpy.ops.wm.open_mainfile(filepath=str(later / "shot.blend"))
    clip = bpy.context.scene.active_clip
    assert clip.filepath == "//clip.mp4" and clip.size[0] > 0


def test_a_clip_that_was_moved_is_the_same_clip(scene, workplace, tmp_path) -> None:
    settings, video = scene.seeing_wind, workplace / "clip.mp4"
    first, later = tmp_path / "first" / "clip.mp4", tmp_path / "later" / "clip.mp4"
    for path in (first, later):
        path.parent.mkdir()
    shutil.copy(video, first)
    assert bpy.ops.seeing_wind.choose_clip(filepath=str(first)) == {"FINISHED"}
    settings.box, clip = (20, 20, 44, 44), scene.active_clip
    clip.tracking.tracks.new(name="mine", frame=1)
    first.rename(later)
    assert bpy.ops.seeing_wind.choose_clip(filepath=str(later)) == {"FINISHED"}
    assert tuple(settings.box) == (20, 20, 44, 44) and bpy.path.abspath(clip.filepath) == str(later)
    assert scene.active_clip == clip and len(bpy.data.movieclips) == 1 and "mine" in clip.tracking.tracks
    shutil.copy(later, first)  # both are there: another clip
    assert bpy.ops.seeing_wind.choose_clip(filepath=str(first)) == {"FINISHED"}
    assert not any(settings.box) and scene.active_clip != clip


def test_two_scenes_show_a_clip_at_frames_of_their_own(scene, workplace) -> None:
    one, other, video = scene, bpy.data.scenes.new("Other"), workplace / "clip.mp4"
    bpy.ops.seeing_wind.choose_clip(filepath=str(video))
    one.active_clip.tracking.tracks.new(name="mine", frame=1)
    other.seeing_wind.frame_start = 101
    with bpy.context.temp_override(scene=other, view_layer=other.view_layers[0]):
        bpy.ops.seeing_wind.choose_clip(filepath=str(video))
    assert (one.active_clip.frame_start, other.active_clip.frame_start) == (1, 101)
    assert one.camera.data.background_images[0].clip == one.active_clip
    assert other.camera.data.background_images[0].clip == other.active_clip and "mine" in other.active_clip.tracking.tracks
    one.seeing_wind.frame_start = 11
    bpy.ops.seeing_wind.choose_clip(filepath=str(video))
    with bpy.context.temp_override(scene=other, view_layer=other.view_layers[0]):
        bpy.ops.seeing_wind.choose_clip(filepath=str(video))
    assert (one.active_clip.frame_start, other.active_clip.frame_start) == (11, 101) and len(bpy.data.movieclips) == 2
