"""kill -9 at random moments of every stage: what is resumed equals what was never interrupted."""

from __future__ import annotations

import random
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.faults.counts import COUNTS, WHOLE, draws
from tests.faults.seeds import FPS
from tests.faults.worker import Worker

PATIENT = 900.0
"""Seconds for a job that nothing is wrong with, on a machine that has other things to do."""

EVERY = 25
"""Jobs between two lines of progress."""
WINDOW = 0.6
"""Seconds after a stage's first word in which it is killed."""


@dataclass(frozen=True)
class Job:
    """A call, the words that its stages begin with, and what of its results must be equal."""

    argv: list[Any]
    stages: tuple[str, ...]
    results: tuple[str, ...]


SHORT = ["--iterations", 1, "--frames", "0:4"]
JOBS = {
    "clip": Job(
        ["recover", "clip.avi", "--take", "o.take", "--mask", "mask.png", "--distance", 2, "--fps", FPS, *SHORT],
        ("observe", "build", "recover", "distill", "report"), ("o.take/field.safetensors",),
    ),
    "points": Job(
        ["recover-trajectories", "t.npz", "--take", "o.take", "--iterations", 1], ("recover", "distill", "report"),
        ("o.take/field.safetensors",),
    ),
    "edit": Job(["resimulate", "whole.take", "--edit", "edit.toml", "--take", "o.take"], ("resimulate",), ("o.take/bodies/thing.npz",)),
    "export": Job(["export", "whole.take", "--format", "npz", "--out", "o.npz"], ("", "export"), ("o.npz",)),
}  # fmt: skip
SHARES = {"clip": 5, "points": 2, "edit": 2, "export": 3}
"""How often each job is drawn: by what it holds of stages, and by what a draw of it costs."""


def left(job: Job, folder: Path) -> dict[str, bytes]:
    """The results of a job that are there."""
    return {name: (folder / name).read_bytes() for name in job.results if (folder / name).is_file()}


class References:
    """What every job makes without an interruption, made when it is first asked for."""

    def __init__(self, worker: Worker, seeds: Path, home: Path) -> None:
        self._worker, self._seeds, self._home = worker, seeds, home
        self._made: dict[str, tuple[dict[str, bytes], float]] = {}

    def __getitem__(self, name: str) -> tuple[dict[str, bytes], float]:
        """Its results and the seconds of the processor that it took."""
        if name not in self._made:
            folder = self._home / name
            shutil.copytree(self._seeds, folder)
            run = self._worker.run(JOBS[name].argv, folder, seconds=PATIENT)
            assert run.code == 0 and not run.traceback, (run.code, run.error, run.stderr[-2000:])
            found = left(JOBS[name], folder)
            assert len(found) == len(JOBS[name].results)
            self._made[name] = found, run.work
        return self._made[name]


@pytest.fixture(scope="module")
def references(worker: Worker, seeds: Path, tmp_path_factory: pytest.TempPathFactory) -> References:
    return References(worker, seeds, tmp_path_factory.mktemp("references"))


def test_a_killed_job_resumes_to_the_same_result(worker: Worker, seeds: Path, references: References, tmp_path: Path) -> None:
    chance = random.Random(2103)  # its first three kills meet three kinds of job
    wanted_kills = draws(3, 204)
    wrong, again, number = [], [], 0
    while COUNTS["kills"] < wanted_kills:  # a job that ends before its moment comes does not count
        number += 1
        assert number <= 4 * wanted_kills, "hardly a job is still running when its moment comes"
        (name,) = chance.choices(list(SHARES), list(SHARES.values()))
        job, folder = JOBS[name], tmp_path / str(number)
        wanted, took = references[name]
        shutil.copytree(seeds, folder)
        stage = chance.choice(job.stages)
        marker = f'"stage": "{stage}"' if stage else ""
        cut = worker.run(job.argv, folder, seconds=PATIENT, marker=marker, kill_after=chance.uniform(0.0, WINDOW))
        COUNTS["kills"] += cut.code == -9
        if number % EVERY == 0:
            print(f"\n{COUNTS['kills']} kills, {COUNTS['lost']} lost", flush=True)
        resumed = worker.run(job.argv, folder, seconds=PATIENT)
        COUNTS["tracebacks"] += cut.traceback + resumed.traceback
        again.append((cut.work + resumed.work - took, name, stage))
        if resumed.code or resumed.traceback or left(job, folder) != wanted:
            COUNTS["lost"] += 1
            wrong.append(f"{number}, {name} killed in {stage or 'its start'}: {resumed.code}, {resumed.error}, {resumed.stderr[-800:]}")
        shutil.rmtree(folder)
    worst = max(again)
    print(f"\nkills: at most {worst[0]:.1f} s of the processor were worked again, in {worst[1]}, killed in {worst[2] or 'its start'}")
    assert not wrong, "\n".join(wrong)


SWUNG = ["long.avi", "--take", "o.take", "--box", 46, 20, 114, 82, "--distance", 2, "--fps", FPS]
LONG = {
    "observe": Job(["observe", *SWUNG], (), ("o.take/observation.npz",)),
    "recover": Job(["recover", *SWUNG, "--iterations", 1], (), ("o.take/particles.npz", "o.take/field.safetensors")),
}
FRAMES = 200


def write_long_clip(folder: Path) -> None:
    """A patterned square that swings before a patterned wall: seconds of work in every stage."""
    draw = np.random.default_rng(5)
    wall, square = (cv2.resize(draw.integers(low, high, (h, w, 3)).astype(np.uint8), size, interpolation=cv2.INTER_CUBIC)
                    for low, high, h, w, size in ((60, 120, 30, 40, (320, 240)), (120, 255, 15, 15, (60, 60))))  # fmt: skip
    writer = cv2.VideoWriter(str(folder / "long.avi"), cv2.VideoWriter.fourcc(*"MJPG"), FPS, (320, 240))
    for t in range(FRAMES):
        frame, x, y = wall.copy(), 50 + t // 2, round(20 + 30 * np.sin(t / 9.0) ** 2)
        frame[y : y + 60, x : x + 60] = square
        writer.write(frame)
    writer.release()


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["observe", pytest.param("recover", marks=pytest.mark.skipif(not WHOLE, reason="minutes"))])
def test_a_long_clip_goes_on_where_it_was_killed(worker: Worker, seeds: Path, tmp_path: Path, verb: str) -> None:
    write_long_clip(seeds)
    whole, job = tmp_path / "whole", LONG[verb]
    shutil.copytree(seeds, whole)
    reference = worker.run(job.argv, whole, seconds=PATIENT)
    wanted, chance, again = left(job, whole), random.Random(25), []
    assert reference.code in (0, 3) and len(wanted) == len(job.results), (reference.code, reference.error, reference.stderr[-2000:])
    for number in range(draws(1, 8)):
        folder = tmp_path / str(number)
        shutil.copytree(seeds, folder)
        moment = chance.uniform(0.0, reference.seconds)
        cut = worker.run(job.argv, folder, seconds=PATIENT, marker='"stage": "observe"', kill_after=moment)
        COUNTS["kills"] += cut.code == -9
        resumed = worker.run(job.argv, folder, seconds=PATIENT)
        COUNTS["tracebacks"] += cut.traceback + resumed.traceback
        same = resumed.code == reference.code and not resumed.traceback and left(job, folder) == wanted
        COUNTS["lost"] += not same
        assert same, f"{number}, killed after {moment:.1f} s: {resumed.code}, {resumed.error}, {resumed.stderr[-800:]}"
        again.append((cut.work + resumed.work - reference.work, moment))
        shutil.rmtree(folder)
    worst, moment = max(again)
    print(f"\n{verb} of a clip of {FRAMES} frames, {reference.work:.0f} s of the processor: at most {worst:.1f} s of it were worked "
          f"again, killed after {moment:.1f} s")  # fmt: skip
