"""A long job in a second process, as a generator of messages. No bpy here: tests and `blender -b` read the same generator.

The worker's side of the contract (`python -m seeing_wind.engine`): one JSON object per line on stdout, logs on stderr; a line "cancel" on
stdin, or the end of stdin when this process is gone, stops it at the next safe point. Windows has no signal that a process without a
console receives, so no system is sent one. Whatever the worker does instead (dies, hangs, prints nonsense), the generator ends, and its
last message is an `exit` that says how.

Messages yielded, beside those of the worker (progress, warning, error, result):
    {"type": "log", "message"}                                      a line of stdout that is no message (pip, a chatty library)
    {"type": "error", "message", "hint", "mend", "log"}             made here when the worker died without a word of its own
    {"type": "exit", "code", "outcome", "log"}                      always the last one; outcome: done, failed or cancelled
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any

from ...engine import systems
from ...engine.errors import CANCELLED, DONE_WITH_WARNINGS, SeeingWindError
from ...engine.progress import CANCEL_BY_STDIN

Message = dict[str, Any]
Messages = Generator[list[Message], bool | None, Message]

CANCEL_GRACE = 1.0
"""Seconds between the request to stop and ending the process: the engine passes a safe point at least twice a second, and the user shall
have Blender back within two seconds whatever the worker does."""
KILL_GRACE = 0.2
"""Seconds between ending the process politely and killing it."""
LOG_LINES = 60
"""Lines of the worker's stderr kept for an error message."""


def run(command: Sequence[str], *, cwd: str, env: Mapping[str, str], grace: float = CANCEL_GRACE) -> Messages:
    """Start `command` and yield lists of its messages, without ever waiting for it: the list is empty when there is nothing new.

    Send True to cancel: the worker is asked to stop, ended after `grace` seconds (0 for a program that does not listen), then killed.
    Closing the generator kills it at once. Returns the exit message.
    """
    try:
        process = _start(command, cwd, env)
    except OSError as error:
        if not os.path.isdir(cwd):
            failure = _error(f"There is no folder {cwd}.", "It may have been moved or deleted: choose it again, or run Recover again.")
        else:
            reason = error.strerror or str(error)
            failure = _error(
                f"{command[0]} cannot be started: {reason}.", "Check the engine's Python in the preferences, or install the engine again."
            )
            failure["mend"] = "install_engine"
        farewell = {"type": "exit", "code": -1, "outcome": "failed", "log": ""}
        yield [failure, farewell]
        return farewell

    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    log: deque[str] = deque(maxlen=LOG_LINES)
    readers = [systems.reader(process.stdout, lines.put), systems.reader(process.stderr, log.append)]
    said_error = False
    cancelled_at: float | None = None
    try:
        while True:
            ended = process.poll() is not None
            if ended:
                # A grandchild may hold the pipes open, so the readers get a moment, not forever.
                for reader in readers:
                    reader.join(timeout=0.5)
            messages = [_parse(line) for line in _drain(lines)]
            said_error = said_error or any(message["type"] == "error" for message in messages)
            if ended:
                farewell = _farewell(process.returncode, cancelled_at is not None, log)
                if farewell["outcome"] == "failed" and not said_error:
                    messages.append(_death(process.returncode, log))
                yield [*messages, farewell]
                return farewell
            if (yield messages) and cancelled_at is None:
                cancelled_at = time.monotonic()
                _ask(process)
            if cancelled_at is not None:
                _press(process, time.monotonic() - cancelled_at - grace)
    finally:
        if process.poll() is None:
            _end(process, at_once=True)
            process.wait()
        with contextlib.suppress(OSError):  # what could not be said to a worker that is gone
            process.stdin.close()
        for stream in (process.stdout, process.stderr):
            # Closing waits for a reader that is blocked in it; a grandchild can hold it open, then the reader closes it at its end.
            if stream is not None and not any(reader.is_alive() for reader in readers):
                stream.close()


def told(error: SeeingWindError | OSError) -> tuple[str, str, str]:
    """What happened, what to do, and the control that mends it, of an error that a user can act on."""
    if isinstance(error, SeeingWindError):
        return error.message, error.hint, error.mend
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}{error.strerror or error}.", "Check that the folder is there and can be written.", ""


def said_by(error: RuntimeError) -> str:
    """What one of Blender's own operators has reported, without its trimmings."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[0].removeprefix("Error: ").rstrip(".") if lines else "no reason given"


def wait(messages: Messages, handle: Callable[[Message], None], *, pause: float = 0.05) -> Message:
    """The blocking driver: read `messages` to their end, handing each to `handle`; Ctrl-C and SIGTERM cancel. Returns the last message."""
    asked = False

    def ask(*_: Any) -> None:
        nonlocal asked
        asked = True

    with _signals(ask):
        last: Message = {"type": "exit", "code": -1, "outcome": "failed", "log": ""}
        try:
            batch = next(messages)
            while True:
                for message in batch:
                    last = message
                    handle(message)
                if not batch:
                    time.sleep(pause)
                batch = messages.send(asked)
        except StopIteration as end:
            return end.value or last
        finally:
            messages.close()


def _start(command: Sequence[str], cwd: str, env: Mapping[str, str]) -> subprocess.Popen[str]:
    # Apart: a Ctrl-C in Blender's terminal reaches Blender alone, and the worker is ended together with its children.
    return subprocess.Popen(
        list(command), cwd=cwd, env={**env, CANCEL_BY_STDIN: "1"}, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, encoding="utf-8", errors="replace", bufsize=1, **systems.apart(),
    )  # fmt: skip


def _drain(lines: queue.SimpleQueue[str | None]) -> list[str]:
    drained = []
    with contextlib.suppress(queue.Empty):
        while True:
            drained.append(lines.get_nowait() or "")
    return [line for line in drained if line.strip()]


def _parse(line: str) -> Message:
    try:
        message = json.loads(line)
    except ValueError:
        return {"type": "log", "message": line}
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        return {"type": "log", "message": line}
    return message


def _press(process: subprocess.Popen[str], late: float) -> None:
    """End a worker that does not stop by itself, `late` seconds after its grace."""
    if late >= 0.0:
        _end(process, at_once=late >= KILL_GRACE)


def _ask(process: subprocess.Popen[str]) -> None:
    """Ask the worker to stop at its next safe point; one that is gone already is no error."""
    with contextlib.suppress(OSError):
        process.stdin.write("cancel\n")
        process.stdin.flush()


def _end(process: subprocess.Popen[str], at_once: bool) -> None:
    """End the worker and all that it has started: politely first, unless `at_once`; Windows knows one way only."""
    if systems.windows():
        # a virtual environment's python.exe starts the real Python as a child
        tree = ["taskkill", "/F", "/T", "/PID", str(process.pid)]
        with contextlib.suppress(OSError):
            subprocess.run(tree, stdin=subprocess.DEVNULL, capture_output=True, check=False, **systems.quiet())
        with contextlib.suppress(OSError):  # where there is no taskkill
            process.kill()
        return
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL if at_once else signal.SIGTERM)


def _farewell(code: int, cancelled: bool, log: deque[str]) -> Message:
    outcome = "done" if code in (0, DONE_WITH_WARNINGS) else "cancelled" if cancelled or code in (CANCELLED, -signal.SIGINT) else "failed"
    return {"type": "exit", "code": code, "outcome": outcome, "log": "\n".join(log)}


def _death(code: int, log: deque[str]) -> Message:
    """What happened to a worker that failed without an error message."""
    if code < 0:
        with contextlib.suppress(ValueError):
            name = signal.Signals(-code).name
            hint = "The system may have run out of memory." if name == "SIGKILL" else "See the log for the last thing that it did."
            return _error(f"The engine was ended by {name}.", f"{hint} Results of finished stages are kept.", log)
    last = next((line for line in reversed(log) if line.strip()), "it left no log")
    return _error(f"The engine stopped with code {code}: {last.rstrip('.')}.", "Check Engine in the preferences says what is missing.", log)


def _error(message: str, hint: str, log: deque[str] | tuple[()] = ()) -> Message:
    return {"type": "error", "message": message, "hint": hint, "mend": "", "log": "\n".join(log)}


@contextlib.contextmanager
def _signals(ask: Callable[..., None]) -> Generator[None, None, None]:
    """Ctrl-C and SIGTERM ask the worker to stop instead of ending this process beside it (main thread only; elsewhere no change)."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kinds = [signal.SIGINT, signal.SIGTERM]
    former = {kind: signal.signal(kind, ask) for kind in kinds}
    try:
        yield
    finally:
        for kind, handler in former.items():
            # None: a handler that was not set from Python and so cannot be put back.
            signal.signal(kind, handler if handler is not None else signal.SIG_DFL)
