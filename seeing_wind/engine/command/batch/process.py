"""One verb of the engine in a process of its own, so that a crash does not affect the caller and the memory is freed at the end."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import subprocess
import sys
from collections import deque
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from ... import systems
from ...errors import DONE_WITH_WARNINGS, SeeingWindError
from ...progress import CANCEL_BY_STDIN
from ...records import Outcome

Message = dict[str, Any]

ROOT = Path(__file__).resolve().parents[4]
"""The folder that holds the package `seeing_wind`."""
CANCEL_GRACE = 5.0
"""Seconds that the engine is given to reach a safe point after a cancel."""
BEAT = 0.25
"""Seconds without a message after which an empty list is yielded, so that the caller can do other things."""
LOG_LINES = 20
THREADS = ("SEEING_WIND_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Environment variables that set the number of threads of the solver and the numeric libraries."""


class EngineDied(SeeingWindError):
    """The engine's process was killed from outside, usually by the system for lack of memory."""


def messages_of(words: Sequence[str], threads: int | None = None) -> Generator[list[Message], None, None]:
    """Run `python -m seeing_wind.engine WORDS` and yield its messages, or an empty list if there was none for a while.

    Closing the generator, or an exception thrown into it, stops the process at a safe point, or kills it after `CANCEL_GRACE` seconds. The
    process also stops by itself if this process dies.

    Args:
        words: verb and options.
        threads: number of threads of the engine; None leaves the choice to the engine.

    Raises:
        SeeingWindError: the engine failed; the message is the engine's own.
        EngineDied: the engine was killed.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "seeing_wind.engine", *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, encoding="utf-8", errors="replace", env=_environment(threads), **systems.apart(),
    )  # fmt: skip
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    log: deque[str] = deque(maxlen=LOG_LINES)
    readers = [systems.reader(process.stdout, lines.put), systems.reader(process.stderr, log.append)]
    error: Message | None = None
    try:
        while process.poll() is None or readers[0].is_alive() or not lines.empty():
            try:
                message = _message(lines.get(timeout=BEAT))
            except queue.Empty:
                yield []
                continue
            if message.get("type") == "error":
                error = message
            elif message.get("type") == "result" and message.get("outcome") == Outcome.DIVERGED:
                error = {"message": "The solve diverged.", "hint": " ".join(message.get("notes", ()))}
            elif message:
                yield [message]
        if process.returncode not in (0, DONE_WITH_WARNINGS):
            raise _failure(process.returncode, error, log)
    finally:
        _stop(process)
        for reader in readers:
            reader.join(timeout=1.0)


def _environment(threads: int | None) -> dict[str, str]:
    """This process's environment, changed so that the package is found from any folder, and no module in that folder shadows another."""
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    given = {} if threads is None else dict.fromkeys(THREADS, str(threads))
    return {**os.environ, "PYTHONPATH": path, "PYTHONUTF8": "1", "PYTHONSAFEPATH": "1", CANCEL_BY_STDIN: "1", **given}


def _message(line: str) -> Message:
    """The message in a line of the engine's output; empty if the line is not a message."""
    try:
        message = json.loads(line)
    except ValueError:
        return {}
    return message if isinstance(message, dict) else {}


def _failure(code: int, error: Message | None, log: deque[str]) -> SeeingWindError:
    if error is not None:
        return SeeingWindError(str(error.get("message", "")), str(error.get("hint", "")))
    if code < 0:
        return EngineDied(f"The engine was ended by signal {-code}.", "The system may have run out of memory.")
    last = next((line for line in reversed(log) if line.strip()), "it left no log")
    return SeeingWindError(f"The engine stopped with code {code}: {last.rstrip('.')}.", "Run `doctor` to see what is missing.")


def _stop(process: subprocess.Popen[str]) -> None:
    """Let a running process stop at a safe point, or kill it after `CANCEL_GRACE` seconds."""
    if process.stdin is not None:
        with contextlib.suppress(OSError):  # it is gone already
            process.stdin.write("cancel\n")
        with contextlib.suppress(OSError):
            process.stdin.close()
    try:
        process.wait(CANCEL_GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
