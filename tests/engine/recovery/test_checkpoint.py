"""A solve that is killed continues from its last checkpoint, with the same result to the last bit."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from seeing_wind.engine.field import distill
from seeing_wind.engine.progress import Journal, NoProgress
from seeing_wind.engine.record_arrays import to_arrays
from seeing_wind.engine.records import Recovery
from seeing_wind.engine.recovery import journal as journals
from seeing_wind.engine.recovery.journal import TakeJournal
from seeing_wind.engine.recovery.paper.refinement import refine
from seeing_wind.engine.recovery.paper.schedule import recover_by_descent
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.recovery.solve.constants import PACE
from seeing_wind.engine.recovery.stage import recover_stage
from seeing_wind.engine.take import Take, stamp_of
from tests.engine.recovery.bodies import FPS, RUBBER, WEIGHTLESS, blow, plate, points

R = TypeVar("R")
CLAY = replace(RUBBER, name="clay", law="von_mises", yield_stress=100.0)


class Killed(BaseException):
    """An exception that no part of the solve expects."""


class Dying(TakeJournal):
    """A journal whose process dies after a given number of writes."""

    left = 0

    def write(self) -> None:
        super().write()
        self.left -= 1
        if self.left == 0:
            raise Killed


def seen(frames: int, held: bool = False, material=RUBBER):
    body = plate((4, 3, 2), pinned=(lambda X: X[:, 0] < X[:, 0].min() + 0.01) if held else None)
    wind = lambda X, t: np.stack([3 * np.sin(0.6 * t) + 20 * X[:, 1], 4 * np.cos(0.4 * t) + 0 * X[:, 0], 2 + 10 * X[:, 0]], -1)  # noqa: E731
    return body, points(body, blow(body, wind, frames, material=material)[0])


def free(journal: Journal) -> Recovery:
    body, targets = seen(6)
    return recover(body, RUBBER, targets, FPS, WEIGHTLESS, NoProgress(), journal)


def held(journal: Journal) -> Recovery:
    body, targets = seen(5, held=True)
    return recover(body, RUBBER, targets, FPS, WEIGHTLESS, NoProgress(), journal)


def flowing(journal: Journal) -> Recovery:
    body, targets = seen(4, material=CLAY)
    return recover(body, CLAY, targets, FPS, replace(WEIGHTLESS, iterations=2), NoProgress(), journal)


def by_descent(journal: Journal) -> Recovery:
    body, targets = seen(3)
    return recover_by_descent(body, RUBBER, targets, FPS, replace(WEIGHTLESS, frame_iterations=5), NoProgress(), None, journal)


def clay_by_descent(journal: Journal) -> Recovery:
    body, targets = seen(3, material=CLAY)
    return recover_by_descent(body, CLAY, targets, FPS, replace(WEIGHTLESS, frame_iterations=5), NoProgress(), None, journal)


def killed_until_done(take: Take, work: Callable[[Journal], R], seed: int, most: int = 24) -> tuple[R, int]:
    """The result of `work`, and how often it was killed before that, each time after fewer than `most` checkpoints."""
    random = np.random.default_rng(seed)
    for kills in range(1000):
        journal = Dying(take, "stamp", NoProgress())
        journal.left = int(random.integers(1, most))
        try:
            return work(journal), kills
        except Killed:
            pass
    raise AssertionError("it does not get on")


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journals, "LATEST", 0.0)


def assert_equal(got: Recovery, want: Recovery) -> None:
    for (name, one), other in zip(to_arrays(got).items(), to_arrays(want).values()):
        if name != "seconds":
            np.testing.assert_array_equal(one, other, err_msg=name)


@pytest.mark.parametrize("work", [held, by_descent, *(pytest.param(work, marks=pytest.mark.slow) for work in (free, flowing))])
def test_a_solve_that_is_killed_again_and_again_finds_the_same(tmp_path: Path, eager: None, work: Callable[[Journal], Recovery]) -> None:
    got, kills = killed_until_done(Take(tmp_path), work, 0, 4 if work is by_descent else 24)
    assert kills > 2
    assert_equal(got, work(Journal()))


def test_blocks_that_are_solved_are_kept(tmp_path: Path, eager: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["seeing_wind.engine.recovery.blocks"], "PACE", replace(PACE, block=4, overlap=2))
    got, kills = killed_until_done(Take(tmp_path), free, 1)
    assert kills > 2
    assert_equal(got, free(Journal()))


def test_a_fit_and_a_refinement_that_are_killed_give_the_same_field(tmp_path: Path, eager: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["seeing_wind.engine.field.distillation"], "ITERATIONS", 25)
    body, targets = seen(5)
    recovery = recover(body, RUBBER, targets, FPS, replace(WEIGHTLESS, iterations=1), NoProgress())

    def work(journal: Journal) -> bytes:
        field = distill(recovery, body, FPS, "causal_triplane", 0, NoProgress(), journal)
        refined = refine(field, recovery, body, RUBBER, replace(WEIGHTLESS, refine=2), NoProgress(), journal)
        refined.field.save(tmp_path / "field.safetensors")
        return (tmp_path / "field.safetensors").read_bytes() + repr((refined.before, refined.after)).encode()

    got, kills = killed_until_done(Take(tmp_path), work, 2)
    assert kills > 2 and got == work(Journal())


JOB = """
import sys
from pathlib import Path
from seeing_wind.engine.recovery import journal
from tests.engine.recovery.test_checkpoint import job
journal.LATEST = 0.0
job(Path(sys.argv[1]))
"""


def job(folder: Path) -> Recovery:
    """The whole stage, with a field of points, which takes no time to fit."""
    body, targets = seen(6)
    take = Take(folder)
    take.prepare()
    settings = replace(WEIGHTLESS, representation="point")
    return recover_stage(take, body, RUBBER, targets, FPS, stamp_of("seen"), settings, NoProgress())[0]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="Windows has another way")
def test_kill_9(tmp_path: Path) -> None:
    """The job, in another process, is killed at arbitrary moments, each at least one checkpoint after the last."""
    random, take, kills = np.random.default_rng(3), Take(tmp_path / "killed.take"), 0
    root = Path(__file__).parents[3]
    while kills < 2:
        before = checkpoints(take)
        process = subprocess.Popen([sys.executable, "-c", JOB, str(take.path)], cwd=root, env={**os.environ, "PYTHONPATH": str(root)})
        while process.poll() is None and checkpoints(take) <= before:
            time.sleep(0.005)
        time.sleep(random.uniform(0.0, 0.2))
        process.kill()
        assert process.wait() in (0, -signal.SIGKILL)
        if process.returncode == 0:
            break
        kills += 1
    assert kills
    got = job(take.path)
    assert_equal(got, job(tmp_path / "whole.take"))
    fields = [Take(tmp_path / name).file("field.safetensors").read_bytes() for name in ("killed.take", "whole.take")]
    assert fields[0] == fields[1] and checkpoints(take) == ""


def checkpoints(take: Take) -> str:
    """Name of the newest checkpoint, "" if there is none."""
    return max((path.name for path in take.path.glob("checkpoint.*")), default="")
