"""What is wrong with any job of a file is said before the first one starts, in the file's own words."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from quick import clip, messages, start, trajectories

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.batch.in_order import run_in_order
from seeing_wind.engine.command.batch.jobs import FIELD, Job, read_jobs
from seeing_wind.engine.command.batch.summary import Summary
from seeing_wind.engine.command.batch.verb import batch
from seeing_wind.engine.errors import SeeingWindError
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.take import Take

FIRST = '[[job]]\nname = "first"\nclip = "clip.avi"\ntake = "first.take"\n'
LEAF = '[[job]]\nname = "leaf"\nclip = "clip.avi"\ntake = "leaf.take"\n'
EDIT = LEAF + 'edit = "edit.toml"\n'
BODY = '[[body]]\nname = "leaf"\nmesh = "{0}"\n'


@pytest.fixture
def refused(tmp_path: Path) -> Callable[[str], SeeingWindError]:
    """The error of a batch of a good job and those of a text; that nothing was begun is checked."""
    clip(tmp_path / "clip.avi")
    cv2.imwrite(str(tmp_path / "small.png"), np.full((10, 10), 255, np.uint8))
    for name, rows in (("black", 0), ("part", 9), ("whole", 64)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.where(np.arange(64)[:, None] < rows, np.full(96, 255), 0).astype(np.uint8))
    (tmp_path / "text.png").write_text("not an image")
    (tmp_path / "edit.toml").write_text(BODY.format("recovered"))

    def run(text: str) -> SeeingWindError:
        (tmp_path / "jobs.toml").write_text(FIRST + text)
        with pytest.raises(SeeingWindError) as caught:
            batch(of_file(tmp_path / "jobs.toml"), NoProgress())
        assert not (tmp_path / "first.take").exists() and not (tmp_path / "jobs.summary.json").exists()
        assert caught.value.exit_code == 2
        return caught.value

    return run


def of_file(jobs: Path) -> argparse.Namespace:
    return parser().parse_args(["batch", str(jobs)])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("distance = -1", "`distance` must be at least 0.01 m; this is -1."),
        ("bx = [20, 20, 44, 44]", "Unknown options: `bx` 20 20 44 44. See docs/reference/cli.md for the options of `recover`."),
        ('box = [20, 20, 44, 44], points = "1,1"', "`points` is not allowed with `box`."),
        ('frames = "0:9"', "clip.avi has frames 0 to 4, so 0:9 reaches past its end. Choose `frames` inside 0:4."),
        ("box = [200, 200, 240, 240]", "The box 200 200 240 240 lies outside the 96x64 frame."),
        ('mask = "text.png"', "text.png cannot be read: it is not an image, or is damaged."),
        ('pin = "small.png"', "small.png is 10x10, the clip 96x64."),
        ('outline = "small.png"', "small.png is 10x10, the clip 96x64."),
        ('mask = "black.png"', "The object covers 0 pixels of the first frame, too few to follow."),
        ('mask = "whole.png"', "The object covers the whole first frame."),
        ('outline = "black.png"', "black.png has 0 pixels, too few for an object."),
        ('pin = "black.png"', "The pinned pixels do not touch the object."),
        ('mask = "part.png", pin = "part.png"', "part.png covers the whole object, so nothing of it could move."),
        ('camera = "text.png"', "The camera"),
        ('depth = "text.png"', "is not an NPY array"),
        ('tracks = "text.png"', "are not an NPZ of plain arrays"),
        ('head_material = "unobtainium"', "There is no material 'unobtainium'."),
        ('leaf_material = "clay"', "`leaf_material` clay cannot be used: clay has the plastic law"),
        ('form = "sheet", material = "steel"', "steel is not known as a sheet. Give one of cotton, denim,"),
        ('form = "sheet", law = "von_mises", yield_stress = 1e4', "A sheet is elastic: it has no plastic law. Leave `law` out"),
        ('schedule = "paper", iterations = 5', "`iterations` 5 belongs to the default schedule."),
    ],
)
def test_options_and_the_files_that_they_name(refused, options: str, says: str) -> None:
    error = refused(LEAF + f"recover = {{ {options} }}\n")
    assert error.message.startswith('"leaf": ') and says in str(error) and "--" not in str(error)


def test_tracks_that_are_not_finite(refused, tmp_path: Path) -> None:
    np.savez(tmp_path / "tracks.npz", xy=np.full((5, 3, 2), np.nan), visible=np.ones((5, 3), bool))
    assert "track 0 is visible in row 0, at [nan, nan]" in refused(LEAF + 'recover = { tracks = "tracks.npz" }').message


@pytest.mark.parametrize(("place", "seen"), [(30.0, 0), (300.0, 1), (-20.0, 1)], ids=["never visible", "right of it", "left of it"])
def test_tracks_that_are_not_in_the_picture(refused, tmp_path: Path, place: float, seen: int) -> None:
    np.savez(tmp_path / "tracks.npz", xy=np.full((5, 3, 2), place), visible=np.full((5, 3), seen))
    said = refused(LEAF + 'recover = { tracks = "tracks.npz" }').message
    assert said == '"leaf": No track of tracks.npz is visible on the object in the first frame.'


@pytest.mark.parametrize("marked", ['mask = "part.png"', "box = [0, 0, 40, 9]"])
def test_tracks_beside_the_object(refused, tmp_path: Path, marked: str) -> None:
    np.savez(tmp_path / "tracks.npz", xy=np.full((5, 3, 2), [30.0, 20.0]), visible=np.ones((5, 3), bool))
    said = refused(LEAF + f'recover = {{ tracks = "tracks.npz", {marked} }}').message
    assert said == '"leaf": No track of tracks.npz is visible on the object in the first frame.'
    added = refused(LEAF + f'recover = {{ tracks = "tracks.npz", {marked}, outline = "black.png" }}').message
    assert "black.png has 0 pixels" in added, "what is drawn in a later frame may add to the object"


def test_tracks_of_which_few_are_on_the_mask(tmp_path: Path) -> None:
    clip(tmp_path / "clip.avi")
    cv2.imwrite(str(tmp_path / "part.png"), np.where(np.arange(64)[:, None] < 9, np.full(96, 255), 0).astype(np.uint8))
    places = np.array([[30.0, 5.0], [30.0, 40.0], [10.0, 50.0]])
    np.savez(tmp_path / "tracks.npz", xy=np.tile(places, (5, 1, 1)), visible=np.ones((5, 3), bool))
    (tmp_path / "jobs.toml").write_text(LEAF + 'recover = { tracks = "tracks.npz", mask = "part.png" }')
    told: list[dict] = []
    batch(parser().parse_args(["batch", str(tmp_path / "jobs.toml"), "--check"]), Progress(told.append))
    assert [one["message"] for one in told if one["type"] == "warning"] == [
        "leaf: 2 of 3 tracks do not start on the object in the first frame and are left out.",
        "leaf: One track shows where the object is, but not how it turns or bends. Give three or more that start on it.",
    ]


def test_clips_and_trajectories(refused, tmp_path: Path) -> None:
    (tmp_path / "text.avi").write_text("not a video\n" * 100)
    assert "text.avi is not a video" in refused(LEAF.replace("clip.avi", "text.avi")).message
    trajectories(tmp_path / "t.npz", np.nan)
    wrong = '[[job]]\nname = "t"\ntrajectories = "t.npz"\ntake = "t.take"\n'
    assert "the position of particle 0 in frame 0 is not finite" in refused(wrong).message
    trajectories(tmp_path / "t.npz", 1.0)
    with np.load(tmp_path / "t.npz") as arrays:
        np.savez(tmp_path / "t.npz", **arrays, visible=np.zeros(arrays["x"].shape[:2], bool))
    assert "27 of 27 points are not visible in frame 0" in refused(wrong).message
    trajectories(tmp_path / "t.npz", 1.0)
    assert "Unknown options: `fps`" in refused(wrong + "recover = { fps = 3 }\n").message


def test_the_files_of_a_further_view(refused, tmp_path: Path) -> None:
    clip(tmp_path / "side.avi")
    camera = {"width": 96, "height": 64, "fx": 90.0, "fy": 90.0, "cx": 47.5, "cy": 31.5, "camera_to_world": np.eye(4).tolist()}
    (tmp_path / "side.json").write_text(json.dumps(camera))
    for view, says in (('"side.json", "small.png"', "small.png is 10x10, the clip 96x64."), ('"text.png", "part.png"', "The camera")):
        assert says in refused(LEAF + f'recover = {{ view = ["side.avi", {view}] }}\n').message


def test_a_list_of_objects(refused, tmp_path: Path) -> None:
    (tmp_path / "objects.json").write_text('{"objects": [{"name": "leaf"}]}')
    said = refused(LEAF + 'recover = { objects = "objects.json" }\n').message
    assert said.startswith('"leaf": ') and "these values of object 1 are missing or of the wrong kind: object, material, mask" in said


def test_takes_of_something_else(refused, tmp_path: Path) -> None:
    take = Take(tmp_path / "leaf.take")
    (tmp_path / "other.avi").write_bytes(b"another clip")
    take.finish("observe", "0", {"clip": str(tmp_path / "other.avi")})
    error = refused(LEAF)
    assert "leaf.take is the take of another clip" in error.message and "with `take`" in error.hint
    take.finish("observe", "0", {"clip": str(tmp_path / "clip.avi")})
    (tmp_path / "leaf.edit.take").mkdir()
    (tmp_path / "leaf.edit.take" / FIELD).touch()
    error = refused(EDIT)
    assert "leaf.edit.take is the take of a recovery" in error.message and "with `edit_take`" in error.hint
    (tmp_path / "leaf.edit.take" / FIELD).unlink()
    Take(tmp_path / "leaf.edit.take").finish("resimulate", "0", {"edit": str(tmp_path / "panel.toml")})
    assert "holds the re-simulation of another edit" in refused(EDIT).message


def test_edits_and_their_meshes(refused, tmp_path: Path) -> None:
    (tmp_path / "edit.toml").write_text(BODY.format("flag.obj"))
    assert "There is no file flag.obj of " in refused(EDIT).message
    for text in (BODY.format("recovered") + "[[collider]]\nname = 'wall'\nmesh = 'small.png'\n", BODY.format("small.png")):
        (tmp_path / "edit.toml").write_text(text)
        assert "has the ending .png, and a mesh is read from .obj, .ply, .npz." in refused(EDIT).message
    (tmp_path / "edit.toml").write_text(BODY.format("first.take/flag.fbx"))
    assert "has the ending .fbx" in refused(EDIT).message, "whoever makes it"
    (tmp_path / "edit.toml").write_text(BODY.format("first.take/flag.obj") + "mass = -1\n")
    assert "mass must be at least" in refused(EDIT).message


def test_what_a_job_above_makes_and_what_is_done_is_not_checked(refused, tmp_path: Path) -> None:
    (tmp_path / "edit.toml").write_text(BODY.format("first.take/flag.obj"))
    (tmp_path / "first.take").mkdir()
    for name in ("take.lock", "held.png"):
        (tmp_path / "first.take" / name).write_text("of a former run, and damaged")
    (tmp_path / "done.avi").write_bytes(b"was a clip")
    done = '[[job]]\nname = "done"\nclip = "done.avi"\ntake = "done.take"\n'
    (tmp_path / "jobs.toml").write_text(FIRST + done + EDIT + 'recover = { pin = "first.take/held.png" }\n')
    summary = Summary(tmp_path / "jobs.toml", read_jobs(tmp_path / "jobs.toml"), whole=False, again=False)

    def make(job: Job, made: bool) -> None:
        if job.name != "done":
            raise SeeingWindError("Not now.")
        job.take.mkdir()
        (job.take / FIELD).touch()
        np.savez(job.take / "trajectory.npz", notes=np.array("[]"))

    run_in_order(summary, make, lambda line: None)
    (tmp_path / "clip.avi").write_bytes(b"no clip")
    with pytest.raises(SeeingWindError, match='^"first": .*clip.avi is not a video'):
        batch(of_file(tmp_path / "jobs.toml"), NoProgress())
    (tmp_path / "jobs.toml").write_text((tmp_path / "jobs.toml").read_text().replace(FIRST, FIRST.replace("clip.avi", "good.avi")))
    clip(tmp_path / "good.avi")
    with pytest.raises(SeeingWindError, match='^"leaf": .*clip.avi is not a video'):
        batch(of_file(tmp_path / "jobs.toml"), NoProgress())


def test_a_failure_is_told_in_the_files_own_keys(tmp_path: Path) -> None:
    for name in ("clip.avi", "edit.toml"):
        (tmp_path / name).touch()
    (tmp_path / "jobs.toml").write_text(FIRST + EDIT)
    jobs = read_jobs(tmp_path / "jobs.toml")
    summary = Summary(tmp_path / "jobs.toml", jobs, whole=False, again=False)
    takes = {"first": jobs[0].take, "leaf": jobs[1].edit_take}

    def fail(job: Job, made: bool) -> None:
        raise SeeingWindError(f"{takes[job.name]} is in use.", "Choose another folder with --take, or `--frames 0:4`; see --help.")

    run_in_order(summary, fail, lambda line: None)
    rows = json.loads((tmp_path / "jobs.summary.json").read_text())["jobs"]
    for row, key in zip(rows, ("take", "edit_take"), strict=True):
        assert row["message"].endswith(f"is in use. Choose another folder with `{key}`, or `frames 0:4`; see --help.")


def test_a_file_can_be_checked_alone(refused, tmp_path: Path) -> None:
    refused(LEAF + "recover = { distance = 0 }\n")
    for text, code in ((FIRST + EDIT, 0), (FIRST + EDIT + "recover = { distance = 0 }\n", 2)):
        (tmp_path / "jobs.toml").write_text(text)
        process = start(tmp_path / "jobs.toml", "--check")
        (result,) = [one for one in messages(process) if one["type"] == "result"]
        assert process.returncode == code and result.get("checked") == (2 if code == 0 else None)
    assert not (tmp_path / "first.take").exists() and not (tmp_path / "jobs.summary.json").exists()
