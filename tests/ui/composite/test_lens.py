"""What is rendered is bent as the clip's lens bends, so that it stands on what the clip shows."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.record_arrays import to_arrays
from seeing_wind.engine.records import Camera
from seeing_wind.engine.take import Take
from seeing_wind.ui.clip.inputs.lens import straightened
from seeing_wind.ui.composite.composite import set_up
from seeing_wind.ui.composite.film.lens import OUTSIDE, WIDEST, overscan_of, st_map, widened
from seeing_wind.ui.job.take_reading import field_summary, read_seen
from tests.ui.composite.rendering import red_cube, render

LENSES = [(-1.0, 0.2, 0.0, 0.0, 0.0), (0.6, 0.0, 0.04, -0.03, 0.1)]


def bend(scene, distortion: tuple[float, ...]) -> Camera:
    """Let the take's camera have a lens; returns it."""
    take = Take(Path(scene.seeing_wind.recovered_take))
    camera = dataclasses.replace(read_seen(take, field_summary(take)).camera, distortion=distortion)
    take.write_arrays("observation.npz", take.read_arrays("observation.npz") | to_arrays(camera, "camera."))
    return camera


def middle(frame: np.ndarray, channel: int) -> np.ndarray:
    """(2,) column and row of what shines in one colour."""
    others = np.delete(frame, channel, axis=2).max(axis=2)
    shine = np.maximum(frame[..., channel] - others - 60, 0)
    rows, columns = np.indices(shine.shape)
    assert shine.sum() > 0
    return np.array([(shine * columns).sum(), (shine * rows).sum()]) / shine.sum()


def green(frame: np.ndarray) -> np.ndarray:
    """(H, W) bool."""
    return frame[..., 1] > frame[..., 0] + 50


@pytest.mark.parametrize("distortion", LENSES)
def test_a_thing_is_seen_where_the_lens_would_show_it(scene, tmp_path, distortion) -> None:
    red_cube(scene)
    bpy.context.object.scale = (0.3, 0.3, 0.3)
    assert "bent" not in str(set_up(scene, samples=16, shutter=0.0, grain=0.0))
    straight = middle(render(tmp_path / "straight.png"), 0)
    camera = bend(scene, distortion)
    assert "bent as by the clip's lens" in str(set_up(scene, samples=16, shutter=0.0, grain=1.0))
    bent = middle(render(tmp_path / "bent.png"), 0)
    assert np.abs(camera.filmed(straight) - straight).max() > 1.0
    assert np.abs(bent - camera.filmed(straight)).max() < 0.35
    bend(scene, ())
    assert "bent" not in str(set_up(scene, samples=16, shutter=0.0, grain=0.0))
    assert np.abs(middle(render(tmp_path / "again.png"), 0) - straight).max() < 0.05


def test_the_clean_plate_covers_what_the_lens_showed(scene, tmp_path) -> None:
    """The plate is green where the object was; the object's outline is the pinhole's."""
    bpy.ops.seeing_wind.insert_mesh(recovered=True)
    scene.seeing_wind.recovered_object.hide_render = True
    bpy.ops.seeing_wind.set_up_composite(samples=1, shutter=0.0, grain=0.0)
    scene.frame_set(1)
    straight = green(render(tmp_path / "straight.png"))
    camera = bend(scene, (-3.0, 0.0, 0.0, 0.0, 0.0))
    bpy.ops.seeing_wind.set_up_composite(samples=1, shutter=0.0, grain=0.0)
    bent = green(render(tmp_path / "bent.png"))
    places = straightened(camera, np.stack(np.meshgrid(np.arange(96), np.arange(64)), axis=-1))
    at = np.round(np.nan_to_num(places, nan=-1.0)).astype(int)
    inside = ((at >= 0) & (at < (96, 64))).all(axis=-1)
    expected = inside & straight[np.clip(at[..., 1], 0, 63), np.clip(at[..., 0], 0, 95)]
    assert (bent != expected).sum() < 0.1 * expected.sum() < 0.5 * (straight != expected).sum()


def test_what_is_rendered_reaches_the_borders_where_the_lens_draws_in_what_is_beyond_them(scene, tmp_path) -> None:
    """By a second scene; the shot and its camera stay as they are."""
    red_cube(scene)
    bpy.context.object.scale = (40.0, 0.01, 40.0)
    bend(scene, (-0.4, 0.0, 0.0, 0.0, 0.0))
    camera = scene.camera
    before = (camera.data.sensor_width, camera.data.shift_x, len(camera.data.background_images), scene.render.resolution_x)
    for _ in range(2):
        set_up(scene, samples=4, shutter=0.0, grain=0.0)
    assert len(bpy.data.scenes) == 2 and len(bpy.data.cameras) == 2
    frame = render(tmp_path / "bent.png").astype(int)
    rim = np.concatenate([frame[0], frame[-1], frame[:, 0], frame[:, -1]])
    assert (rim[:, 0] > rim[:, 1] + 60).all()
    now = (camera.data.sensor_width, camera.data.shift_x, len(camera.data.background_images), scene.render.resolution_x)
    assert scene.camera == camera and now == before
    bend(scene, ())
    set_up(scene, samples=4, shutter=0.0, grain=0.0)
    assert len(bpy.data.scenes) == 1 and len(bpy.data.cameras) == 1


def test_a_render_is_as_much_wider_as_the_map_asks() -> None:
    places = np.ones((2, 2, 4), np.float32)
    places[..., :2] = [[[-0.1, 0.0], [1.0, 0.5]], [[OUTSIDE, OUTSIDE], [0.5, 1.05]]]
    assert overscan_of(places) == pytest.approx(1.2)
    found = widened(places, 1.2)
    assert np.allclose(found[0, 0, :2], [0.0, 0.5 - 0.5 / 1.2], atol=1e-6) and (found[1, 0, :2] == OUTSIDE).all()
    places[0, 0, 0] = -3.0
    assert overscan_of(places) == pytest.approx(WIDEST)
    places[..., :2] = 0.5
    assert overscan_of(places) == 1.0


@pytest.mark.parametrize("size", [(96, 64), (192, 128)])
def test_the_map_says_for_each_pixel_of_the_clip_where_the_render_has_it(size) -> None:
    camera = Camera(96, 64, 120.0, 120.0, 46.0, 33.0, front_view(2.0), LENSES[1])
    places = st_map(camera, size)[::-1]
    xy = np.stack([places[..., 0] * 96 - 0.5, (1.0 - places[..., 1]) * 64 - 0.5], axis=-1)
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    wanted = (np.stack([columns, rows], axis=-1) + 0.5) * (96 / size[0]) - 0.5
    np.testing.assert_allclose(camera.filmed(xy), wanted, atol=2e-3)
    wide = dataclasses.replace(camera, fx=30.0, fy=30.0, distortion=(-0.4, 0.0, 0.0, 0.0, 0.0))
    places = st_map(wide, size)
    assert np.isfinite(places).all() and (places[0, 0, :2] == OUTSIDE).all(), "beyond what the lens shows"
