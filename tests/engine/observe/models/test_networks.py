"""The adapters of the networks, each with a tiny model of random weights: what comes out has the right shape, place and unit."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("transformers")
sys.path.insert(0, str(Path(__file__).parent))

import tiny  # noqa: E402
import torch  # noqa: E402
from safetensors.torch import load_file, save_file  # noqa: E402

from seeing_wind.engine.errors import MissingPackage, ModelError, ObjectError  # noqa: E402
from seeing_wind.engine.field.torch_threads import one_torch_thread  # noqa: E402
from seeing_wind.engine.observe.models.depth import network_input, predict_depth  # noqa: E402
from seeing_wind.engine.observe.models.masks import MaskModel, find_box  # noqa: E402
from seeing_wind.engine.observe.models.points import LEAST_SIGMA, UNKNOWN_SIGMA, follow_points, noise  # noqa: E402
from seeing_wind.engine.progress import NoProgress, Progress  # noqa: E402

FRAME = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8), (0, 0), 3)


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """On a busy machine, threads wait for each other longer than these networks take to compute."""
    with one_torch_thread():
        yield


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("models")


def test_depth_anything_gives_metres_up_to_its_range(folders: Path) -> None:
    folder = tiny.depth_anything(folders / "depth_anything", max_depth=20)
    depth = predict_depth(str(folder), FRAME, 50.0, NoProgress())
    assert depth.shape == (48, 64) and depth.dtype == np.float32 and 0.0 < depth.min() and depth.max() <= 20.0


def test_relative_depth_has_no_scale_and_is_refused(folders: Path) -> None:
    with pytest.raises(ModelError, match="relative") as caught:
        predict_depth(str(tiny.depth_anything(folders / "relative", kind="relative")), FRAME, 50.0, NoProgress())
    assert "Metric" in caught.value.hint


def test_depth_pro_scales_with_the_focal_length_and_warns_of_another_view(folders: Path) -> None:
    folder = str(tiny.depth_pro(folders / "depth_pro"))
    told: list[dict] = []
    near, far = (predict_depth(folder, FRAME, focal, Progress(told.append)) for focal in (50.0, 100.0))
    middling = (near > 1e-3) & (far < 1e3)
    assert middling.any() and np.allclose(far[middling], 2.0 * near[middling], rtol=1e-3), "depth = focal / (width * output)"
    assert [one for one in told if one["type"] == "warning" and "--fov" in one["message"]]


def test_incomplete_weights_are_an_error_not_random_numbers(folders: Path) -> None:
    folder = tiny.depth_anything(folders / "cut")
    weights = load_file(folder / "model.safetensors")
    save_file(dict(list(weights.items())[3:]), folder / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(ModelError, match="incomplete"):
        predict_depth(str(folder), FRAME, 50.0, NoProgress())
    (folder / "model.safetensors").write_bytes(b"rubbish" * 20)
    with pytest.raises(ModelError, match="cannot be loaded"):
        predict_depth(str(folder), FRAME, 50.0, NoProgress())


def test_frames_are_normalised_as_the_folder_says(tmp_path: Path) -> None:
    white = np.full((10, 20, 3), 255, np.uint8)
    pixels = network_input(white, 8, 4, tmp_path, ((0.5, 0.5, 0.5), (0.25, 0.25, 0.25)))
    assert pixels.shape == (1, 3, 4, 8) and torch.allclose(pixels, torch.tensor(2.0))
    (tmp_path / "preprocessor_config.json").write_text(json.dumps({"image_mean": [0.0, 0.0, 0.0], "image_std": [0.1, 0.1, 0.1]}))
    assert torch.allclose(network_input(white, 8, 4, tmp_path, ((0,) * 3, (1,) * 3)), torch.tensor(10.0))


def test_words_give_a_box_inside_the_frame(folders: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = str(tiny.grounding_dino(folders / "dino"))
    monkeypatch.setattr("seeing_wind.engine.observe.models.masks.SHORT_SIDE", 96)
    monkeypatch.setattr("seeing_wind.engine.observe.models.masks.LEAST_SCORE", 0.0)
    x0, y0, x1, y1 = find_box(folder, "Red leaf", FRAME, NoProgress())
    assert 0 <= x0 < x1 <= 63 and 0 <= y0 < y1 <= 47
    monkeypatch.setattr("seeing_wind.engine.observe.models.masks.LEAST_SCORE", 1.0)
    with pytest.raises(ObjectError, match="red leaf"):
        find_box(folder, "red leaf", FRAME, NoProgress())
    with pytest.raises(ModelError, match="not SAM 2"):
        MaskModel(folder)


def test_sam_masks_have_the_clips_size_and_follow_every_frame(folders: Path) -> None:
    model = MaskModel(str(tiny.sam2(folders / "sam2")))
    first = model.in_box(FRAME, (10.0, 10.0, 40.0, 30.0))
    assert first.shape == (48, 64) and first.dtype == bool
    pointed = model.at_points(FRAME, np.array([[20.0, 15.0], [30.0, 25.0]]))
    assert pointed.shape == (48, 64) and pointed.dtype == bool
    mask = np.zeros((48, 64), bool)
    mask[10:30, 10:40] = True
    frames = np.stack([FRAME, FRAME[::-1], FRAME[:, ::-1]])
    masks = list(model.follow(frames, mask, NoProgress()))
    assert len(masks) == 2 and all(one.shape == (48, 64) and one.dtype == bool for one in masks)


def test_cotracker_says_what_is_missing(tmp_path: Path) -> None:
    save_file({"a": torch.zeros(1)}, tmp_path / "model.safetensors")
    with pytest.raises(MissingPackage, match="cotracker") as caught:
        follow_points(str(tmp_path), np.stack([FRAME] * 3), np.zeros((1, 2)), NoProgress())
    assert "co-tracker" in caught.value.hint


STAND_IN = '''
import torch


class Model(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.step = torch.nn.Parameter(torch.zeros(2))


class CoTrackerPredictor(torch.nn.Module):
    """The interface of the authors' predictor: every point moves by the model's one weight per frame."""

    def __init__(self, checkpoint="x.pth", offline=True, v2=False, window_len=60):
        super().__init__()
        assert checkpoint is None
        self.model = Model()

    def forward(self, video, queries=None):
        print("loading")
        batch, frames, channels, height, width = video.shape
        assert channels == 3 and video.dtype == torch.float32 and queries.shape[2] == 3 and float(queries[..., 0].abs().max()) == 0
        time = torch.arange(frames, dtype=torch.float32)[None, :, None, None]
        tracks = queries[:, None, :, 1:] + time * self.model.step
        return tracks, torch.ones(tracks.shape[:3], dtype=torch.bool)
'''


def test_cotracker_is_asked_for_the_points_and_its_weights_are_safetensors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    package = tmp_path / "site" / "cotracker"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "predictor.py").write_text(STAND_IN)
    monkeypatch.syspath_prepend(package.parent)
    save_file({"step": torch.tensor([20.0, 1.0])}, tmp_path / "model.safetensors")
    points = np.array([[10.0, 5.0], [30.0, 20.0]])
    xy, visible, sigma = follow_points(str(tmp_path), np.stack([FRAME] * 3), points, NoProgress())
    assert np.allclose(xy[1], points + [20.0, 1.0])
    assert visible.tolist() == [[True, True], [True, True], [True, False]], "what left the frame is not seen"
    assert sigma.shape == (3, 2) and (sigma == UNKNOWN_SIGMA).all()
    assert "loading" not in capsys.readouterr().out, "standard output belongs to the engine's messages"


def test_track_noise_is_measured_on_the_track() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(60.0)[:, None, None]
    smooth = 3.0 * time + 0.05 * time**2 + np.zeros((60, 3, 2))
    noisy = smooth + rng.normal(0.0, [[0.8], [0.05], [0.8]], smooth.shape)
    visible = np.ones((60, 3), bool)
    visible[3:, 2] = False
    found = noise(noisy, visible)
    assert found[0] == pytest.approx(0.8, rel=0.25) and found[1] == LEAST_SIGMA and found[2] == UNKNOWN_SIGMA
