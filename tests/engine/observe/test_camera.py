"""Cameras: the front view, scale and distance, files and what is refused in them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.observe.clip.camera import find_camera, read_camera, resized
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.settings import ObserveSettings


def camera_for(settings: ObserveSettings, depth: float | None = None, progress: Progress | None = None):
    return find_camera(settings, 640, 480, 5, 0, depth, progress or NoProgress())


def test_front_view_puts_the_origin_in_the_middle() -> None:
    camera, distance = camera_for(ObserveSettings(distance=3.0, fov=60.0))
    assert distance == 3.0
    xy, depth = camera.project(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.1]]))
    assert np.allclose(xy[0], [319.5, 239.5]) and np.allclose(depth, 3.0)
    scale = camera.fx / 3.0
    assert np.allclose(xy[1] - xy[0], [0.1 * scale, 0.0]), "world X is right"
    assert np.allclose(xy[2] - xy[0], [0.0, -0.1 * scale]), "world Z is up"
    # The frame's half width is seen under half the angle.
    assert camera.fx == pytest.approx(320.0 / np.tan(np.radians(30.0)))


def test_pixels_per_metre_is_the_scale_in_the_objects_plane() -> None:
    camera, distance = camera_for(ObserveSettings(pixels_per_metre=398.7))
    assert distance == pytest.approx(camera.fx / 398.7)
    xy, _ = camera.project(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    assert xy[1, 0] - xy[0, 0] == pytest.approx(398.7)


def test_without_scale_there_is_a_warning() -> None:
    told: list[dict] = []
    _, distance = camera_for(ObserveSettings(), progress=Progress(told.append))
    assert distance > 0
    assert [message for message in told if message["type"] == "warning" and "scale" in message["message"]]


def test_depth_file_gives_the_distance() -> None:
    told: list[dict] = []
    camera, distance = camera_for(ObserveSettings(), depth=0.8, progress=Progress(told.append))
    assert distance == 0.8 and not told
    assert camera.project(np.zeros(3))[1] == pytest.approx(0.8)


@pytest.mark.parametrize(
    "settings",
    [
        ObserveSettings(distance=0.0),
        ObserveSettings(distance=-1.0),
        ObserveSettings(distance=float("nan")),
        ObserveSettings(pixels_per_metre=0.0),
        ObserveSettings(pixels_per_metre=-10.0),
        ObserveSettings(distance=2.0, pixels_per_metre=10.0),
        ObserveSettings(distance=2.0, fov=0.0),
        ObserveSettings(distance=2.0, fov=180.0),
    ],
)
def test_scales_refused(settings: ObserveSettings) -> None:
    with pytest.raises(UsageError) as caught:
        camera_for(settings)
    assert caught.value.hint


def good() -> dict:
    return {"width": 640, "height": 480, "fx": 700.0, "fy": 700.0, "cx": 319.5, "cy": 239.5, "camera_to_world": front_view(2.0).tolist()}


def write(folder: Path, values: object) -> str:
    path = folder / "camera.json"
    path.write_text(json.dumps(values))
    return str(path)


def test_file_with_further_keys(tmp_path: Path) -> None:
    camera = read_camera(write(tmp_path, {**good(), "lens": "35 mm", "fps": 30}), 640, 480, 5)
    assert camera.fx == 700.0 and np.allclose(camera.camera_to_world, front_view(2.0))


def test_a_camera_without_the_objects_depth_is_told(tmp_path: Path) -> None:
    told: list[dict] = []
    _, distance = camera_for(ObserveSettings(camera=write(tmp_path, good())), progress=Progress(told.append))
    assert distance == pytest.approx(2.0), "that of the world's origin"
    assert [one for one in told if one["type"] == "warning" and "not the object's depth" in one["message"]]


def test_a_resized_camera_shows_the_same_places(tmp_path: Path) -> None:
    camera = read_camera(write(tmp_path, good()), 640, 480, 5)
    point = np.array([[0.3, 0.1, -0.2]])
    xy, small = camera.project(point)[0], resized(camera, 240, 160)
    assert (small.width, small.height) == (160, 240)
    # A quarter of the way into the frame stays a quarter, counted from the outer edge of its first pixel.
    assert np.allclose((small.project(point)[0] + 0.5) / [160, 240], (xy + 0.5) / [640, 480])


def test_same_matrix_every_frame_is_a_still_camera(tmp_path: Path) -> None:
    camera = read_camera(write(tmp_path, {**good(), "camera_to_world": [front_view(2.0).tolist()] * 5}), 640, 480, 5)
    assert camera.camera_to_world.shape == (4, 4)


def test_moving_camera_of_the_whole_file_is_cut_to_the_range(tmp_path: Path) -> None:
    poses = [front_view(2.0 + 0.1 * t).tolist() for t in range(9)]
    camera = read_camera(write(tmp_path, {**good(), "camera_to_world": poses}), 640, 480, 5, first_frame=3)
    assert camera.camera_to_world.shape == (5, 4, 4)
    assert np.allclose(camera.pose(0), front_view(2.3)) and np.allclose(camera.pose(4), front_view(2.7))


@pytest.mark.parametrize(
    "change",
    [
        {"width": 641},
        {"fx": -1.0},
        {"fx": "wide"},
        {"cx": float("nan")},
        {"fx": True},
        {"fx": 1e300},
        {"fx": 1e-9, "fy": 1e-9},
        {"fx": 2600.0, "fy": 500.0},
        {"cx": 1e9},
        {"cx": 2000.0},
        {"cy": -600.0},
        {"k1": 1e6},
        {"k1": 50.0},
        {"k2": 1e5},
        {"p1": 1e4},
        {"k1": False},
        {"camera_to_world": np.eye(3).tolist()},
        {"camera_to_world": [front_view(1.0).tolist()] * 3},
        {"camera_to_world": (2.0 * np.eye(4)).tolist()},
        {"camera_to_world": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()},
        {"camera_to_world": np.full((4, 4), np.inf).tolist()},
        {"camera_to_world": [[1, 0], [0, 1, 2]]},
    ],
)
def test_files_refused(tmp_path: Path, change: dict) -> None:
    with pytest.raises(UsageError) as caught:
        read_camera(write(tmp_path, {**good(), **change}), 640, 480, 5)
    assert caught.value.hint


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"fx": "700"}, 'fx is "700"'),
        ({"width": "640"}, 'width is "640"'),
        ({"cy": float("nan")}, "cy is NaN"),
        ({"k2": float("inf")}, "k2 is Infinity"),
        ({"camera_to_world": [["1", 0, 0, 0], *np.eye(4)[1:].tolist()]}, 'camera_to_world[0][0] is "1"'),
        ({"camera_to_world": [front_view(2.0).tolist()] * 3 + [np.full((4, 4), np.nan).tolist()]}, "camera_to_world[3][0][0] is NaN"),
        ({"camera_to_world": [[1, 0], [0, 1, 2]]}, "neither a 4x4 list nor a list of them"),
    ],
)
def test_what_is_no_number_is_shown_with_its_place(tmp_path: Path, change: dict, says: str) -> None:
    with pytest.raises(UsageError) as caught:
        read_camera(write(tmp_path, {**good(), **change}), 640, 480, 5)
    assert says in caught.value.message


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    values = good()
    del values["fy"]
    for path in (write(tmp_path, values), str(tmp_path / "none.json")):
        with pytest.raises(UsageError):
            read_camera(path, 640, 480, 5)
    (tmp_path / "text.json").write_text("no json")
    with pytest.raises(UsageError, match="not JSON"):
        read_camera(str(tmp_path / "text.json"), 640, 480, 5)
    with pytest.raises(UsageError, match="object"):
        read_camera(write(tmp_path, [1, 2]), 640, 480, 5)


@pytest.mark.parametrize(
    "settings", [ObserveSettings(distance=1e30), ObserveSettings(distance=1e-300), ObserveSettings(pixels_per_metre=1e-30)]
)
def test_a_distance_that_no_camera_films_is_a_mistaken_unit(settings: ObserveSettings) -> None:
    with pytest.raises(UsageError, match="from the camera"):
        camera_for(settings)
    with pytest.raises(UsageError, match="depth file"):
        camera_for(ObserveSettings(), depth=1e20)


@pytest.mark.parametrize(
    ("place", "value", "says"),
    [((3, 3), 2.0, "last row"), ((0, 0), -1.0, "mirrors"), ((0, 1), 0.5, "rotation is off by"), ((0, 3), 1e12, "m from the origin")],
)
def test_matrices_that_are_no_camera_s_are_told_apart(tmp_path: Path, place: tuple[int, int], value: float, says: str) -> None:
    pose = np.eye(4)
    pose[place] = value
    with pytest.raises(UsageError) as refused:
        read_camera(write(tmp_path, {**good(), "camera_to_world": pose.tolist()}), 640, 480, 5)
    assert says in refused.value.message
