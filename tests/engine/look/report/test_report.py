"""report.json, report.png and overlay.mp4 of a small made-up recovery."""

from __future__ import annotations

import dataclasses
import json

import cv2
import numpy as np
import pytest

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import ClipError
from seeing_wind.engine.look.report import report as module
from seeing_wind.engine.look.report import write_overlay, write_report, write_trajectory_report
from seeing_wind.engine.look.report.figure import GREY
from seeing_wind.engine.materials import Material
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from seeing_wind.engine.records import Attachment, Body, Camera, Gaussians, Observation, Outcome, Particles, Recovery, Surface
from seeing_wind.engine.recovery.journal import TakeJournal
from seeing_wind.engine.take import Take, stamp_of
from tests.engine.fields import UniformField

FRAMES, COUNT, FPS = 5, 40, 20.0
BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
FORCE = np.array([30.0, 0.0, 10.0])
CAMERA = Camera(161, 121, 150.0, 150.0, 80.0, 60.0, front_view(2.0))


def recovery() -> tuple[Recovery, Particles]:
    rest = np.random.default_rng(0).uniform(-0.15, 0.15, (COUNT, 3))
    x = rest + np.linspace(0, 1, FRAMES + 1)[:, None, None] * [0.3, 0, 0.1]
    residual = np.array([0.1, 0.2, 0.3, np.nan, 0.5, 0.6])
    found = Recovery(
        Outcome.CONVERGED, np.tile(FORCE, (FRAMES, COUNT, 1)), np.ones((FRAMES, COUNT)), x, np.tile(np.eye(3), (FRAMES + 1, COUNT, 1, 1)),
        np.zeros((COUNT, 3)), residual, "px", 6, 2.5, ["stiffness capped"],
    )  # fmt: skip
    return found, Particles(rest, np.full(COUNT, 2e-4), np.zeros(COUNT, dtype=bool), 0.05)


def observation(clip: str) -> Observation:
    image = np.full((CAMERA.height, CAMERA.width, 3), 128, dtype=np.uint8)
    masks = np.zeros((FRAMES + 1, CAMERA.height, CAMERA.width), dtype=bool)
    masks[:, 45:75, 65:95] = True
    xy = np.tile(np.array([[70.0, 50.0], [85.0, 70.0]]), (FRAMES + 1, 1, 1))
    seen = np.ones((FRAMES + 1, 2), dtype=bool)
    depth = np.full(image.shape[:2], np.inf, dtype=np.float32)
    return Observation(
        clip, FPS, 0, CAMERA, image, image, masks, depth, np.zeros(image.shape[:2], bool), xy, seen, np.ones(seen.shape), np.zeros(2, bool)
    )


def body(particles: Particles) -> Body:
    ride = Attachment(np.zeros((2, 1), dtype=np.int32), np.ones((2, 1)))
    gaussians = Gaussians(np.zeros((2, 3)), np.ones((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)), np.ones(2), np.zeros((2, 1, 3)), ride)
    surface = Surface(np.zeros((2, 3)), np.zeros((0, 3), np.int32), np.zeros((2, 2)), ride)
    return Body(particles, Material("leaf", "corotated", 700.0, 1e6, 0.3), gaussians, surface, ride, np.zeros((FRAMES + 1, 2, 3)))


@pytest.fixture
def frames(tmp_path) -> str:
    folder = tmp_path / "clip"
    folder.mkdir()
    for index in range(FRAMES + 1):
        cv2.imwrite(str(folder / f"{index:03d}.png"), observation("").image)
    return str(folder)


def test_all_files(tmp_path, frames):
    found, particles = recovery()
    take, field = Take(tmp_path / "a.take"), UniformField(BOX, FPS, FRAMES, FORCE)
    seconds = {"observe": 1.0, "recover": 2.5}
    figures = write_report(take, observation(frames), body(particles), found, field, seconds, expected={"recover": 4.0})
    assert json.loads(take.file("report.json").read_text()) == figures
    assert figures["outcome"] == "converged" and figures["iterations"] == 6 and figures["notes"] == ["stiffness capped"]
    assert figures["seconds"] == {"observe": 1.0, "recover": 2.5, "total": 3.5} and figures["expected_seconds"] == {"recover": 4.0}
    assert figures["residual"] == {"median": 0.3, "p90": pytest.approx(0.56), "max": 0.6}
    assert figures["residual_per_frame"][3] is None
    assert np.allclose(figures["net_force"], FORCE * COUNT * 2e-4)
    assert figures["confidence"]["mean"] == 1.0
    page = cv2.imread(str(take.file("report.png")))
    assert page.shape[1] > 1000 and page.std() > 20
    names = ["gaussians.ply", "overlay.mp4", "report.json", "report.png", "resimulated.mp4"]
    assert sorted(path.name for path in take.path.iterdir()) == names


def test_levels(tmp_path, frames):
    found, particles = recovery()
    field, seen = UniformField(BOX, FPS, FRAMES, FORCE), observation(frames)
    none = write_report(Take(tmp_path / "none.take"), seen, body(particles), found, field, {}, level="none")
    assert not (tmp_path / "none.take").exists() and none["report"]["level"] == "none" and none["frames"] == FRAMES
    quick = write_report(Take(tmp_path / "quick.take"), seen, body(particles), found, field, {}, level="quick")
    assert sorted(path.name for path in (tmp_path / "quick.take").iterdir()) == ["overlay.mp4", "report.json", "report.png"]
    assert "resimulated" not in quick and set(quick["report"]["seconds"]) == {"report.png", "clip", "overlay.mp4"}
    write_trajectory_report(Take(tmp_path / "t.take"), particles, body(particles).material, found, field, {}, level="none")
    assert not (tmp_path / "t.take").exists()


def test_a_product_that_cannot_be_made_does_not_cost_the_others(tmp_path, frames, monkeypatch, capsys):
    found, particles = recovery()
    field, told = UniformField(BOX, FPS, FRAMES, FORCE), []
    take = Take(tmp_path / "a.take")
    monkeypatch.setattr("seeing_wind.engine.observe.clip.video.CODECS", ())
    figures = write_report(take, observation(frames), body(particles), found, field, {}, progress=Progress(told.append))
    assert set(figures["report"]["missing"]) == {"overlay.mp4", "resimulated.mp4"}
    assert "codecs" in figures["report"]["missing"]["overlay.mp4"] and json.loads(take.file("report.json").read_text()) == figures
    assert sorted(path.name for path in take.path.iterdir()) == ["gaussians.ply", "report.json", "report.png"]
    warned = [one["message"] for one in told if one["type"] == "warning"]
    assert len(warned) == 2 and warned[0].startswith("The report's overlay.mp4 could not be made. This OpenCV can write none of")

    monkeypatch.setattr("seeing_wind.engine.look.report.report.draw_report", lambda *arguments: cv2.getLogLevelOfOldVersions())
    gone = write_report(Take(tmp_path / "b.take"), observation(str(tmp_path / "gone.mp4")), body(particles), found, field, {})
    assert set(gone["report"]["missing"]) == {"report.png", "clip"} and "no clip" in gone["report"]["missing"]["clip"]
    assert "Unexpected AttributeError" in gone["report"]["missing"]["report.png"] and "Traceback" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "b.take").iterdir()] == ["report.json"]


def test_a_force_that_is_not_seen_is_grey(tmp_path):
    found, particles = recovery()
    take, field = Take(tmp_path / "a.take"), UniformField(BOX, FPS, FRAMES, FORCE)

    def grey(one: Recovery) -> tuple[list[int], int]:
        """The frames that report.json names, and pixels of the net force's curve in report.png that are of its grey."""
        figures = write_trajectory_report(take, particles, body(particles).material, one, field, {})
        page = cv2.imread(str(take.file("report.png")))[100:400, 60:700]
        return figures["wild_frames"], int((page == [int(GREY[at : at + 2], 16) for at in (5, 3, 1)]).all(axis=-1).sum())

    (none, few), (frames, many) = grey(found), grey(dataclasses.replace(found, wild=np.arange(FRAMES) >= 3))
    assert none == [] and frames == [3, 4] and many > few + 200


@pytest.mark.slow
def test_what_a_killed_report_has_made_is_not_made_again(tmp_path, frames, monkeypatch):
    found, particles = recovery()
    seen, field = observation(frames), UniformField(BOX, FPS, FRAMES, FORCE)
    whole = write_report(Take(tmp_path / "whole.take"), seen, body(particles), found, field, {})
    take, made = Take(tmp_path / "a.take"), []

    class Killed(BaseException):
        pass

    def watched(name):
        work = getattr(module, name)

        def begun(*arguments):
            made.append(name)
            if made.count("write_resimulated") == 1 == made.count(name) and name == "write_resimulated":
                raise Killed
            return work(*arguments)

        return begun

    for name in ("write_overlay", "look_over_clip", "write_resimulated"):
        monkeypatch.setattr(module, name, watched(name))
    with pytest.raises(Killed), TakeJournal(take, "report", NoProgress()) as journal:
        write_report(take, seen, body(particles), found, field, {}, journal=journal)
    with TakeJournal(take, "report", NoProgress()) as journal:
        resumed = write_report(take, seen, body(particles), found, field, {}, journal=journal)
    assert made == ["write_overlay", "look_over_clip", "write_resimulated", "write_resimulated"]
    assert resumed["resimulated"] == whole["resimulated"] and not resumed["report"]["missing"]
    for name in ("overlay.mp4", "resimulated.mp4", "gaussians.ply"):
        assert take.file(name).read_bytes() == (tmp_path / "whole.take" / name).read_bytes()
    take.file("overlay.mp4").unlink()
    with TakeJournal(take, "report", NoProgress()) as journal:
        journal.keep("overlay.mp4 0", stamp_of(), {"found": np.array("null")})
        write_report(take, seen, body(particles), found, field, {}, level="quick", journal=journal)
    assert take.file("overlay.mp4").is_file(), "a film that somebody has removed is made again, whatever the journal says"


def test_a_clip_that_was_replaced_is_not_drawn_on(tmp_path, frames):
    found, particles = recovery()
    seen, field = observation(frames), UniformField(BOX, FPS, FRAMES, FORCE)
    for path in sorted((tmp_path / "clip").iterdir()):
        cv2.imwrite(str(path), np.zeros((50, 60, 3), np.uint8))
    figures = write_report(Take(tmp_path / "a.take"), seen, body(particles), found, field, {}, level="quick")
    assert "60x50 now" in figures["report"]["missing"]["clip"]


def test_the_stiffness_that_was_found_stands_beside_the_one_given(tmp_path):
    found, particles = recovery()
    field, given = UniformField(BOX, FPS, FRAMES, FORCE), body(particles).material
    plain = write_trajectory_report(Take(tmp_path / "a.take"), particles, given, found, field, {})
    softer = dataclasses.replace(found, youngs_modulus=8e5, stiffness_deviation=0.03, clamp_depth=0.7)
    told = write_trajectory_report(Take(tmp_path / "b.take"), particles, given, softer, field, {})
    assert "stiffness" not in plain and plain["material"]["youngs_modulus"] == 1e6
    assert told["stiffness"] == {"youngs_modulus": 8e5, "given": 1e6, "relative_deviation": 0.03, "clamp_depth": 0.7}
    assert told["material"]["youngs_modulus"] == 8e5


def test_a_report_without_a_clip_or_anything_seen(tmp_path):
    found, particles = recovery()
    found = dataclasses.replace(found, residual=np.full(FRAMES + 1, np.nan), residual_unit="m")
    take = Take(tmp_path / "b.take")
    figures = write_trajectory_report(take, particles, body(particles).material, found, UniformField(BOX, FPS, FRAMES, FORCE), {})
    assert figures["residual"] == {} and set(figures["residual_per_frame"]) == {None}
    assert "NaN" not in take.file("report.json").read_text()
    assert cv2.imread(str(take.file("report.png"))) is not None


def read(path) -> np.ndarray:
    capture, frames = cv2.VideoCapture(str(path)), []
    while True:
        good, frame = capture.read()
        if not good:
            return np.array(frames)
        frames.append(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB).astype(int))


def test_arrows_stand_on_the_object_and_point_with_the_force(tmp_path):
    found, _ = recovery()
    seen, field = observation("clip"), UniformField(BOX, FPS, FRAMES, [40.0, 0.0, 0.0])
    write_overlay(Take(tmp_path), [seen.image] * (FRAMES + 1), seen, found, field)
    path = tmp_path / "overlay.mp4"
    video = read(path)
    assert video.shape == (FRAMES + 1, 726, 966, 3), "enlarged to whole multiples, with even sides"
    colourful = np.ptp(video, axis=-1) > 60
    zoom = 6
    for frame in (0, FRAMES):
        xy, _ = seen.camera.project(found.x[frame], frame)
        low, high = xy.min(axis=0) * zoom, xy.max(axis=0) * zoom
        inside = colourful[frame, int(low[1]) : int(high[1]), int(low[0]) : int(high[0])]
        assert inside.mean() > 0.02
        # nothing is drawn left of the object, as the force points right
        assert colourful[frame, int(low[1]) : int(high[1]), 200 : int(low[0]) - 8].mean() < 0.001


def test_untrusted_forces_are_not_drawn(tmp_path):
    class Doubtful(UniformField):
        def _confidence(self, points, frame):
            return np.full(len(points), 0.05)

    found, _ = recovery()
    seen = observation("clip")
    write_overlay(Take(tmp_path), [seen.image] * (FRAMES + 1), seen, found, Doubtful(BOX, FPS, FRAMES, FORCE))
    video = read(tmp_path / "overlay.mp4")
    assert (np.ptp(video[:, 250:500, 350:700], axis=-1) > 60).mean() < 0.001


def test_a_clip_that_has_become_shorter(tmp_path):
    found, _ = recovery()
    seen = observation("clip")
    with pytest.raises(ClipError, match="has 3 frames, the recovery 6"):
        write_overlay(Take(tmp_path / "c.take"), [seen.image] * 3, seen, found, UniformField(BOX, FPS, FRAMES, FORCE))
    assert not (tmp_path / "c.take").exists(), "nothing half-written"


def test_cancelling_leaves_nothing(tmp_path):
    found, _ = recovery()
    seen = observation("clip")
    with pytest.raises(Cancelled):
        field = UniformField(BOX, FPS, FRAMES, FORCE)
        write_overlay(Take(tmp_path / "d.take"), [seen.image] * 6, seen, found, field, Progress(cancelled=lambda: True))
    assert not list((tmp_path / "d.take").iterdir())
