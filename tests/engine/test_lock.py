"""One writer per take, whoever it is and however it ends."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.lock import NAME, TakeInUse, held
from seeing_wind.engine.command.verbs import VERBS
from seeing_wind.engine.errors import TakeError
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.take import Take

ROOT = Path(__file__).parents[2]
HOLDER = """
import sys
from seeing_wind.engine.command.lock import held
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.take import Take
with held(Take(sys.argv[1]), "recover", NoProgress()):
    print("held", flush=True)
    sys.stdin.read()
"""


@contextmanager
def other_process(folder: Path) -> Iterator[subprocess.Popen]:
    """One that holds the take in `folder`."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(folder)], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def test_the_second_is_told_who_holds_the_take_and_since_when(tmp_path: Path) -> None:
    with other_process(tmp_path) as other:
        with pytest.raises(TakeInUse, match=rf"in use: `recover` \(process {other.pid} on .+\) .* since \d{{4}}-\d\d-\d\d \d\d:") as caught:
            with held(Take(tmp_path), "resimulate", NoProgress()):
                pass
        assert "another folder" in caught.value.hint


@pytest.mark.parametrize("ends", ["by itself", "killed"])
def test_the_lock_ends_with_its_process(tmp_path: Path, ends: str) -> None:
    (tmp_path / NAME).touch()
    with other_process(tmp_path) as other:
        if ends == "killed":
            other.kill()
        other.communicate()
        with held(Take(tmp_path), "resimulate", NoProgress()):
            assert json.loads((tmp_path / NAME).read_text())["pid"] == os.getpid()
    assert (tmp_path / NAME).read_text() == ""


def test_what_the_holder_has_not_written_yet_does_not_matter(tmp_path: Path) -> None:
    with other_process(tmp_path):
        for text in ("", "{", "[" * 10_000, '"x"', '{"verb": 3}'):
            (tmp_path / NAME).write_text(text)
            with pytest.raises(TakeInUse, match="another process"), held(Take(tmp_path), "recover", NoProgress()):
                pass


def test_the_worker_refuses_a_take_that_is_held_and_reads_one_all_the_same(tmp_path: Path) -> None:
    import numpy as np

    from tests.engine.fields import UniformField

    folder = tmp_path / "leaf.take"
    folder.mkdir()
    UniformField(np.array([[-1.0] * 3, [1.0] * 3]), 24.0, 4, np.array([0.0, 0.0, 20.0])).save(folder / "field.safetensors")
    (tmp_path / "edit.toml").write_text('[[body]]\nname = "a"\nmesh = "a.obj"\n')
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    np.save(tmp_path / "points.npy", np.zeros((1, 3)))

    reading = ["sample", folder, "--points", tmp_path / "points.npy", "--frame", 0, "--out", tmp_path / "out.npz"]
    out = tmp_path / "out.take"
    writing = ["resimulate", folder, "--edit", tmp_path / "edit.toml", "--take", out]
    with other_process(folder), other_process(out):
        VERBS["sample"](parser().parse_args([*map(str, reading)]), NoProgress())
        command = [sys.executable, "-m", "seeing_wind.engine", *map(str, writing)]
        writes = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert (tmp_path / "out.npz").is_file()
    assert writes.returncode == 1 and "in use" in json.loads(writes.stdout.splitlines()[-1])["message"]
    assert "Traceback" not in writes.stderr and not (out / "bodies").exists()


@pytest.mark.skipif(os.name == "nt", reason="making links needs a right of its own on Windows")
def test_a_link_in_the_place_of_the_lock_is_not_written_through(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("kept")
    take = Take(tmp_path / "t.take")
    take.prepare()
    take.file(NAME).symlink_to(tmp_path / "precious")
    with pytest.raises(TakeError, match="cannot be written"), held(take, "recover", NoProgress()):
        pass
    take.file(NAME).unlink()
    if hasattr(os, "mkfifo"):
        os.mkfifo(take.file(NAME))
        with pytest.raises(TakeError, match="not a regular file"), held(take, "recover", NoProgress()):
            pass
    assert (tmp_path / "precious").read_text() == "kept"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps a file that is open")
@pytest.mark.parametrize("again", [False, True])
def test_a_take_that_is_removed_under_its_holder_is_told(tmp_path: Path, again: bool) -> None:
    said: list[dict] = []
    folder = tmp_path / "a.take"
    with held(Take(folder), "recover", Progress(said.append)):
        shutil.rmtree(folder)
        if again:
            with held(Take(folder), "recover", NoProgress()):
                pass
    assert ["removed or replaced" in message["message"] for message in said] == [True]


@pytest.mark.parametrize("kept", [False, True])
def test_the_lock_is_left_only_in_a_folder_in_which_something_was_kept(tmp_path: Path, kept: bool) -> None:
    (tmp_path / "clip.mp4").touch()
    reads = [("the clip", tmp_path / "clip.mp4")]
    for folder, before in ((tmp_path, ["clip.mp4"]), (tmp_path / "empty", []), (tmp_path / "new", None)):
        if before == []:
            folder.mkdir()
        with pytest.raises(TakeError), held(Take(folder), "observe", NoProgress(), reads) as take:
            if kept:
                take.write_json("preview.json", {})
            raise TakeError("Refused.")
        there = sorted(path.name for path in folder.iterdir()) if folder.exists() else None
        assert there == ([*(before or []), "preview.json", NAME] if kept else before)
        if kept:
            take.file(NAME).unlink()
            take.file("preview.json").unlink()


def test_a_take_that_stays_is_no_cause_of_a_warning(tmp_path: Path) -> None:
    said: list[dict] = []
    with held(Take(tmp_path), "recover", Progress(said.append)):
        pass
    assert said == []


def test_what_dead_processes_were_writing_is_cleared(tmp_path: Path) -> None:
    ended = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, text=True, check=True)
    dead, alive = int(ended.stdout), os.getppid()
    (tmp_path / "bodies").mkdir()
    left = [f".overlay.{dead}.part.mp4", f"bodies/.flag.{dead}.part.npz", f".checkpoint.000001.{dead}.part.safetensors"]
    stays = [f".overlay.{alive}.part.mp4", "overlay.mp4", ".overlay.part.mp4", ".a.b.part.c"]
    for name in (*left, *stays, NAME):  # which each of them has held
        (tmp_path / name).write_text("")
    with held(Take(tmp_path), "recover", NoProgress()):
        assert not [name for name in left if (tmp_path / name).exists()]
        assert all((tmp_path / name).exists() for name in stays)
