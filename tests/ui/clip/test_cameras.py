"""The scene's camera, a camera solve and its lens become the engine's numbers, to a fraction of a pixel."""

from __future__ import annotations

import dataclasses
import json

import bpy
import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.ui.clip.clip_scene import setup_clip_scene
from seeing_wind.ui.clip.inputs.camera import camera_source, scene_camera
from seeing_wind.ui.clip.inputs.clips import loaded_clip
from seeing_wind.ui.clip.object.options import object_options
from seeing_wind.ui.recover.request import scene_values
from tests.ui.clip.inputs import FRAMES, HEIGHT, WIDTH, camera, pixel, solve, with_box, written


@pytest.mark.parametrize("unit", [1.0, 0.01])
@pytest.mark.parametrize("moving", [False, True])
def test_the_scene_s_camera_is_the_inverse_of_what_a_take_makes(settings, tmp_path, unit, moving) -> None:
    scene, given = bpy.context.scene, camera(0.4)
    scene.unit_settings.scale_length = unit
    if moving:
        given = dataclasses.replace(given, camera_to_world=np.stack([camera(0.1 * k).camera_to_world for k in range(FRAMES)]))
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(given), 24.0, 0, FRAMES - 1, settings.frame_start)
    assert scene.camera.data.clip_end * unit == pytest.approx(1000.0), "it sees as far in any unit"
    scene.camera.scale = (2.0, 2.0, 2.0)  # a user's way to see it better
    settings.camera_mode = "SCENE"
    values = json.loads(written(settings, tmp_path)["camera"].read_text())
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        assert values[name] == pytest.approx(getattr(given, name), abs=1e-3)
    for frame in (0, 5, 12):
        np.testing.assert_allclose(values["camera_to_world"][frame], given.pose(frame), atol=1e-5)


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
def test_sensor_fit(settings, fit) -> None:
    scene = bpy.context.scene
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(camera(0.0)), 24.0, 0, FRAMES - 1, 1)
    data = scene.camera.data
    data.sensor_fit, data.sensor_height = fit, 24.0
    settings.camera_mode = "SCENE"
    frame = np.array([tuple(corner) for corner in data.view_frame(scene=scene)])
    values = scene_camera(scene)
    corners = frame[:, :2] / -frame[:, 2:] * [values["fx"], -values["fy"]] + [values["cx"], values["cy"]]
    np.testing.assert_allclose([corners.min(0), corners.max(0)], [[-0.5, -0.5], [WIDTH - 0.5, HEIGHT - 0.5]], atol=1e-3)


def test_a_camera_solve_is_found_by_itself_and_sees_its_own_points(settings, tmp_path) -> None:
    clip = loaded_clip(settings)
    assert "fov" in object_options(with_box(settings), scene_values(settings), tmp_path)[0]
    solve(clip)
    options = object_options(settings, scene_values(settings), tmp_path)[0]
    assert "camera" in options and "fov" not in options, "automatic: a solve goes before the field of view"
    assert "distance" not in options, "and its scale is the scene's: the object is about where the world's origin is"
    values = json.loads(written(settings, tmp_path)["camera"].read_text())
    poses = np.array(values["camera_to_world"])
    for track in clip.tracking.tracks:
        for marker in track.markers:
            pose = poses[marker.frame - 1]
            local = (np.array(track.bundle) - pose[:3, 3]) @ pose[:3, :3]
            seen = local[:2] / local[2] * [values["fx"], values["fy"]] + [values["cx"], values["cy"]]
            assert np.abs(pixel(*seen) - np.array(marker.co)).max() < 1e-3
    settings.camera_mode = "FOV"
    assert "fov" in object_options(settings, scene_values(settings), tmp_path)[0]


@pytest.mark.parametrize(("told", "fits"), [((-0.25, 0.05), True), ((0.0, 0.0), False)])
def test_blenders_own_solver_means_the_lens_as_the_engine_does(settings, told, fits) -> None:
    """Points bent by OpenCV's formula are solved without a rest when Blender is told the same numbers, and not otherwise."""
    clip = loaded_clip(settings)
    lens = clip.tracking.camera
    lens.distortion_model, lens.k1, lens.k2 = "POLYNOMIAL", *told
    solve(clip, -0.25, 0.05)
    assert (clip.tracking.reconstruction.average_error < 0.01) == fits
    found = scene_camera(bpy.context.scene)
    assert (found.get("k1", 0.0), found.get("k2", 0.0)) == pytest.approx(told)


@pytest.mark.parametrize("model", ["POLYNOMIAL", "DIVISION", "BROWN"])
def test_the_lens_of_a_solve_is_handed_on(settings, model) -> None:
    """Blender's numbers by OpenCV's names; Division, which has another formula, to a fraction of a pixel."""
    scene, clip = bpy.context.scene, loaded_clip(settings)
    solve(clip)
    lens, stamp = clip.tracking.camera, camera_source(scene)
    assert "k1" not in scene_camera(scene), "a lens that bends nothing says nothing"
    lens.distortion_model = model
    if model == "POLYNOMIAL":
        lens.k1, lens.k2 = -0.25, 0.05
    elif model == "DIVISION":
        lens.division_k1, lens.division_k2 = -0.12, 0.01
    else:
        lens.brown_k1, lens.brown_k2, lens.brown_p1, lens.brown_p2 = -0.2, 0.04, 0.01, -0.006
    found = scene_camera(scene)
    assert camera_source(scene) != stamp
    if model == "DIVISION":
        straight = np.linspace(0.0, 0.5, 20)
        bent = straight * (1.0 + found["k1"] * straight**2 + found["k2"] * straight**4 + found["k3"] * straight**6)
        assert np.abs(bent / (1.0 - 0.12 * bent**2 + 0.01 * bent**4) - straight).max() * found["fx"] < 0.02
        return
    given = (-0.25, 0.05, 0.0, 0.0) if model == "POLYNOMIAL" else (-0.2, 0.04, 0.01, -0.006)
    assert [found[name] for name in ("k1", "k2", "p1", "p2")] == pytest.approx(given, abs=1e-6)


def test_a_lens_that_the_engine_lacks_is_said(settings) -> None:
    clip = loaded_clip(settings)
    solve(clip)
    clip.tracking.camera.distortion_model = "NUKE"
    with pytest.raises(UsageError, match="lens model Nuke"):
        scene_camera(bpy.context.scene)
