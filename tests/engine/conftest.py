"""What all tests of the engine share."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmarks.scenes.gusts import GustField
from seeing_wind.engine.recovery import cost
from tests.engine.command_line import clip, in_a_process_of_its_own
from tests.faults.worker import Worker


@pytest.fixture(autouse=True)
def machine_of_known_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    """No recovery measures how fast the kernels are before it begins, which takes longer than most of them do here: `test_cost.py` does."""
    monkeypatch.setattr(cost, "_measured", lambda plastic: cost.Speed(copy=2e-7, base=2e-6, change=2e-8))


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., list[dict]]]:
    """`in_a_process_of_its_own`, forked from a warm engine where there are forks: most of a short job is its imports."""
    if not hasattr(os, "fork"):
        yield in_a_process_of_its_own
        return
    home = tmp_path_factory.mktemp("home")
    with Worker() as worker:

        def run(*arguments: object, expect: int, file_bytes: int | None = None) -> list[dict]:
            done = worker.run([str(word) for word in arguments], home, seconds=300.0, file_bytes=file_bytes)
            assert done.code == expect and not done.traceback, (done.code, done.messages[-2:], done.stderr[-2000:])
            return done.messages

        yield run


@pytest.fixture
def square(tmp_path: Path) -> Path:
    """A clip of a square that drifts, of 8 frames of 64x48 pixels."""
    return clip(tmp_path / "square.avi")


@pytest.fixture
def windy(tmp_path: Path) -> Path:
    """A take with a field of 4 frames, and points p.npy of the first beside it."""
    (tmp_path / "windy.take").mkdir()
    box = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    GustField(1, box, 25.0, 4, np.zeros(3), 2.0, wavelength=1.0, period=0.8).save(tmp_path / "windy.take" / "field.safetensors")
    np.save(tmp_path / "p.npy", np.random.default_rng(0).uniform(size=(20_000, 3)))
    return tmp_path / "windy.take"
