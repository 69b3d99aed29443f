"""A long job in a second process, as a generator of messages. No bpy here; tests and `blender -b` use the same generator.

The worker's side of the contract (`python -m seeing_wind.engine`): one JSON object per line on stdout, logs on stderr; a line "cancel" on
stdin, or the end of stdin when this process is gone, stops it at the next safe point. On Windows, a process without a console receives no
signal, so none is used on any system. Whatever the worker does instead (dies, hangs, prints nonsense), the generator ends, and its last
message is an `exit` that says how.

Messages yielded in addition to those of the worker (progress, warning, error, result):
    {"type": "log", "message"}                                      a line of stdout that is not a message (pip, a chatty library)
    {"type": "error", "message", "hint", "mend", "log"}             made here when the worker died without an error message
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
"""Seconds between the request to stop and ending the process: the engine passes a safe point at least twice a second, and the user should
have Blender back within two seconds, whatever the worker does."""
KILL_GRACE = 0.2
"""Seconds between ending the process politely and killing it."""
LOG_LINES = 60
"""Number of lines of the worker's stderr kept for an error message."""


def run(command: Sequence[str], *, cwd: str, env: Mapping[str, str], grace: float = CANCEL_GRACE) -> Messages:
    """Start `command` and yield lists of its new messages without waiting for them: a list may be empty.

    Send True to cancel: the worker is asked to stop, ended after `grace` seconds (0 for a program that does not read stdin), then killed.
    Closing the generator kills the worker at once. Returns the exit message.
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
                # a grandchild may hold the pipes open, so the wait for the readers is limited
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
        with contextlib.suppress(OSError):  # unsent text to a worker that has ended
            process.stdin.close()
        for stream in (process.stdout, process.stderr):
            # closing would wait for a blocked reader; if a grandchild holds the stream open, the reader closes it at its end
            if stream is not None and not any(reader.is_alive() for reader in readers):
                stream.close()


def told(error: SeeingWindError | OSError) -> tuple[str, str, str]:
    """Message, hint, and the control that mends it (or ""), for an error that a user can act on."""
    if isinstance(error, SeeingWindError):
        return error.message, error.hint, error.mend
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}{error.strerror or error}.", "Check that the folder is there and can be written.", ""


def said_by(error: RuntimeError) -> str:
    """The text that one of Blender's own operators has reported, without prefix and full stop."""
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
    # in a process group of its own: Ctrl-C in Blender's terminal reaches Blender only, and the worker is ended with its children
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
    """End a worker that does not stop by itself; `late` is the time since the end of its grace period [s]."""
    if late >= 0.0:
        _end(process, at_once=late >= KILL_GRACE)


def _ask(process: subprocess.Popen[str]) -> None:
    """Ask the worker to stop at its next safe point. It is no error if the worker has ended already."""
    with contextlib.suppress(OSError):
        process.stdin.write("cancel\n")
        process.stdin.flush()


def _end(process: subprocess.Popen[str], at_once: bool) -> None:
    """End the worker and its children: by SIGTERM, or by SIGKILL if `at_once`. On Windows there is only one way."""
    if systems.windows():
        # a virtual environment's python.exe starts the real Python as a child
        tree = ["taskkill", "/F", "/T", "/PID", str(process.pid)]
        with contextlib.suppress(OSError):
            subprocess.run(tree, stdin=subprocess.DEVNULL, capture_output=True, check=False, **systems.quiet())
        with contextlib.suppress(OSError):  # in case there is no taskkill
            process.kill()
        return
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL if at_once else signal.SIGTERM)


def _farewell(code: int, cancelled: bool, log: deque[str]) -> Message:
    outcome = "done" if code in (0, DONE_WITH_WARNINGS) else "cancelled" if cancelled or code in (CANCELLED, -signal.SIGINT) else "failed"
    return {"type": "exit", "code": code, "outcome": outcome, "log": "\n".join(log)}


def _death(code: int, log: deque[str]) -> Message:
    """An error message for a worker that failed without one."""
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
    """Make Ctrl-C and SIGTERM ask the worker to stop instead of ending this process (in the main thread only)."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kinds = [signal.SIGINT, signal.SIGTERM]
    former = {kind: signal.signal(kind, ask) for kind in kinds}
    try:
        yield
    finally:
        for kind, handler in former.items():
            # None: the handler was not set from Python, so it cannot be restored
            signal.signal(kind, handler if handler is not None else signal.SIG_DFL)
