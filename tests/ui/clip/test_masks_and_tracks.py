"""Masks, tracks and plane tracks of the scene become the engine's files, to a fraction of a pixel."""

from __future__ import annotations

import dataclasses
import math

import bpy
import numpy as np
import pytest

from seeing_wind.engine.errors import ObjectError
from seeing_wind.ui.clip.clip_scene import setup_clip_scene
from seeing_wind.ui.clip.inputs.clips import loaded_clip
from seeing_wind.ui.clip.inputs.scene_inputs import scene_inputs
from tests.ui.clip.inputs import FRAMES, HEIGHT, WIDTH, camera, pixel, read_png, spline, stamps, written


def test_tracks_are_in_our_pixels_and_rows_are_the_file_s_frames(settings, tmp_path) -> None:
    clip = loaded_clip(settings)
    one, other = clip.tracking.tracks.new(name="One", frame=1), clip.tracking.tracks.new(name="Other", frame=1)
    for clip_frame in range(10):
        one.markers.insert_frame(clip_frame + 1, co=pixel(30.0 + clip_frame, 20.25))
        other.markers.insert_frame(clip_frame + 1, co=pixel(40.0, 30.0 - 0.5 * clip_frame))
    other.markers.find_frame(4).mute = True
    settings.use_tracks = True
    with np.load(written(settings, tmp_path)["tracks"]) as data:
        xy, visible = data["xy"], data["visible"]
    assert len(xy) > FRAMES, "more rows than frames: the engine takes those of the range that was chosen"
    np.testing.assert_allclose(xy[:10, 0], np.stack([30.0 + np.arange(10), np.full(10, 20.25)], 1), atol=1e-4)
    assert visible[:10, 0].all() and not visible[10:, 0].any() and visible[:10, 1].tolist() == [True] * 3 + [False] + [True] * 6
    settings.use_frames, settings.frames = True, (11, 12)
    with pytest.raises(ObjectError, match="No track has a marker in frame 11"):
        written(settings, tmp_path)


def test_a_clip_that_starts_later_keeps_its_tracks(settings, tmp_path) -> None:
    """`frame_offset` shifts the file under the markers: marker frame 1 is clip frame 3 of the file."""
    clip = loaded_clip(settings)
    clip.frame_offset = 3
    clip.tracking.tracks.new(name="One", frame=1).markers.insert_frame(1, co=pixel(10.0, 11.0))
    settings.use_tracks, settings.use_frames, settings.frames = True, True, (3, 9)
    with np.load(written(settings, tmp_path)["tracks"]) as data:
        assert data["visible"][:, 0].nonzero()[0].tolist() == [3]
        np.testing.assert_allclose(data["xy"][3, 0], [10.0, 11.0], atol=1e-4)
    setup_clip_scene(bpy.context.scene, settings.clip, dataclasses.asdict(camera(0.0)), 24.0, 3, 6, frame_start=7)
    assert clip.frame_offset == 3 and 7 - clip.frame_start + clip.frame_offset == 3, "clip frame 3 at frame 7, markers untouched"


def plane_track(clip: bpy.types.MovieClip, corners: list[tuple[float, float]]) -> bpy.types.MovieTrackingPlaneTrack:
    """A plane track with these corners [px] in the first frame, made as the user makes one, from four tracks."""
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    area.type = "CLIP_EDITOR"
    area.spaces.active.clip = clip
    for name, corner in zip("ABCD", corners):
        track = clip.tracking.tracks.new(name=name, frame=1)
        track.markers.insert_frame(1, co=pixel(*corner))
        track.select = True
    with bpy.context.temp_override(window=window, area=area, region=next(r for r in area.regions if r.type == "WINDOW")):
        bpy.ops.clip.create_plane_track()
    return clip.tracking.plane_tracks[0]


CORNERS = [(20.0, 50.0), (70.0, 44.0), (60.0, 12.0), (28.0, 8.0)]


def test_a_plane_track_is_a_mask_and_a_grid_of_tracks(settings, tmp_path) -> None:
    plane = plane_track(loaded_clip(settings), CORNERS)
    for track in list(loaded_clip(settings).tracking.tracks):
        track.markers.delete_frame(1) if len(track.markers) > 1 else None
    plane.markers[0].corners = [pixel(*corner) for corner in CORNERS]
    settings.object_mode, settings.use_tracks = "PLANE", True
    files = written(settings, tmp_path)
    inside = read_png(files["mask"])
    a, b = np.array(CORNERS), np.roll(CORNERS, -1, axis=0)
    area = 0.5 * abs((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    assert inside.sum() == pytest.approx(area, rel=0.02)
    with np.load(files["tracks"]) as data:
        points = data["xy"][0][4:][data["visible"][0][4:]]
    assert len(points) == 36 and inside[tuple(np.round(points[:, ::-1]).astype(int).T)].all()
    # the diagonals of a quadrilateral cross in the image of the square's middle
    grid = points.reshape(6, 6, 2)
    middle = np.array([cross(grid[0, 0], grid[5, 5], grid[0, 5], grid[5, 0]), cross(*(np.array(CORNERS[k]) for k in (0, 2, 1, 3)))])
    np.testing.assert_allclose(middle[0], middle[1], atol=1e-3)


def cross(a, b, c, d) -> np.ndarray:
    """Where the line a-b meets the line c-d."""
    s = np.linalg.solve(np.stack([b - a, c - d], axis=1), c - a)[0]
    return a + s * (b - a)


def test_a_mask_is_drawn_at_the_clip_s_size(settings, tmp_path) -> None:
    mask = bpy.data.masks.new("Leaf")
    spline(mask.layers.new(name="Outer"), [(20.5, 10.5), (60.5, 10.5), (60.5, 40.5), (20.5, 40.5)])
    hole = mask.layers.new(name="Hole")
    spline(hole, [(30.5, 20.5), (40.5, 20.5), (40.5, 30.5), (30.5, 30.5)])
    hole.blend = "SUBTRACT"
    settings.object_mode, settings.mask_data = "BLENDER_MASK", mask
    expected = np.zeros((HEIGHT, WIDTH), dtype=bool)
    expected[11:41, 21:61] = True
    expected[21:31, 31:41] = False
    np.testing.assert_array_equal(read_png(written(settings, tmp_path)["mask"]), expected)
    before = stamps()
    mask.name = "Leaf of Another Name"
    assert stamps() == before
    hole.splines[0].points[0].co.x += 0.05
    assert stamps() != before
    bpy.data.masks.remove(mask)
    with pytest.raises(ObjectError, match="No mask is chosen"):
        scene_inputs(bpy.context.scene)


def test_a_round_mask_has_the_area_of_a_disc(settings, tmp_path) -> None:
    mask = bpy.data.masks.new("Disc")
    turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    spline(mask.layers.new(name="L"), [(48.0 + 25.0 * math.cos(a), 32.0 + 25.0 * math.sin(a)) for a in turn], "AUTO")
    settings.object_mode, settings.mask_data = "BLENDER_MASK", mask
    assert read_png(written(settings, tmp_path)["mask"]).sum() == pytest.approx(np.pi * 25.0**2, rel=0.01)
