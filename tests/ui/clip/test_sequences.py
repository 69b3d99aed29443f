"""A clip that is a sequence of images, from the choice of one of them to the scene with the results."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from seeing_wind.ui import freshness
from seeing_wind.ui.clip.inputs import clip_files, clips
from tests.ui.jobs import now

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture
def images(workplace, tmp_path) -> Path:
    """The frames of the clip, numbered from 7 on, in a folder of theirs."""
    import cv2

    folder, capture = tmp_path / "Bilder è", cv2.VideoCapture(str(workplace / "clip.mp4"))
    folder.mkdir()
    for number in range(7, 20):
        assert cv2.imwrite(str(folder / f"shot_{number:04d}.png"), capture.read()[1])
    return folder


@pytest.mark.parametrize("chosen", ["shot_0007.png", "shot_0012.png"])
def test_a_sequence_is_recovered_whichever_frame_was_chosen(scene, images, tmp_path, chosen) -> None:
    ops = bpy.ops.seeing_wind
    assert ops.choose_clip(filepath=str(images / chosen)) == {"FINISHED"}
    assert scene.active_clip.filepath == str(images / "shot_0007.png") and scene.frame_end - scene.frame_start == 12
    ops.draw_box(box=(20, 20, 44, 44))
    assert ops.recover(distance=2.0, take=str(tmp_path / "out.take")) == {"FINISHED"}
    assert len(bpy.data.movieclips) == 1 and scene.camera.data.background_images[0].clip == scene.active_clip
    assert clips.scene_frame(scene.active_clip, 0) == scene.seeing_wind.frame_start
    assert ops.build_scene() == {"FINISHED"}


def test_a_changed_frame_makes_the_recovery_stale(scene, images, tmp_path) -> None:
    bpy.ops.seeing_wind.choose_clip(filepath=str(images / "shot_0007.png"))
    bpy.ops.seeing_wind.draw_box(box=(20, 20, 44, 44))
    bpy.ops.seeing_wind.recover(distance=2.0, take=str(tmp_path / "out.take"))
    assert now(scene)["recover"].state == "done"
    (images / "shot_0009.png").write_bytes((images / "shot_0010.png").read_bytes() + b" ")
    freshness.refresh(scene)
    assert now(scene)["recover"].state == "stale"


def test_files_of_a_clip_are_those_that_the_engine_reads(images, workplace) -> None:
    from seeing_wind.engine.observe.clip.frames import files_of

    (images / "other_1.png").write_bytes(b"")
    for path in (images, images / "shot_%04d.png", images / "shot_*.png", images / "no_%d.png", workplace / "clip.mp4"):
        expected = files_of(str(path)) or [path]
        assert clip_files.files_of(str(path)) == expected, path


def test_another_clip_needs_another_box(scene, images, workplace) -> None:
    ops, settings = bpy.ops.seeing_wind, scene.seeing_wind
    ops.choose_clip(filepath=str(workplace / "clip.mp4"))
    ops.draw_box(box=(20, 20, 44, 44))
    settings.frames, settings.use_frames = (2, 9), True
    ops.choose_clip(filepath=str(workplace / "clip.mp4"))
    assert tuple(settings.box) == (20, 20, 44, 44) and settings.use_frames
    ops.choose_clip(filepath=str(images / "shot_0007.png"))
    assert not any(settings.box) and not settings.use_frames and now(scene)["object"].state != "done"
