"""`transforms.json`: axes and pixel centres against a known pose, order, lens, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.observe.clip.camera import read_camera

# A camera at (0, -2, 0) that looks along +Y with z up, as nerfstudio writes it: columns are right, up, backward, place.
MATRIX = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, -2.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


def write(folder: Path, **change: object) -> str:
    values = {"camera_model": "OPENCV", "fl_x": 700.0, "fl_y": 710.0, "cx": 320.0, "cy": 240.0, "w": 640, "h": 480}
    frames = [{"file_path": "images/frame_00001.png", "transform_matrix": MATRIX}]
    path = folder / "transforms.json"
    path.write_text(json.dumps({**values, "frames": frames, **change}))
    return str(path)


def test_axes_and_pixel_centres_of_a_known_camera(tmp_path: Path) -> None:
    camera = read_camera(write(tmp_path), 640, 480, 5)
    assert np.allclose(camera.camera_to_world, front_view(2.0))
    # The middle of the frame is (320, 240) where pixels are squares from 0, (319.5, 239.5) where their centres count.
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (700.0, 710.0, 319.5, 239.5)
    xy, depth = camera.project(np.array([0.1, 0.0, 0.2]))
    assert depth == pytest.approx(2.0) and np.allclose(xy, [319.5 + 35.0, 239.5 - 71.0]), "x to the right, z up"


def test_poses_are_sorted_by_number_and_cut_to_the_range(tmp_path: Path) -> None:
    frames = []
    for number in (10, 9, 8, 11, 7):
        matrix = np.array(MATRIX)
        matrix[0, 3] = number
        frames.append({"file_path": f"images/frame_{number}.png", "transform_matrix": matrix.tolist()})
    camera = read_camera(write(tmp_path, frames=frames), 640, 480, 3, first_frame=1)
    assert camera.camera_to_world[:, 0, 3].tolist() == [8.0, 9.0, 10.0]


def test_lens_scale_and_angle(tmp_path: Path) -> None:
    assert read_camera(write(tmp_path, k1=-0.1, p2=0.001), 640, 480, 5).distortion == (-0.1, 0.0, 0.0, 0.001, 0.0)
    twice = read_camera(write(tmp_path), 1280, 960, 5)
    assert (twice.fx, twice.cx, twice.width) == (1400.0, 639.5, 1280)
    path = tmp_path / "blender.json"
    path.write_text(json.dumps({"camera_angle_x": np.pi / 2, "frames": [{"file_path": "r_0", "transform_matrix": MATRIX}]}))
    angle = read_camera(str(path), 640, 480, 5)
    assert angle.fx == angle.fy == pytest.approx(320.0) and angle.cx == 319.5


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"camera_model": "OPENCV_FISHEYE"}, "FISHEYE"),
        ({"w": 600}, "600x480"),
        ({"frames": []}, "no frames"),
        ({"frames": [{"file_path": "a"}]}, "frame without"),
        ({"frames": [7]}, "frame without"),
        ({"frames": [{"transform_matrix": [[1, 0], [0, 1]]}]}, "4x4"),
        ({"frames": [{"file_path": "a.png", "transform_matrix": [[float("nan")] * 4] * 4}]}, r"of a.png\[0\]\[0\] is NaN"),
        ({"fl_x": "700"}, 'fl_x is "700"'),
        ({"frames": [{"transform_matrix": (2 * np.array(MATRIX)).tolist()}]}, "rotation"),
        ({"frames": [{"transform_matrix": MATRIX, "fl_x": 1.0}, {"transform_matrix": MATRIX, "fl_x": 2.0}]}, "another lens"),
        ({"frames": [{"transform_matrix": MATRIX}] * 2}, "2 camera matrices"),
    ],
)
def test_what_is_refused(tmp_path: Path, change: dict, says: str) -> None:
    with pytest.raises(UsageError, match=says) as caught:
        read_camera(write(tmp_path, **change), 640, 480, 5)
    assert caught.value.hint


def test_without_a_focal_length(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"frames": [{"file_path": "a", "transform_matrix": MATRIX}]}))
    with pytest.raises(UsageError, match="fl_x"):
        read_camera(str(path), 640, 480, 5)
