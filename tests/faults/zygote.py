"""A process that has imported the engine and forks a child for every job: so a thousand of them take minutes.

A job is a JSON line on stdin: argv, the child's working folder `cwd`, a folder `out` for its stdout and stderr, limits (`seconds` of wall
clock, `bytes` of memory besides what the imports take, `file_bytes` of a written file or null), `kill_after` seconds or null, counted from
when the text `marker` stands in its stdout, `fail`, the number of the write that meets a full disk, or null, `vanish`, a folder that is
removed at the marker, or null, and `plain`, whether it runs without root's right to write everywhere. The answer is a JSON line with the
exit code, or minus the signal.
"""

from __future__ import annotations

import builtins
import ctypes
import errno
import importlib
import io
import json
import os
import resource
import shutil
import signal
import sys
import time
from typing import Any

ROOMS = (
    "command.verbs", "command.trajectories.bodies", "field.sampling", "look.report", "observe", "observe.object",
    "observe.object.motion.views", "recovery", "recovery.resimulate", "recovery.paper", "mpm.rollout",
)  # fmt: skip
"""What verbs import when they run."""
HASTE = 40
"""Iterations in which a field is fitted, except in `make faults`: no suite asks how good the fit is."""
CODECS = ("cp437", "utf_8_sig")
"""What Python imports when it first reads a zip file or a TOML file: a child without root's rights may not be able to."""


NOBODY = 65534


def virtual_size() -> int:
    """Bytes of address space that this process has."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[0]) * resource.getpagesize()


def full_disk(at: int, folder: str) -> None:
    """Let the write number `at` to a file under `folder` fail with ENOSPC, and every later one: a disk stays full.

    The seam is `open`, which everything in the engine that writes goes through, in Python: `io.open` and `Path.write_bytes` included.
    """
    count = 0
    real = io.open

    def step() -> None:
        nonlocal count
        count += 1
        if count > at:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    class Full:
        """A file whose writes count."""

        def __init__(self, file: Any) -> None:
            self._file = file

        def write(self, data: Any) -> int:
            step()
            return self._file.write(data)

        def writelines(self, lines: Any) -> None:
            step()
            self._file.writelines(lines)

        def __getattr__(self, name: str) -> Any:
            return getattr(self._file, name)

        def __enter__(self) -> Full:
            return self

        def __exit__(self, *_: Any) -> None:
            self._file.close()

        def __iter__(self) -> Any:
            return iter(self._file)

    def opening(file: Any, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        opened = real(file, mode, *arguments, **options)
        inside = not isinstance(file, int) and os.path.abspath(os.fspath(file)).startswith(folder)
        return Full(opened) if inside and any(letter in mode for letter in "wax+") else opened

    io.open = builtins.open = opening  # type: ignore[assignment]


def child(job: dict[str, Any], main: Any) -> int:
    """Run one job in this process, which ends with it."""
    for stream, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(os.path.join(job["out"], name), os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
    os.chdir(job["cwd"])
    if job["bytes"]:
        most = virtual_size() + job["bytes"]
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if job["file_bytes"] is not None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (job["file_bytes"], job["file_bytes"]))
    if job["plain"] and os.geteuid() == 0:
        ctypes.CDLL(None).setfsuid(NOBODY)  # drops what lets root write into a folder that forbids it
    if job["fail"] is not None:
        full_disk(job["fail"], job["cwd"])
    return main(job["argv"])


def reached(job: dict[str, Any]) -> bool:
    """Whether the child said the job's marker, or has none to say."""
    if not job["marker"]:
        return True
    try:
        with open(os.path.join(job["out"], "stdout"), encoding="utf-8", errors="replace") as file:
            return job["marker"] in file.read()
    except FileNotFoundError:
        return False


def run(job: dict[str, Any], main: Any) -> dict[str, Any]:
    """Fork a child for the job, wait for it, and end it where it overstays."""
    began = time.monotonic()
    pid = os.fork()
    if not pid:
        code = 70
        try:
            code = child(job, main)
        finally:
            sys.stderr.flush()
            os._exit(code)
    deadline, waiting = began + job["seconds"], True
    while True:
        done, status, usage = os.wait4(pid, os.WNOHANG)
        if done:
            break
        if waiting and reached(job):
            waiting = False
            if job["vanish"]:
                shutil.rmtree(job["vanish"], ignore_errors=True)
            if job["kill_after"] is not None:
                deadline = time.monotonic() + job["kill_after"]
        if time.monotonic() > deadline:
            os.kill(pid, signal.SIGKILL)
        time.sleep(0.002)
    work = usage.ru_utime + usage.ru_stime
    return {"code": os.waitstatus_to_exitcode(status), "seconds": time.monotonic() - began, "work": work}


def serve() -> None:
    from seeing_wind.engine.__main__ import main

    for room in ROOMS:
        importlib.import_module(f"seeing_wind.engine.{room}")
    if os.environ.get("SEEING_WIND_FAULTS") != "whole":
        importlib.import_module("seeing_wind.engine.field.distillation").ITERATIONS = HASTE
        # Nor how fast this machine is, which every recovery would measure, for longer than a short one takes.
        cost = importlib.import_module("seeing_wind.engine.recovery.cost")
        cost._measured = lambda plastic: cost.Speed(copy=2e-7, base=2e-6, change=2e-8)
    for codec in CODECS:
        importlib.import_module(f"encodings.{codec}")
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    print(json.dumps({"ready": True}), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(run(json.loads(line), main)), file=answers, flush=True)


if __name__ == "__main__":
    serve()
