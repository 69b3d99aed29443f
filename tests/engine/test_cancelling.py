"""A worker that is told to listen stops at a safe point when its parent asks by the pipe, or is gone; any other ignores its stdin."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from seeing_wind.engine import systems
from seeing_wind.engine.command import cancelling
from seeing_wind.engine.errors import WRONG_INPUT
from seeing_wind.engine.progress import CANCEL_BY_STDIN

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def square(tmp_path: Path) -> Path:
    """A bright square that drifts over a plain background."""
    writer = cv2.VideoWriter(str(tmp_path / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for t in range(8):
        frame = np.full((48, 64, 3), 90, np.uint8)
        frame[14:26, 16 + t : 28 + t] = 220
        writer.write(frame)
    writer.release()
    return tmp_path / "clip.avi"


def started(square: Path, **variables: str) -> subprocess.Popen[str]:
    """A worker that has said its first word."""
    command = [sys.executable, "-m", "seeing_wind.engine", "recover", str(square), "--take", str(square.parent / "t.take")]
    worker = subprocess.Popen(
        [*command, "--box", "12", "10", "32", "30", "--distance", "1"], cwd=ROOT, env={**os.environ, **variables},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert worker.stdout is not None
    assert json.loads(worker.stdout.readline())["type"] in ("progress", "warning")
    return worker


@pytest.mark.parametrize("gone", [False, True], ids=["asked", "the parent is gone"])
def test_the_pipe_cancels_at_a_safe_point(square: Path, gone: bool) -> None:
    worker = started(square, **{CANCEL_BY_STDIN: "1"})
    assert worker.stdin is not None and worker.stdout is not None
    if gone:
        worker.stdin.close()
    else:
        worker.stdin.write("cancel\n")
        worker.stdin.flush()
    rest = [json.loads(line) for line in worker.stdout]
    assert worker.wait(timeout=60) == 130 and rest[-1]["outcome"] == "cancelled"
    assert not [path for path in (square.parent / "t.take").rglob("*") if "part" in path.name]


def pipe(monkeypatch: pytest.MonkeyPatch, asked: str) -> tuple[int, object]:
    """The writing end of a pipe that is this process's stdin for `cancelling`."""
    out, into = os.pipe()
    stdin = os.fdopen(out, "rb", buffering=0)
    monkeypatch.setattr(cancelling.sys, "__stdin__", stdin)
    monkeypatch.setenv(CANCEL_BY_STDIN, asked)
    return into, stdin


def test_a_worker_that_is_not_told_to_listen_leaves_its_stdin_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    into, stdin = pipe(monkeypatch, "")
    os.close(into)
    assert cancelling.listen(lambda: pytest.fail("an empty stdin is no request")) is None
    stdin.close()  # type: ignore[attr-defined]


def test_only_the_word_cancels_and_what_the_worker_starts_does_not_listen(monkeypatch: pytest.MonkeyPatch) -> None:
    into, stdin = pipe(monkeypatch, "1")
    cancelled = threading.Event()
    thread = cancelling.listen(cancelled.set)
    assert thread is not None and CANCEL_BY_STDIN not in os.environ
    assert stdin.read() == b"", "stdin is empty for everybody else"  # type: ignore[attr-defined]
    os.write(into, b"hello\ncan")
    assert not cancelled.wait(0.3)
    os.write(into, b"cel\r\n")
    assert cancelled.wait(10.0)
    thread.join(10.0)
    os.close(into)
    stdin.close()  # type: ignore[attr-defined]


def test_windows_never_waits_in_a_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """There a thread that waits in a read of stdin blocks libraries that look at stdin as they are loaded."""
    into, stdin = pipe(monkeypatch, "1")
    lies, looked = [0], threading.Semaphore(0)

    def waiting(_: int) -> int:
        looked.release()
        return lies[0]

    monkeypatch.setattr(systems, "windows", lambda: True)
    monkeypatch.setattr(cancelling, "bytes_waiting", waiting)
    read = os.read
    monkeypatch.setattr(cancelling.os, "read", lambda *given: read(*given) if lies[0] else pytest.fail("it would wait here"))
    cancelled = threading.Event()
    thread = cancelling.listen(cancelled.set)
    for _ in range(3):
        assert looked.acquire(timeout=10.0)
    assert not cancelled.is_set()
    os.write(into, b"cancel\r\n")
    lies[0] = 8
    assert cancelled.wait(10.0) and thread is not None
    thread.join(10.0)
    os.close(into)
    stdin.close()  # type: ignore[attr-defined]


def test_a_broken_pipe_of_windows_is_a_parent_that_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    into, stdin = pipe(monkeypatch, "1")

    def broken(_: int) -> int:
        raise OSError("the pipe is broken")

    monkeypatch.setattr(systems, "windows", lambda: True)
    monkeypatch.setattr(cancelling, "bytes_waiting", broken)
    cancelled = threading.Event()
    assert cancelling.listen(cancelled.set) is not None and cancelled.wait(10.0)
    os.close(into)
    stdin.close()  # type: ignore[attr-defined]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_log_on_a_full_disk_stops_no_job(tmp_path: Path) -> None:
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "seeing_wind.engine", "recover", "none.mp4", "--take", str(tmp_path / "t.take")]
        job = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert job.returncode == WRONG_INPUT and "could not be written" in job.stderr and "Traceback" not in job.stderr
