"""Verdicts, each provoked; the proposed held place; and the verb, which leaves its observation for `recover`."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import Scene

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.observe import observe
from seeing_wind.engine.observe.clip import frames
from seeing_wind.engine.observe.preview.drawing import Canvas, bar_label, with_verdicts
from seeing_wind.engine.observe.preview.held import propose_held
from seeing_wind.engine.observe.preview.verdicts import Verdict, doubt_remarks, judge
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.records import Doubt, Doubts, Observation
from seeing_wind.engine.recovery import cost
from seeing_wind.engine.settings import ObserveSettings
from seeing_wind.engine.stages import observe_stage
from seeing_wind.engine.take import Take

GIVEN = ObserveSettings(distance=1.5)


def verdict(seen: Observation, item: str, settings: ObserveSettings = GIVEN) -> Verdict:
    """One verdict on `seen`."""
    return next(one for one in judge(seen, settings, propose_held(seen)) if one.item == item)


def swaying(seen: Observation) -> Observation:
    """A post of which the foot stays at the lower edge of the frame while the head swings by 20 px."""
    height, width = seen.masks.height, seen.masks.width
    t = np.arange(len(seen.xy))[:, None]
    y = np.linspace(40.0, height - 20.0, 24)
    bend = ((height - y) / height) ** 2
    xy = np.stack([100.0 + 20.0 * np.sin(0.7 * t) * bend, np.broadcast_to(y, (len(t), len(y)))], axis=-1)
    rows, columns = np.mgrid[:height, :width]
    masks = [
        (np.abs(columns - 100.0 - 20.0 * np.sin(0.7 * at) * ((height - rows) / height) ** 2) < 12) & (rows > 30) for at in range(len(t))
    ]
    return dataclasses.replace(
        seen, masks=np.stack(masks), xy=xy, visible=np.ones(xy.shape[:2], bool), sigma=np.ones(xy.shape[:2]), on_centroid=np.zeros(24, bool)
    )


def test_a_good_clip_is_called_good(disc: Scene, disc_seen: Observation) -> None:
    found = judge(disc_seen, dataclasses.replace(GIVEN, box=tuple(np.add(disc.box, (-6, -6, 6, 6)))), propose_held(disc_seen))
    assert {one.item for one in found if one.severity > 0.0} <= {"blur"}
    assert next(one for one in found if one.item == "outline").because == "It lies within the box and the frame."
    assert verdict(disc_seen, "outline").because == "It lies within the frame.", "where no box was drawn"


def test_the_worst_comes_first(disc_seen: Observation) -> None:
    found = judge(disc_seen, ObserveSettings(), propose_held(disc_seen))
    assert [one.severity for one in found] == sorted((one.severity for one in found), reverse=True)
    assert found[0].verdict == "doubtful" and found[0].do


def test_a_box_that_cuts_the_object(disc: Scene, disc_seen: Observation) -> None:
    x0, y0, x1, y1 = disc.box
    tight = dataclasses.replace(GIVEN, box=(x0, y0, 0.5 * (x0 + x1), y1))
    cut = np.asarray(disc_seen.masks[0]).copy()
    cut[:, int(0.5 * (x0 + x1)) :] = False
    seen = dataclasses.replace(disc_seen, masks=np.stack([cut, *[np.asarray(mask) for mask in disc_seen.masks][1:]]))
    assert "box" in verdict(seen, "outline", tight).because
    assert verdict(seen, "outline", tight).severity > 1.0


def test_a_box_of_which_little_moves(disc: Scene, disc_seen: Observation) -> None:
    x0, y0, x1, y1 = disc.box
    tall = dataclasses.replace(GIVEN, box=(x0 - 6, y0 - 6, x1 + 6, y1 + 2 * (y1 - y0)))
    found = verdict(disc_seen, "outline", tall)
    share = 100 * disc_seen.masks[0].sum() / ((tall.box[2] - tall.box[0]) * (tall.box[3] - tall.box[1]))
    assert found.severity > 0.5 and f"Only {share:.0f} % of the box" in found.because and "--mask" in found.do
    assert any("taken for the background" in one for one in sum(doubt_remarks(disc_seen, tall), []))
    loose = dataclasses.replace(GIVEN, box=(x0 - 6, y0 - 6, x1 + 6, y1 + 0.4 * (y1 - y0)))
    assert verdict(disc_seen, "outline", loose).severity == 0.0, "boxes are drawn loosely"


def test_an_object_at_the_edge_of_the_frame(disc_seen: Observation) -> None:
    masks = np.stack([np.roll(np.asarray(mask), -40, axis=1) for mask in disc_seen.masks])
    masks[:, 60:100, :5] = True
    assert "edge" in verdict(dataclasses.replace(disc_seen, masks=masks, xy=disc_seen.xy - [40.0, 0.0]), "outline").because


def test_few_tracks(disc_seen: Observation) -> None:
    few = disc_seen.visible.copy()
    few[5, 6:] = False
    found = verdict(dataclasses.replace(disc_seen, visible=few), "tracks")
    assert found.severity > 0.0 and "6 points" in found.because


def test_an_outline_whose_points_are_soon_lost(disc_seen: Observation) -> None:
    own = disc_seen.visible[0] & ~disc_seen.on_centroid
    lost = disc_seen.visible.copy()
    lost[5:, np.flatnonzero(own)[: int(0.6 * own.sum())]] = False
    found = verdict(dataclasses.replace(disc_seen, visible=lost), "outline")
    assert found.severity > 0.0 and f"{round(100 * 5 / len(lost))} % of the clip" in found.because and "film" in found.do
    lost = disc_seen.visible.copy()
    lost[5:, np.flatnonzero(own)[: int(0.4 * own.sum())]] = False
    assert verdict(dataclasses.replace(disc_seen, visible=lost), "outline").severity == 0.0, "a side that turns away"
    few = np.zeros_like(disc_seen.visible)
    few[:4, np.flatnonzero(own)[:5]] = True
    assert verdict(dataclasses.replace(disc_seen, visible=few), "outline").severity == 0.0, "too few to say"


def test_the_centroid_alone(disc_seen: Observation) -> None:
    assert verdict(dataclasses.replace(disc_seen, on_centroid=np.ones(disc_seen.xy.shape[1], bool)), "tracks").severity > 0.0


def test_hardly_moving(disc_seen: Observation) -> None:
    still = np.repeat(disc_seen.xy[:1], len(disc_seen.xy), axis=0)
    assert verdict(dataclasses.replace(disc_seen, xy=still), "motion").severity > 1.0
    assert verdict(disc_seen, "motion").severity == 0.0


def test_motion_blur(disc_seen: Observation) -> None:
    fast = disc_seen.xy + np.arange(len(disc_seen.xy))[:, None, None] * np.array([20.0, 0.0])
    assert "blurred" in verdict(dataclasses.replace(disc_seen, xy=fast), "blur").because


def test_out_of_sight(disc_seen: Observation) -> None:
    masks = np.stack([np.asarray(mask) for mask in disc_seen.masks])
    masks[9:] = False
    found = verdict(dataclasses.replace(disc_seen, masks=masks), "sight")
    assert "first in frame 9" in found.because and "--frames 0:8" in found.do


@pytest.mark.parametrize("width", [64, 120, 200, 480, 1080])
def test_no_text_of_a_narrow_clip_is_cut_off(width: int) -> None:
    """Some of its words are wider than the frame."""
    because, do = "It is ASSUMED that the object is 2 m away.", "Give --distance, --pixels-per-metre or --camera."
    frame = np.full((60, width, 3), 28, np.uint8)  # of the colour behind the text
    image = with_verdicts(frame, [Verdict("OUTLINE", 1.0, because, do), Verdict("scale", 0.5, because, do)])
    ink = (image != 28).any(axis=2)
    columns, rows = (np.flatnonzero(ink.any(axis=axis)) for axis in (0, 1))
    assert image.shape[1] == width and columns[0] >= 4 and columns[-1] < width - 4
    assert 60 < rows[0] < 70 and rows[-1] < len(image) - 1


def test_two_frames_show_no_force(disc_seen: Observation) -> None:
    """As `recover` refuses them."""
    few = dataclasses.replace(
        disc_seen, masks=disc_seen.masks[:2], xy=disc_seen.xy[:2], visible=disc_seen.visible[:2], sigma=disc_seen.sigma[:2]
    )
    worst = judge(few, GIVEN, None)[0]
    assert worst.item == "sight" and worst.because.startswith("Points of the object are followed in 2 frames, and a force needs 3")
    alone = dataclasses.replace(few, on_centroid=np.ones(few.xy.shape[1], bool))
    worst = judge(alone, GIVEN, None)[0]
    assert worst.item == "sight" and worst.because.startswith("The object is wholly in view in 2 frames, and a force needs 3")


def test_no_scale(disc_seen: Observation) -> None:
    assert verdict(disc_seen, "scale", ObserveSettings()).severity > 0.0
    assert verdict(disc_seen, "scale", ObserveSettings(pixels_per_metre=300.0)).severity == 0.0
    of_camera = ObserveSettings(camera="camera.json")
    assert "as far away as the world's origin" in verdict(disc_seen, "scale", of_camera).because
    two = next(one for one in judge(disc_seen, of_camera, None, views=2) if one.item == "scale")
    assert two.severity == 0.0
    given = verdict(disc_seen, "scale", ObserveSettings(distance=2.5))
    assert given.severity == 0.0 and "2.5 m" in given.because


def test_a_held_foot_is_proposed(disc_seen: Observation) -> None:
    seen = swaying(disc_seen)
    place = propose_held(seen)
    assert place is not None
    rows, columns = np.nonzero(place)
    assert rows.min() > 0.9 * seen.masks.height and abs(columns.mean() - 100) < 4
    assert verdict(seen, "held place").severity > 1.0
    assert verdict(dataclasses.replace(seen, pin=place), "held place").severity == 0.0
    assert verdict(seen, "outline").severity == 0.0, "the edge where it is held cuts nothing"


def test_a_free_thing_is_not_held(disc_seen: Observation) -> None:
    assert propose_held(disc_seen) is None


@pytest.fixture(scope="module")
def shown(disc: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    take = tmp_path_factory.mktemp("shown") / "a.take"
    box = [str(value) for value in np.add(disc.box, (-5, -5, 5, 5))]
    return take, observe(parser().parse_args(["observe", str(disc.path), "--take", str(take), "--box", *box]), NoProgress())


def test_the_verb_says_how_long_the_solve_takes(disc: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def said(*more: str) -> dict[str, dict]:
        box = [str(value) for value in np.add(disc.box, (-5, -5, 5, 5))]
        words = ["observe", str(disc.path), "--take", str(tmp_path / "a.take"), "--box", *box, *more]
        return {one["item"]: one for one in observe(parser().parse_args(words), NoProgress())["verdicts"]}

    monkeypatch.setenv("TI_OFFLINE_CACHE_FILE_PATH", str(tmp_path / "kernels"))
    assert "time" not in said(), "nothing was measured here"
    monkeypatch.setattr(cost, "_measured", lambda plastic: cost.Speed(copy=2e-7, base=2e-6, change=2e-8))
    cost.measure_speed(plastic=False)
    told = said()["time"]
    assert told["verdict"] == "good" and re.fullmatch(r"The solve takes about (\d+ seconds|a minute) on this machine\.", told["because"])
    assert "time" not in said("--form", "sheet", "--material", "cotton"), "a sheet has a solver of its own"
    found = said("--form", "sheet", "--material", "ice")["body"]
    assert found["severity"] > 0.0 and "not known as a sheet" in found["because"] and found["do"]


def test_the_verb_leaves_image_film_and_verdicts(disc: Scene, shown: tuple[Path, dict]) -> None:
    take, result = shown
    assert result["outcome"] == "converged" and result["verdicts"][0]["severity"] >= result["verdicts"][-1]["severity"]
    assert json.loads((take / "preview.json").read_text())["verdicts"] == result["verdicts"]
    frame = cv2.imread(str(take / "preview.png"))
    assert frame.shape[1] == disc.frames.shape[2] and frame.shape[0] > disc.frames.shape[1]
    blue, level, red = np.moveaxis(frame[: disc.frames.shape[1]].astype(int), 2, 0)
    green = (level > red + 90) & (level > blue + 90)
    rim = cv2.dilate(disc.masks[0].astype(np.uint8), np.ones((7, 7))) - cv2.erode(disc.masks[0].astype(np.uint8), np.ones((7, 7)))
    assert green.sum() > 50 and (green & (rim > 0)).sum() > 0.9 * green.sum()
    film = cv2.VideoCapture(str(take / "preview.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == len(disc.frames)


def test_the_clip_is_decoded_once_and_again_only_where_the_take_has_the_observation(
    disc: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    decode = frames._open
    monkeypatch.setattr(frames, "_open", lambda path: (opened.append(path), decode(path))[1])
    box = [str(value) for value in np.add(disc.box, (-5, -5, 5, 5))]
    words = parser().parse_args(["observe", str(disc.path), "--take", str(tmp_path / "a.take"), "--box", *box, "--frames", "2:9"])
    films = []
    for times in (1, 2):
        observe(words, NoProgress())
        assert len(opened) == times
        films.append((tmp_path / "a.take" / "preview.mp4").read_bytes())
    assert films[0] == films[1]


def test_the_film_shows_the_outline_at_its_own_size(disc: Scene, disc_seen: Observation) -> None:
    size = (disc.frames.shape[1] // 2, disc.frames.shape[2] // 2)
    small = cv2.resize(disc.frames[7], size[::-1], interpolation=cv2.INTER_AREA)
    over = Canvas(dataclasses.replace(disc_seen, visible=np.zeros_like(disc_seen.visible)), None, size).draw_seen(small, 7)
    red, level, blue = np.moveaxis(over.astype(int), 2, 0)
    rows, columns = np.nonzero((level > red + 90) & (level > blue + 90) & (over != small).any(axis=2))
    middle, radius = (disc.centers[7] + 0.5) / 2 - 0.5, 17.0
    away = np.hypot(columns - middle[0], rows - middle[1])
    assert len(away) > 50 and np.abs(away - radius).max() < 2.5


def test_the_scale_bar_is_labelled_as_a_ruler_is() -> None:
    lengths = [digit * 10.0 ** np.float64(power) for power in (-3, -2, -1, 0) for digit in (1.0, 2.0, 5.0)]
    labels = "1 mm, 2 mm, 5 mm, 10 mm, 20 mm, 50 mm, 10 cm, 20 cm, 50 cm, 1 m, 2 m, 5 m"
    assert [bar_label(length) for length in lengths] == labels.split(", ")


def test_recover_goes_on_from_it(disc: Scene, shown: tuple[Path, dict]) -> None:
    take, _ = shown
    words: list[str] = []

    class Told(NoProgress):
        def begin(self, stage: str, message: str = "") -> None:
            words.append(f"{stage}: {message}")

    box = tuple(float(value) for value in np.add(disc.box, (-5, -5, 5, 5)))
    observe_stage(Take(take), str(disc.path), ObserveSettings(box=box), Told())
    assert words == ["observe: already done"]


def test_another_held_place_is_marked_without_observing_again(disc: Scene, shown: tuple[Path, dict], tmp_path: Path) -> None:
    take, _ = shown
    box = tuple(float(value) for value in np.add(disc.box, (-5, -5, 5, 5)))
    settings = ObserveSettings(box=box)
    free, without = observe_stage(Take(take), str(disc.path), settings, NoProgress())
    held = np.zeros(disc.masks[0].shape, np.uint8)
    held[: int(np.nonzero(disc.masks[0])[0].min()) + 6] = 255
    cv2.imwrite(str(tmp_path / "held.png"), held)
    words: list[str] = []

    class Told(NoProgress):
        def begin(self, stage: str, message: str = "") -> None:
            words.append(f"{stage}: {message}")

    marked = dataclasses.replace(settings, pin=str(tmp_path / "held.png"))
    pinned, stamp = observe_stage(Take(take), str(disc.path), marked, Told())
    assert words == ["observe: already done"] and stamp != without, "what is built on it must be built again"
    assert pinned.pin.any() and not (pinned.pin & ~(np.asarray(pinned.masks[0]) & (held > 0))).any()
    assert np.array_equal(pinned.xy, free.xy)
    fresh, same = observe_stage(Take(tmp_path / "fresh.take"), str(disc.path), marked, NoProgress())
    assert same == stamp and np.array_equal(fresh.pin, pinned.pin)
    again, _ = observe_stage(Take(take), str(disc.path), settings, Told())
    assert not again.pin.any(), "a mark that was taken away"


def test_what_grows_moves_along_the_view(disc_seen: Observation) -> None:
    middle = disc_seen.xy.mean(axis=1, keepdims=True)
    grown = middle + (disc_seen.xy - middle) * np.linspace(1.0, 1.25, len(disc_seen.xy))[:, None, None]
    found = verdict(dataclasses.replace(disc_seen, xy=grown), "motion in depth")
    assert found.severity > 0.0 and "grows to 125 %" in found.because and "second view" in found.do
    assert verdict(disc_seen, "motion in depth").severity == 0.0
    masks = np.stack([np.asarray(disc_seen.masks[0]) & (np.arange(disc_seen.masks.width) < 60 + 40 * (t == 0)) for t in range(13)])
    lone = dataclasses.replace(disc_seen, on_centroid=np.ones(disc_seen.xy.shape[1], bool), masks=masks)
    assert "shrinks" in verdict(lone, "motion in depth").because, "by its outline, where there are no points"


def test_doubts_of_the_clip_are_in_the_same_list_and_in_a_recovery_s_notes(disc_seen: Observation) -> None:
    doubts = Doubts.of([Doubt(0.3, "It is pale.", "Convert it."), Doubt(1.5, "It is slow motion.", "Give --fps 240.")])
    kept = from_arrays(Observation, to_arrays(dataclasses.replace(disc_seen, doubts=doubts)))
    found = [one for one in judge(kept, GIVEN, None) if one.item == "clip"]
    assert [(one.severity, one.because, one.do) for one in found] == [
        (1.5, "It is slow motion.", "Give --fps 240."), (0.3, "It is pale.", "Convert it.")
    ]  # fmt: skip
    told = dataclasses.replace(kept, told=("Two of 8 tracks do not start on the object.",))
    severe, others = doubt_remarks(from_arrays(Observation, to_arrays(told)), GIVEN)
    assert severe == ["Clip: It is slow motion. Give --fps 240."]
    assert others == ["Clip: It is pale. Convert it.", "Two of 8 tracks do not start on the object."]
