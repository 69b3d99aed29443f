"""Lens distortion: its removal, the inverse, and an observation through a distorting lens."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import Scene, write_video

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.clip.camera import read_camera
from seeing_wind.engine.observe.clip.lens import Lens
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.records import Camera
from seeing_wind.engine.settings import ObserveSettings

BENT = (-0.25, 0.06, 0.002, -0.003, 0.0)
CAMERA = Camera(220, 160, 200.0, 205.0, 108.0, 81.0, front_view(2.0), BENT)


def test_filmed_pixels_follow_opencvs_formula() -> None:
    points = np.random.default_rng(0).uniform([-0.5, -0.35, 2.0], [0.5, 0.35, 2.0], (40, 3))
    matrix = np.array([[200.0, 0, 108.0], [0, 205.0, 81.0], [0, 0, 1]])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(BENT))[0][:, 0]
    pinhole = points[:, :2] / points[:, 2:] * [200.0, 205.0] + [108.0, 81.0]
    assert np.allclose(CAMERA.filmed(pinhole), expected, atol=1e-9)
    assert np.allclose(Lens(CAMERA).straight_points(expected), pinhole, atol=1e-6)
    assert np.array_equal(replace(CAMERA, distortion=()).filmed(pinhole), pinhole)


def test_frames_masks_and_boxes_move_alike() -> None:
    lens = Lens(CAMERA)
    frame = np.zeros((160, 220, 3), np.uint8)
    filmed = CAMERA.filmed(np.array([30.0, 40.0]))
    cv2.circle(frame, tuple(int(v) for v in np.round(filmed)), 6, (255, 255, 255), -1)
    straight = lens.straight(frame[None], NoProgress())[0]
    rows, columns = np.nonzero(straight[..., 0] > 127)
    assert np.hypot(columns.mean() - 30.0, rows.mean() - 40.0) < 0.8
    mask = frame[..., 0] > 127
    moved = lens.straight_map(mask)
    assert (moved == (straight[..., 0] > 127)).mean() > 0.999
    assert (lens.filmed_map(moved) & mask).sum() > 0.9 * mask.sum()
    box = lens.straight_box((filmed[0] - 6, filmed[1] - 6, filmed[0] + 6, filmed[1] + 6))
    assert box[0] < 25 and box[2] > 35 and box[1] < 35 and box[3] > 45


def test_the_observation_is_the_pinholes(disc: Scene, tmp_path: Path) -> None:
    """The disc's clip bent by a lens: tracks straightened on the way in are those of the clip without the lens."""
    camera = Camera(220, 160, 120.0, 120.0, 109.5, 79.5, front_view(2.0), (-0.2, 0.03, 0.0, 0.0, 0.0))
    grid = np.stack(np.meshgrid(np.arange(220.0), np.arange(160.0)), -1)
    places = Lens(camera).straight_points(grid).astype(np.float32)
    bent = [cv2.remap(frame, places[..., 0], places[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE) for frame in disc.frames]
    write_video(tmp_path / "bent.avi", bent, 30.0)
    values = {"width": 220, "height": 160, "fx": 120.0, "fy": 120.0, "cx": 109.5, "cy": 79.5, "k1": -0.2, "k2": 0.03}
    (tmp_path / "camera.json").write_text(json.dumps({**values, "camera_to_world": front_view(2.0).tolist()}))
    corners = camera.filmed(np.array([disc.box[:2], disc.box[2:]]))
    box = (corners[0, 0] - 2, corners[0, 1] - 2, corners[1, 0] + 2, corners[1, 1] + 2)
    seen = observe(tmp_path / "bent.avi", ObserveSettings(box=box, camera=str(tmp_path / "camera.json"), distance=2.0), NoProgress())
    assert seen.camera.distortion == (-0.2, 0.03, 0.0, 0.0, 0.0)
    overlap = (seen.masks[0] & disc.masks[0]).sum() / (seen.masks[0] | disc.masks[0]).sum()
    assert overlap > 0.93
    alive = seen.visible[8] & ~seen.on_centroid
    off = np.linalg.norm(seen.xy[8, alive] - disc.moved(seen.xy[0, alive], 8), axis=1)
    assert alive.sum() > 20 and np.median(off) < 0.3, "the lens bends by several pixels there"
    bend = np.linalg.norm(camera.filmed(seen.xy[0, alive]) - seen.xy[0, alive], axis=1)
    assert np.median(bend) > 1.0
    assert from_arrays(Camera, to_arrays(seen.camera)).distortion == seen.camera.distortion


def test_takes_from_before_lenses_are_read() -> None:
    arrays = to_arrays(replace(CAMERA, distortion=()))
    del arrays["distortion"]
    assert from_arrays(Camera, arrays).distortion == ()


def test_a_lens_that_folds_is_refused(tmp_path: Path) -> None:
    values = {"width": 220, "height": 160, "fx": 100.0, "fy": 100.0, "cx": 109.5, "cy": 79.5, "camera_to_world": front_view(2.0).tolist()}
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({**values, "k1": -0.9}))
    with pytest.raises(UsageError, match="folds"):
        read_camera(str(path), 220, 160, 5)
    path.write_text(json.dumps({**values, "k1": "wide"}))
    with pytest.raises(UsageError, match="number"):
        read_camera(str(path), 220, 160, 5)
    path.write_text(json.dumps({**values, "fx": None}))
    with pytest.raises(UsageError, match="fx is null"):
        read_camera(str(path), 220, 160, 5)
