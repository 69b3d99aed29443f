"""Corrections of the outline: points and a Blender mask in any frame become the engine's options, and change what the preview is of."""

from __future__ import annotations

import shutil

import bpy
import pytest

from seeing_wind.engine.settings import ObserveSettings
from seeing_wind.ui.clip.inputs.clips import loaded_clip, scene_frame
from seeing_wind.ui.clip.object.options import object_options
from seeing_wind.ui.clip.object.preview import preview_digest
from seeing_wind.ui.option_properties import values_of
from tests.ui.clip.inputs import HEIGHT, WIDTH, read_png, spline

ops = bpy.ops.seeing_wind


def options(settings, folder) -> dict:
    return object_options(settings, values_of(settings, ObserveSettings), folder)[0]


@pytest.fixture
def boxed(settings):
    settings.object_mode, settings.box = "BOX", (10.0, 10.0, 40.0, 40.0)
    return settings


def test_points_are_of_the_frame_that_is_shown(boxed, tmp_path) -> None:
    clip = loaded_clip(boxed)
    bpy.context.scene.frame_set(scene_frame(clip, 5))
    assert ops.correct_outline(place=(20.5, 12.0)) == {"FINISHED"}
    assert ops.correct_outline(place=(30.0, 11.0), clip_frame=2, beside=True) == {"FINISHED"}
    assert options(boxed, tmp_path)["correct"] == (5.0, 20.5, 12.0, 1.0, 2.0, 30.0, 11.0, 0.0)
    assert ops.clear_corrections() == {"FINISHED"} and [one.clip_frame for one in boxed.corrections] == [5]
    assert ops.clear_corrections(all=True) == {"FINISHED"} and options(boxed, tmp_path)["correct"] is None


def test_points_that_are_refused(boxed) -> None:
    with pytest.raises(RuntimeError, match="outside the clip.s image"):
        ops.correct_outline(place=(WIDTH + 3.0, 5.0))
    with pytest.raises(RuntimeError, match="Frame 5000 of the file is not among those used"):
        ops.correct_outline(place=(5.0, 5.0), clip_frame=5000)
    boxed.use_frames, boxed.frames = True, (2, 4)
    with pytest.raises(RuntimeError, match="Frame 1 of the file is not among those used, 2 to 4"):
        ops.correct_outline(place=(5.0, 5.0), clip_frame=1)
    with pytest.raises(RuntimeError, match="no corrections"):
        ops.clear_corrections()
    boxed.clip = ""
    with pytest.raises(RuntimeError, match="No clip is chosen"):
        ops.correct_outline(place=(5.0, 5.0))
    assert not len(boxed.corrections)


def test_points_of_another_clip_are_forgotten(boxed, tmp_path) -> None:
    ops.correct_outline(place=(20.5, 12.0), clip_frame=2)
    other = shutil.copy(boxed.clip, tmp_path / "other.mp4")
    boxed.held_box = (1.0, 2.0, 9.0, 9.0)
    assert ops.choose_clip(filepath=str(other)) == {"FINISHED"}
    assert not len(boxed.corrections) and not any(boxed.held_box)


def test_a_blender_mask_of_a_later_frame(boxed, tmp_path) -> None:
    mask = bpy.data.masks.new("Later")
    spline(mask.layers.new(), [(10.0, 8.0), (30.0, 8.0), (30.0, 20.0), (10.0, 20.0)])
    assert options(boxed, tmp_path).get("outline") is None and options(boxed, tmp_path)["outline_frame"] == 0
    boxed.outline_data, boxed.outline_frame = mask, 3
    given, inputs = object_options(boxed, values_of(boxed, ObserveSettings), tmp_path)
    (made,) = (each for each in inputs if each.option == "outline")
    assert given["outline"] == str(tmp_path / made.name) and given["outline_frame"] == 3
    made.write(tmp_path / made.name)
    inside = read_png(tmp_path / made.name) > 0
    assert inside.shape == (HEIGHT, WIDTH) and inside[14, 20] and not inside[30, 20]
    clip, marked = (boxed.clip, {}, ()), (given, inputs)
    boxed.outline_frame = 4
    assert preview_digest(clip, object_options(boxed, values_of(boxed, ObserveSettings), tmp_path)) != preview_digest(clip, marked)
