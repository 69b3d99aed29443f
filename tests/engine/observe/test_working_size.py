"""A clip of high resolution: processed in a smaller copy, with results in its own pixels."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import Scene, write_video

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.working_size import LONGEST, WorkingSize, working_scale
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.settings import ObserveSettings

TIMES, FRAMES = 8, 4
"""Factor by which the disc's clip is enlarged, to 1760 x 1280; and how many of its frames are used."""


@pytest.fixture(scope="module")
def large(disc: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    size = (disc.frames.shape[2] * TIMES, disc.frames.shape[1] * TIMES)
    path = tmp_path_factory.mktemp("large") / "clip.avi"
    write_video(path, [cv2.resize(frame, size, interpolation=cv2.INTER_CUBIC) for frame in disc.frames[:FRAMES]], 30.0)
    return path


def outward(xy: np.ndarray) -> np.ndarray:
    """Pixels of the disc's original clip, converted to those of the large one."""
    return (xy + 0.5) * TIMES - 0.5


def test_results_are_in_the_files_pixels(disc: Scene, large: Path, tmp_path: Path) -> None:
    height, width = disc.frames.shape[1] * TIMES, disc.frames.shape[2] * TIMES
    mask = cv2.resize(disc.masks[0].astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    np.save(tmp_path / "depth.npy", np.where(mask > 0, np.linspace(1.0, 2.0, width)[None], np.inf).astype(np.float32))
    camera = {"width": width, "height": height, "fx": 2000.0, "fy": 2010.0, "cx": 880.0, "cy": 633.0}
    (tmp_path / "camera.json").write_text(json.dumps({**camera, "camera_to_world": front_view(1.5).tolist()}))
    files = {name: str(tmp_path / file) for name, file in (("mask", "mask.png"), ("depth", "depth.npy"), ("camera", "camera.json"))}
    seen = observe(large, ObserveSettings(**files), NoProgress())
    assert seen.masks.shape == (FRAMES, height, width) and seen.image.shape == seen.background.shape == (height, width, 3)
    assert (seen.camera.width, seen.camera.height) == (width, height)
    assert (seen.camera.fx, seen.camera.fy, seen.camera.cx, seen.camera.cy) == pytest.approx((2000.0, 2010.0, 880.0, 633.0))
    true = np.stack([cv2.resize(one.astype(np.uint8), (width, height)) > 0 for one in disc.masks[:FRAMES]])
    overlap = (seen.masks & true).sum(axis=(1, 2)) / (seen.masks | true).sum(axis=(1, 2))
    assert overlap.min() > 0.9
    inner = cv2.erode(mask, np.ones((15, 15), np.uint8)) > 0
    rows, columns = np.nonzero(inner)
    assert seen.depth[rows, columns] == pytest.approx(np.linspace(1.0, 2.0, width)[columns], abs=2e-3)
    start = (seen.xy[0] + 0.5) / TIMES - 0.5
    alive = seen.visible[-1]
    off = np.linalg.norm(seen.xy[-1, alive] - outward(disc.moved(start[alive], FRAMES - 1)), axis=1)
    assert alive.sum() > 40 and np.median(off) < 0.25 * TIMES
    assert (seen.sigma > 0.06).all()


def test_box_points_and_tracks_are_given_in_the_files_pixels(disc: Scene, large: Path, tmp_path: Path) -> None:
    start = disc.centers[0] + np.array([[0.0, 0.0], [10.0, 5.0], [-8.0, 12.0]])
    xy = outward(np.stack([disc.moved(start, t) for t in range(FRAMES)]))
    np.savez(tmp_path / "tracks.npz", xy=xy, visible=np.ones(xy.shape[:2], bool))
    middle = outward(disc.centers[0])
    settings = ObserveSettings(points=(middle[0], middle[1]), tracks=str(tmp_path / "tracks.npz"), pixels_per_metre=900.0)
    seen = observe(large, settings, NoProgress())
    assert seen.xy == pytest.approx(xy, abs=1e-6)
    assert np.median(seen.depth[seen.masks[0]]) == pytest.approx(seen.camera.fx / 900.0, rel=1e-6)
    box = outward(np.reshape(disc.box, (2, 2)) + [[-3, -3], [3, 3]]).ravel()
    marked = observe(large, ObserveSettings(box=tuple(box), distance=1.0, frames=(0, 1)), NoProgress()).masks[0]
    assert (marked & seen.masks[0]).sum() > 0.9 * (marked | seen.masks[0]).sum()


def test_files_of_another_size_are_refused_by_name(disc: Scene, large: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "small.png"), disc.masks[0].astype(np.uint8))
    for option in ("mask", "pin"):
        with pytest.raises(UsageError, match="small.png is 220x160, the clip 1760x1280"):
            more = {} if option == "mask" else {"box": (100.0, 200.0, 900.0, 900.0)}
            observe(large, ObserveSettings(**{option: str(tmp_path / "small.png")}, **more, distance=1.0), NoProgress())


def test_size_is_chosen_by_the_frame_and_the_object() -> None:
    assert working_scale(ObserveSettings(), 720, 1280) == 1.0
    assert working_scale(ObserveSettings(), 2160, 3840) == pytest.approx(LONGEST / 3840)
    assert working_scale(ObserveSettings(box=(0.0, 0.0, 90.0, 40.0)), 2160, 3840) == 1.0, "a small thing keeps its pixels"
    size = WorkingSize(2160, 3840, LONGEST / 3840)
    points = np.array([[0.0, 0.0], [3839.0, 2159.0], [100.5, 7.25]])
    assert size.outward(size.inward(points)) == pytest.approx(points)
    assert size.inward(np.array([-0.5, -0.5])) == pytest.approx([-0.5, -0.5])
    assert WorkingSize(1, 20000, LONGEST / 20000).work == (1, LONGEST), "not even a line of pixels gets lost"
