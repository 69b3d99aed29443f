"""The take on disk: atomic writes, stamps, records there and back, nothing that executes."""

from __future__ import annotations

import os
import pickle
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.errors import TakeError, UsageError
from seeing_wind.engine.record_arrays import from_arrays, require_take, to_arrays
from seeing_wind.engine.records import Outcome, Recovery
from seeing_wind.engine.settings import BuildSettings
from seeing_wind.engine.take import Take, stamp_of


def recovery() -> Recovery:
    rng = np.random.default_rng(0)
    shape = dict(force_density=(2, 4, 3), deviation=(2, 4, 3), x=(3, 4, 3), F=(3, 4, 3, 3), v0=(4, 3), residual=(3,))
    arrays = {key: rng.normal(size=size) for key, size in shape.items()}
    return Recovery(outcome=Outcome.CONVERGED, residual_unit="px", iterations=3, seconds=1.5, notes=["capped", "ä"], **arrays)


def test_a_record_survives_the_disk(tmp_path: Path) -> None:
    take, before = Take(tmp_path / "ä b.take"), recovery()
    take.write_arrays("trajectory.npz", to_arrays(before))
    after = from_arrays(Recovery, take.read_arrays("trajectory.npz"))
    assert after.outcome is Outcome.CONVERGED and after.notes == before.notes and after.iterations == 3 and after.seconds == 1.5
    np.testing.assert_array_equal(after.F, before.F)


def test_a_failed_write_keeps_the_last_good_file_and_leaves_nothing_behind(tmp_path: Path) -> None:
    take = Take(tmp_path)
    take.write_json("report.json", {"good": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        take.write_json("report.json", {"bad": float("nan")})
    with pytest.raises(RuntimeError), take.writing("report.json") as path:
        path.write_text("half")
        raise RuntimeError
    assert take.read_json("report.json") == {"good": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]


def test_a_full_disk_is_a_take_error(tmp_path: Path) -> None:
    take = Take(tmp_path)
    take.write_json("report.json", {"good": 1})
    with pytest.raises(TakeError, match="No space left"), take.writing("report.json"):
        raise OSError(28, "No space left on device")
    assert take.read_json("report.json") == {"good": 1}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_what_is_no_regular_file_is_not_replaced(tmp_path: Path) -> None:
    take = Take(tmp_path)
    os.mkfifo(take.file("pipe.npz"))
    take.file("folder.npz").mkdir()
    take.file("link.npz").symlink_to("pipe.npz")
    before = {path.name: path.lstat().st_mode for path in tmp_path.iterdir()}
    for name in before:
        with pytest.raises(TakeError, match="not a regular file"):
            take.write_arrays(name, {"a": np.zeros(3)})
    assert {path.name: path.lstat().st_mode for path in tmp_path.iterdir()} == before


@pytest.mark.skipif(os.name == "nt", reason="making links needs a right of its own on Windows")
def test_a_link_to_a_file_is_itself_replaced(tmp_path: Path) -> None:
    take = Take(tmp_path)
    take.write_json("before.json", {"good": 1})
    take.file("link.json").symlink_to("before.json")
    take.write_json("link.json", {"good": 2})
    assert not take.file("link.json").is_symlink() and take.read_json("link.json") == {"good": 2}
    assert take.read_json("before.json") == {"good": 1}


def test_a_folder_that_cannot_be_made_is_a_take_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TakeError, match="Cannot write"):
        Take(tmp_path / "file" / "take").write_json("report.json", {})


def test_a_take_is_seen_to_be_writable_first(tmp_path: Path) -> None:
    Take(tmp_path / "deep" / "take").prepare()
    assert (tmp_path / "deep" / "take").is_dir() and not list((tmp_path / "deep" / "take").iterdir())
    (tmp_path / "file").write_text("x")
    with pytest.raises(UsageError, match="is not a folder"):
        Take(tmp_path / "file").prepare()


def test_pickles_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "evil.npz", a=np.array([{"x": 1}], dtype=object))
    (tmp_path / "worse.npz").write_bytes(pickle.dumps([1, 2]))
    for name in ("evil.npz", "worse.npz", "missing.npz"):
        with pytest.raises(TakeError, match="cannot be read"):
            Take(tmp_path).read_arrays(name)
    with pytest.raises(TypeError, match="object array"):
        Take(tmp_path).write_arrays("evil.npz", {"a": np.array([{}], dtype=object)})


def test_a_stage_is_done_only_with_its_own_stamp(tmp_path: Path) -> None:
    take = Take(tmp_path / "t.take")
    assert not take.is_done("build", "a")
    take.finish("build", "a", {"material": "leaf", "numbers": [1, 2.5], "flag": True, "path": 'C:\\a "b"'})
    take.finish("recover", "b", {})
    assert take.is_done("build", "a") and take.is_done("recover", "b") and not take.is_done("build", "b")
    assert take.description()["stages"]["build"]["settings"]["path"] == 'C:\\a "b"'


def test_a_damaged_description_is_an_error_that_says_so(tmp_path: Path) -> None:
    for text in ("= broken", "stages = 3", "[stages]\nrecover = 3", "[stages.recover]\nsettings = 3"):
        (tmp_path / "take.toml").write_text(text)
        with pytest.raises(TakeError, match=r"take\.toml cannot be read"):
            Take(tmp_path).is_done("recover", "a")


def test_a_take_of_a_newer_format_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "take.toml").write_text("format = 99\n")
    with pytest.raises(TakeError, match="format is 99.*Update Seeing Wind"):
        Take(tmp_path).finish("observe", "stamp", {})
    assert (tmp_path / "take.toml").read_text() == "format = 99\n"


@pytest.mark.parametrize("text", ["format = 99\n", "format = 0\n", 'format = "x"\n', "format = true\n", "format = 1\nstages = [\n", ""])
def test_what_reads_a_take_refuses_one_that_it_does_not_understand(tmp_path: Path, text: str) -> None:
    (tmp_path / "field.safetensors").touch()
    assert require_take(str(tmp_path)).path == tmp_path, "a field alone can be sampled"
    (tmp_path / "take.toml").write_text(text)
    with pytest.raises(TakeError, match=r"take\.toml cannot be read") as error:
        require_take(str(tmp_path))
    assert ("Update" in error.value.hint) == ("99" in text) and ("Remove it" in error.value.hint) == ("99" not in text)


def test_what_is_no_recovery_is_told_with_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "leaf.mp4").touch()
    for name in ("empty", "leaf.edit.take", "moved.take"):
        (tmp_path / name).mkdir()
    for name in ("leaf.edit.take", "moved.take"):
        (tmp_path / name / "resimulation.json").touch()
    Take(tmp_path / "leaf.edit.take").finish("resimulate", "stamp", {"source": "leaf.take", "edit": "edit.toml"})
    for name, says in (
        ("none", "There is no folder .*none. Correct the path"),
        ("leaf.mp4", "leaf.mp4 is a file, not the folder of a take. Give the folder"),
        ("empty", "empty holds no recovered field. Run `recover`"),
        ("leaf.edit.take", "holds a re-simulation, not a recovered field. Give the take that it was simulated in, leaf.take."),
        ("moved.take", "holds a re-simulation, not a recovered field. Give the take that it was simulated in."),
    ):
        with pytest.raises(UsageError) as caught:
            require_take(str(tmp_path / name))
        assert re.search(says, str(caught.value))


def test_stamps_follow_settings_and_file_contents(tmp_path: Path) -> None:
    clip = tmp_path / "clip.bin"
    clip.write_bytes(b"one")
    first = stamp_of(clip, BuildSettings(), np.arange(3))
    assert first == stamp_of(clip, BuildSettings(), np.arange(3))
    assert first != stamp_of(clip, BuildSettings(seed=1), np.arange(3))
    assert first != stamp_of(clip, BuildSettings(), np.arange(4))
    clip.write_bytes(b"two")
    assert first != stamp_of(clip, BuildSettings(), np.arange(3))


def test_an_older_take_is_refused_with_advice(tmp_path: Path) -> None:
    arrays = to_arrays(recovery())
    del arrays["F"]
    with pytest.raises(TakeError, match="lacks F.*run `recover` again"):
        from_arrays(Recovery, arrays)


DAMAGE = [
    ("outcome", "{"),
    ("outcome", '"perfect"'),
    ("outcome", "[]"),
    ("residual_unit", "3"),
    ("iterations", '"3"'),
    ("iterations", "true"),
    ("seconds", "null"),
    ("seconds", "x"),
    ("notes", '"capped"'),
    ("notes", "[1]"),
    ("substeps", "2.5"),
    ("stiffness", "[1.0]"),
    ("x", "[1.0]"),
]


@pytest.mark.parametrize(("key", "text"), DAMAGE)
def test_a_value_that_is_not_what_was_written_is_a_take_error(key: str, text: str) -> None:
    arrays = to_arrays(recovery())
    arrays[key] = np.array(text)
    with pytest.raises(TakeError, match=rf"{key} cannot be read.*run `recover` again"):
        from_arrays(Recovery, arrays)


def test_an_archive_of_something_else_is_a_take_error(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "trajectory.npz", "w") as archive:
        archive.writestr("x", "no array")
    with pytest.raises(TakeError, match="x: it is not an array"):
        Take(tmp_path).read_arrays("trajectory.npz")


def test_what_is_damaged_is_made_again_and_what_is_not_there_first(tmp_path: Path) -> None:
    for read in (Take(tmp_path).read_json, Take(tmp_path).read_arrays):
        with pytest.raises(TakeError, match="no.npz cannot be read: No such file or directory. Run `recover` for this take first."):
            read("no.npz")
        (tmp_path / "cut.npz").write_text("cut")
        with pytest.raises(TakeError, match="cut.npz cannot be read: .* Run `recover` for this take again."):
            read("cut.npz")


def test_unreadable_json_is_a_take_error(tmp_path: Path) -> None:
    for text in ("{", "3"):
        (tmp_path / "report.json").write_text(text)
        with pytest.raises(TakeError, match="cannot be read"):
            Take(tmp_path).read_json("report.json")


@pytest.mark.parametrize("damage", ["empty", "cut", "garbled", "no archive"])
def test_damaged_arrays_are_a_take_error(tmp_path: Path, damage: str) -> None:
    """NumPy raises EOFError, zlib.error, BadZipFile and ValueError for these: a user sees one sentence."""
    path = tmp_path / "trajectory.npz"
    Take(tmp_path).write_arrays(path.name, {"x": np.random.default_rng(0).normal(size=(50, 3))})
    good = path.read_bytes()
    garbled = good[:100] + b"\xff" * 60 + good[160:]
    path.write_bytes({"empty": b"", "cut": good[:200], "garbled": garbled, "no archive": b"PK\x03\x04x"}[damage])
    with pytest.raises(TakeError, match="cannot be read"):
        Take(tmp_path).read_arrays(path.name)


def test_a_take_says_what_a_stage_was_made_from_unless_it_is_damaged(tmp_path: Path) -> None:
    take = Take(tmp_path / "t.take")
    assert take.source_of("observe", "clip") == ""
    take.finish("observe", "stamp", {"clip": "a.mp4", "seed": 3})
    assert [take.source_of("observe", key) for key in ("clip", "seed", "mask")] == ["a.mp4", "", ""]
    take.file("take.toml").write_text("[stages")
    assert take.source_of("observe", "clip") == ""
