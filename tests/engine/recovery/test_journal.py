"""The journal of a long computation: how much work a crash costs, and that it changes nothing else."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seeing_wind.engine.errors import SimulationError
from seeing_wind.engine.progress import Cancelled, Journal, NoProgress, Progress
from seeing_wind.engine.recovery import journal as journals
from seeing_wind.engine.recovery.journal import TakeJournal
from seeing_wind.engine.take import Take


@dataclass(frozen=True)
class Part:
    values: np.ndarray
    count: int
    cost: float
    sound: bool


class Killed(BaseException):
    """An exception that no computation expects."""


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """The journal writes everything immediately."""
    monkeypatch.setattr(journals, "LATEST", 0.0)


def computation(journal: Journal, done: list[str], dies_at: int = -1) -> np.ndarray:
    """Three parts, each with two arrays and a loop of four rounds, each depending on those before; `done` collects what was computed."""

    def work(name: str) -> None:
        if len(done) == dies_at:
            raise Killed
        done.append(name)

    def trial(x: np.ndarray) -> np.ndarray:
        work("trial")
        return np.sin(1.0 + x * np.arange(12.0).reshape(3, 4).T)

    def part(x: np.ndarray) -> Part:
        first = journal.array("trial", lambda: trial(x), x)
        second = journal.array("trial", lambda: trial(first[:, :1]), first)
        loop = journal.loop("rounds")
        begin, state = loop.resume()
        total = state.get("total", np.zeros(3))
        for round in range(begin, 4):
            work("round")
            total = total + round * second[0]
            loop.reached(round + 1, partial(dict, total=total))
        return Part(total, 4, float("inf"), True)

    x = np.ones((4, 1))
    for number in range(3):
        found = journal.once("part", Part, partial(part, x), number)
        assert (found.count, found.cost, found.sound) == (4, float("inf"), True)
        x = np.full((4, 1), found.values.sum())
    return x


def files(take: Take) -> list[Path]:
    return sorted(take.path.glob("checkpoint.*"))


def test_wherever_it_is_killed_the_rest_is_the_same_and_nothing_is_done_twice(tmp_path: Path, eager: None) -> None:
    whole: list[str] = []
    want = computation(Journal(), whole)
    for dies_at in range(len(whole)):
        take, before, after = Take(tmp_path / str(dies_at)), list[str](), list[str]()
        with pytest.raises(Killed):
            computation(TakeJournal(take, "stamp", NoProgress()), before, dies_at)
        assert np.array_equal(computation(TakeJournal(take, "stamp", NoProgress()), after), want)
        assert before + after == whole


def test_killed_again_and_again_it_ends(tmp_path: Path, eager: None) -> None:
    take, whole, all_done = Take(tmp_path), list[str](), list[str]()
    want = computation(Journal(), whole)
    for _ in range(len(whole) - 1):
        done: list[str] = []
        with pytest.raises(Killed):
            computation(TakeJournal(take, "stamp", NoProgress()), done, 1)
        all_done += done
    assert np.array_equal(computation(TakeJournal(take, "stamp", NoProgress()), all_done), want)
    assert all_done == whole


def test_what_a_finished_part_was_made_of_is_not_kept(tmp_path: Path, eager: None) -> None:
    take = Take(tmp_path)
    journal = TakeJournal(take, "stamp", NoProgress())
    computation(journal, [])
    assert len(files(take)) == 3  # one for each part
    with journal:
        pass
    assert not files(take)


DAMAGE: list[Callable[[bytes], bytes]] = [
    lambda content: b"",
    lambda content: content[:100],
    lambda content: content[:-1],
    lambda content: b"\xff" * 200,
]


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_file_is_as_good_as_none(tmp_path: Path, eager: None, damage: Callable[[bytes], bytes]) -> None:
    take, again = Take(tmp_path), list[str]()
    want = computation(TakeJournal(take, "stamp", NoProgress()), [])
    files(take)[-1].write_bytes(damage(files(take)[-1].read_bytes()))
    assert np.array_equal(computation(TakeJournal(take, "stamp", NoProgress()), again), want)
    assert len(again) == 6  # the last part alone


def test_no_flipped_byte_changes_the_result(tmp_path: Path, eager: None) -> None:
    random, take = np.random.default_rng(0), Take(tmp_path)
    want = computation(TakeJournal(take, "stamp", NoProgress()), [])
    kept = {path: path.read_bytes() for path in files(take)}
    for _ in range(200):
        for path, content in kept.items():
            path.write_bytes(content)
        path = list(kept)[random.integers(len(kept))]
        garbled = bytearray(kept[path])
        garbled[random.integers(len(garbled))] ^= 1 << int(random.integers(8))
        path.write_bytes(garbled)
        assert np.array_equal(computation(TakeJournal(take, "stamp", NoProgress()), []), want)


def test_other_settings_and_other_inputs_begin_anew(tmp_path: Path, eager: None) -> None:
    take, done = Take(tmp_path), list[str]()
    computation(TakeJournal(take, "stamp", NoProgress()), [])
    other = TakeJournal(take, "another", NoProgress())
    assert not files(take)
    computation(other, done)
    assert len(done) == 18
    again = TakeJournal(take, "another", NoProgress())
    again.once("part", Part, lambda: Part(np.zeros(3), 4, 0.0, True), "changed")
    assert not again.once("part", Part, lambda: Part(np.zeros(3), 4, 0.0, False), "changed, too").sound


@pytest.mark.parametrize("array", [
    np.arange(6.0).reshape(2, 3), np.arange(6.0).reshape(2, 3).T, np.arange(24.0).reshape(2, 3, 4)[:, ::2], np.zeros((0, 3)),
    np.array([True, False]), np.float32([np.inf, np.nan]), np.arange(3), np.array(5.0), np.arange(5.0)[::-2],
])  # fmt: skip
def test_an_array_is_read_as_it_was_given(tmp_path: Path, eager: None, array: np.ndarray) -> None:
    """Its order in memory, too: sums differ with it in their last bits."""
    given = TakeJournal(Take(tmp_path), "stamp", NoProgress()).array("one", lambda: array)
    read = TakeJournal(Take(tmp_path), "stamp", NoProgress()).array("one", lambda: np.zeros(0))
    np.testing.assert_array_equal(given, array)
    np.testing.assert_array_equal(read, array)
    assert (read.dtype, read.shape, read.strides) == (array.dtype, array.shape, given.strides)
    if array.flags.c_contiguous or array.flags.f_contiguous:
        assert given.strides == array.strides


def test_a_full_disk_costs_the_journal_only_and_is_told_once(tmp_path: Path, eager: None, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[dict[str, Any]] = []
    want = computation(Journal(), [])

    def full(*unused: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    assert np.array_equal(computation(TakeJournal(Take(tmp_path), "stamp", Progress(told.append)), []), want)
    assert len(told) == 1 and "No space left" in told[0]["message"]
    assert not list(tmp_path.iterdir())


def test_short_work_writes_nothing(tmp_path: Path) -> None:
    journal = TakeJournal(Take(tmp_path), "stamp", NoProgress())
    computation(journal, [])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("error", "left"), [(Cancelled(), True), (MemoryError(), True), (SimulationError("it broke"), False)])
def test_a_cancel_keeps_what_waits_and_an_error_that_would_come_again_does_not(tmp_path: Path, error: BaseException, left: bool) -> None:
    take, again = Take(tmp_path), list[str]()
    with pytest.raises(type(error)), TakeJournal(take, "stamp", NoProgress()) as journal:
        computation(journal, [])
        raise error
    assert bool(files(take)) == left
    computation(TakeJournal(take, "stamp", NoProgress()), again)
    assert len(again) == (0 if left else 18)
