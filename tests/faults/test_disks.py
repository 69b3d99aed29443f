"""Disks that are full, read-only or gone, and memory that runs out: a sentence, the last good files, and a job that can be run again."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from seeing_wind.engine.errors import DONE_WITH_WARNINGS
from tests.faults.counts import COUNTS, WHOLE
from tests.faults.seeds import FPS
from tests.faults.worker import Run, Worker

EXPORT = ["export", "whole.take", "--format", "ply", "--out", "o.ply"]
SAMPLE = ["sample", "whole.take", "--points", "p.npy", "--frame", 0, "--out", "o.npz"]
SIMULATE = ["resimulate", "whole.take", "--edit", "edit.toml", "--take", "o.take"]
SOLVE = ["recover-trajectories", "t.npz", "--take", "o.take", "--iterations", 1, "--representation", "point"]
CLIP = ["recover", "clip.avi", "--take", "o.take", "--mask", "mask.png", "--distance", 2, "--fps", FPS, "--frames", "0:4",
        "--iterations", 1, "--representation", "point"]  # fmt: skip
QUICK = [EXPORT, SAMPLE]
ALL = [EXPORT, SAMPLE, SIMULATE, SOLVE, CLIP]
PATIENT = 900.0
FINE = (0, DONE_WITH_WARNINGS)


@pytest.fixture
def folder(seeds: Path) -> Iterator[Path]:
    """The sound inputs in a folder that everyone may look into."""
    place = Path(tempfile.mkdtemp())
    place.chmod(0o755)
    shutil.copytree(seeds, place / "work")
    (place / "work").chmod(0o755)
    yield place / "work"
    (place / "work").chmod(0o755)
    shutil.rmtree(place)


def named(argv: list[Any]) -> str:
    return str(argv[0])


def check(run: Run, *words: str) -> None:
    """A failure that says what happened, in one of these words, and what to do."""
    COUNTS["disks"] += 1
    COUNTS["tracebacks"] += run.traceback
    assert not run.traceback, run.stderr[-3000:]
    assert run.code == 1, (run.code, run.messages[-2:], run.stderr[-2000:])
    assert any(word in run.error["message"] for word in words), run.error
    assert run.error["hint"]


def whole_files(folder: Path) -> None:
    """No result is half a file: what has its name is what `Take.writing` renamed."""
    parts = [path for path in folder.rglob(".*.part*")]
    assert not parts, parts


@pytest.mark.parametrize("argv", ALL if WHOLE else QUICK, ids=named)
def test_a_full_disk_at_every_write(worker: Worker, folder: Path, argv: list[Any]) -> None:
    for number in range(200):
        run = worker.run(argv, folder, seconds=PATIENT, fail=number)
        if run.code in FINE and not any("space" in warning or "disk" in warning for warning in run.warnings):
            break
        if run.code in FINE:  # the field is there, and what is missing besides is told
            COUNTS["disks"] += 1
            COUNTS["tracebacks"] += run.traceback
            assert not run.traceback, run.stderr[-3000:]
        else:
            check(run, "No space left", "space", "disk")
        whole_files(folder)
    assert 0 < number < 199, "no write was met"


@pytest.mark.parametrize("most", [1, 100, 5000] if WHOLE else [1, 100])
@pytest.mark.parametrize("argv", [EXPORT, SAMPLE, SIMULATE] if WHOLE else QUICK, ids=named)
def test_files_that_may_not_grow(worker: Worker, folder: Path, argv: list[Any], most: int) -> None:
    """As a quota that is used up: the system refuses, also what is written by compiled libraries."""
    run = worker.run(argv, folder, seconds=PATIENT, file_bytes=most)
    if run.messages:  # its own messages go to a file here, too, and end at the limit
        COUNTS["disks"] += 1
    assert not run.traceback and run.code != 0 or most == 5000, (run.code, run.stderr[-2000:])
    whole_files(folder)


@pytest.mark.parametrize("argv", ALL if WHOLE else QUICK, ids=named)
def test_a_read_only_folder(worker: Worker, folder: Path, argv: list[Any]) -> None:
    folder.chmod(0o555)
    check(worker.run(argv, folder, seconds=PATIENT, plain=True), "cannot be written", "Cannot write", "Permission denied")
    assert not (folder / "o.take").exists() and not (folder / "o.npz").exists()


@pytest.mark.parametrize("argv", [SIMULATE, SOLVE, CLIP] if WHOLE else [SIMULATE], ids=named)
def test_a_folder_that_vanishes(worker: Worker, folder: Path, argv: list[Any]) -> None:
    """The result's folder is removed in mid-job: the job makes it anew or says that it is gone, and a second run has it all."""
    (folder / "o.take").mkdir()
    run = worker.run(argv, folder, seconds=PATIENT, marker='"progress"', vanish=folder / "o.take")
    COUNTS["disks"] += 1
    COUNTS["tracebacks"] += run.traceback
    assert run.code in (*FINE, 1) and not run.traceback, (run.code, run.error, run.stderr[-2000:])
    again = worker.run(argv, folder, seconds=PATIENT)
    assert again.code == 0 and not again.traceback, (again.error, again.stderr[-2000:])


@pytest.mark.parametrize("megabytes", [16, 200, 1500, 2000] if WHOLE else [16])
@pytest.mark.parametrize("argv", ALL if WHOLE else QUICK, ids=named)
def test_memory_that_runs_out(worker: Worker, folder: Path, argv: list[Any], megabytes: int) -> None:
    run = worker.run(argv, folder, seconds=PATIENT, memory=megabytes * 2**20)
    COUNTS["disks"] += 1
    COUNTS["tracebacks"] += run.traceback
    assert not run.traceback, run.stderr[-3000:]
    assert run.code in FINE or (run.code == 1 and run.error["hint"]), (run.code, run.error, run.stderr[-1500:])
    whole_files(folder)


def test_the_suites_do_not_run_as_if_they_could_not_fail(worker: Worker, folder: Path) -> None:
    """The injected faults arrive: the same calls without them succeed."""
    run = worker.run(SAMPLE, folder)
    assert run.code == 0 and (folder / "o.npz").is_file()
    assert os.path.getsize(folder / "o.npz") > 0
