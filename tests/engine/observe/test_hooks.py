"""Networks in place of the defaults: each is called at the right moment with the right frame, and its answer is used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from interrupted import assert_same, in_pieces
from scenes import Scene

from seeing_wind.engine.command.arguments import parser, settings_of
from seeing_wind.engine.command.verbs import recover
from seeing_wind.engine.errors import ModelError, UsageError
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.networks import Outlined
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.settings import ObserveSettings

pytest.importorskip("transformers")


class TrueMasks:
    """A mask model that knows the scene."""

    scene: Scene

    def __init__(self, name: str) -> None:
        assert name == "sam"

    def in_box(self, frame: np.ndarray, box: tuple[float, ...]) -> np.ndarray:
        assert np.abs(np.array(box) - self.scene.box).max() < 3
        return self.scene.masks[0]

    def follow(self, frames: np.ndarray, mask: np.ndarray, progress: object):
        assert np.array_equal(mask, self.scene.masks[0])
        yield from self.scene.masks[1:]


def test_words_and_masks(disc: Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    TrueMasks.scene = disc
    monkeypatch.setattr("seeing_wind.engine.observe.models.masks.MaskModel", TrueMasks)
    monkeypatch.setattr("seeing_wind.engine.observe.models.masks.find_box", lambda name, text, frame, progress: disc.box)
    settings = ObserveSettings(prompt="orange disc", detector_model="dino", mask_model="sam", distance=1.5)
    seen = observe(disc.path, settings, NoProgress())
    assert np.array_equal(seen.masks, disc.masks)
    alive = seen.visible[-1] & ~seen.on_centroid
    off = np.linalg.norm(seen.xy[-1, alive] - disc.moved(seen.xy[0, alive], len(disc.frames) - 1), axis=1)
    assert alive.sum() > 20 and np.median(off) < 0.2, "the tracker runs on the network's masks as on its own"
    resumed, kills, images = in_pieces(disc.path, settings, tmp_path, 5, Outlined)
    assert_same(resumed, seen)
    assert kills == (images - 1) // 5 and images == len(disc.frames) - 1


def test_depth_is_the_networks_and_a_distance_scales_it(disc: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    slope = np.broadcast_to(np.linspace(1.0, 3.0, disc.frames.shape[2], dtype=np.float32), disc.frames.shape[1:3])
    asked: list[float] = []

    def predict(name: str, frame: np.ndarray, focal: float, progress: object) -> np.ndarray:
        assert name == "net" and frame.shape == disc.frames[0].shape
        asked.append(focal)
        return slope.copy()

    monkeypatch.setattr("seeing_wind.engine.observe.models.depth.predict_depth", predict)
    seen = observe(disc.path, ObserveSettings(box=disc.box, depth_model="net", fov=60.0), NoProgress())
    assert np.allclose(seen.depth[seen.masks[0]], slope[seen.masks[0]]) and np.isinf(seen.depth[~seen.masks[0]]).all()
    assert asked == [pytest.approx(seen.camera.fx)]
    scaled = observe(disc.path, ObserveSettings(box=disc.box, depth_model="net", distance=6.0), NoProgress())
    inside = scaled.masks[0]
    assert np.median(scaled.depth[inside]) == pytest.approx(6.0, rel=1e-3)
    assert np.ptp(scaled.depth[inside]) == pytest.approx(np.ptp(slope[inside]) * 6.0 / np.median(slope[inside]), rel=1e-2)


def test_tracks_are_the_networks(disc: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    def follow(name: str, frames: np.ndarray, points: np.ndarray, progress: object):
        xy = np.stack([disc.moved(points, t) for t in range(len(frames))])
        return xy, np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], 0.7)

    monkeypatch.setattr("seeing_wind.engine.observe.models.points.follow_points", follow)
    seen = observe(disc.path, ObserveSettings(box=disc.box, track_model="co", distance=1.5), NoProgress())
    assert len(seen.on_centroid) > 20 and (seen.sigma == 0.7).all()
    assert np.abs(seen.xy[5] - disc.moved(seen.xy[0], 5)).max() < 0.05, "up to the tremble that the clip was freed of"


@pytest.mark.parametrize(
    "change",
    [
        {"prompt": "leaf"},
        {"detector_model": "dino"},
        {"prompt": "leaf", "detector_model": "dino", "mask": "m.png"},
        {"depth": "d.npy", "depth_model": "net"},
        {"tracks": "t.npz", "track_model": "co"},
    ],
)
def test_options_that_contradict_each_other(disc: Scene, change: dict) -> None:
    with pytest.raises(UsageError) as caught:
        observe(disc.path, ObserveSettings(**change), NoProgress())
    assert caught.value.hint


def test_a_model_that_is_not_there_stops_before_the_work(disc: Scene) -> None:
    with pytest.raises(ModelError, match="no folder"):
        observe(disc.path, ObserveSettings(box=disc.box, depth_model="no/such"), NoProgress())


def test_the_command_line_names_them_all(disc: Scene, tmp_path: Path) -> None:
    words = ["recover", str(disc.path), "--take", str(tmp_path / "a.take")]
    more = ["--depth-model", "a/b", "--prompt", "red leaf", "--detector-model", "c/d", "--mask-model", "e/f", "--track-model", "g/h"]
    settings = settings_of(ObserveSettings, parser().parse_args([*words, *more]))
    assert (settings.depth_model, settings.prompt, settings.detector_model) == ("a/b", "red leaf", "c/d")
    assert (settings.mask_model, settings.track_model) == ("e/f", "g/h")
    for one in (["--material-endpoint", "http://localhost/v1"], ["--material-model", "any"]):
        with pytest.raises(UsageError, match="belong together"):
            recover(parser().parse_args([*words, *one]), NoProgress())
    with pytest.raises(UsageError, match="no http address"):
        recover(parser().parse_args([*words, "--material-endpoint", "x", "--material-model", "any"]), NoProgress())
    assert not (tmp_path / "a.take").exists()
