"""Install Engine: a Python environment of its own for the engine, as a job of several programs.

See `environment.user_environment` for its place. After a broken download or a cancel, the next attempt continues: the environment is kept,
and so are the packages that pip has fetched (`CACHE`), until everything is installed.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import bpy

from ....engine import systems
from ....engine.errors import SeeingWindError, UsageError
from .. import worker
from ..worker_command import ROOT, command, environment
from . import environment as engine_environment
from . import standalone
from .choices import folder_of_wheels
from .environment import MARKER, NoOnlineAccess, base_python, executable, said_by, user_environment

CACHE = "downloads"
"""Folder of pip's cache inside the environment."""

CPU_INDEX = "https://download.pytorch.org/whl/cpu"
"""PyTorch's own index of CPU builds. On Linux, the build on PyPI comes with several GB for graphics cards, which are not used."""

ALLOW = "Allow Online Access in Preferences > System > Network."
FETCHING = "Fetching a Python"
TRYING = "Trying the engine"
AGAIN = "Press Install Engine again: it goes on with what has been downloaded."

RETRIES = ("--retries", "8", "--timeout", "60")
"""pip's options for connections that break or stall."""


def install(fetch_python: bool = False) -> worker.Messages:
    """Make the environment and install the engine's packages, as a job.

    Args:
        fetch_python: if no Python fits, fetch one first.

    Raises:
        NoOnlineAccess: when Blender may not go online and no folder of wheels is named.
        UsageError: when the folder of wheels does not exist.
        SeeingWindError: when there is no fitting Python or no place for the environment.
    """
    wheels = folder_of_wheels()
    if wheels and not Path(wheels).is_dir():
        raise UsageError(f"There is no folder of wheels {wheels}.", "Correct it in the preferences, or clear it to download the packages.")
    if not wheels and not bpy.app.online_access:
        raise NoOnlineAccess(
            "Installing the engine needs the network, and Blender may not use it.",
            f"{ALLOW.rstrip('.')}, or name a folder of wheels in the extension's preferences.",
        )
    folder = user_environment(create=True)
    if folder is None:
        raise SeeingWindError("This is not an installed extension.", "From source, run `make setup` instead.")
    if systems.too_long(folder, engine_environment.LONGEST_INSIDE):
        raise SeeingWindError(
            f"The path of the engine's folder is too long for this Windows: {folder}.",
            "Switch long paths on in Windows, or name a Python with the engine's packages in the preferences.",
        )
    try:
        return run(base_python(), folder, wheels)
    except engine_environment.FetchablePython:
        if not fetch_python:
            raise
    if not bpy.app.online_access:
        raise NoOnlineAccess("Fetching a Python needs the network, and Blender may not use it.", ALLOW)
    home = standalone.place(create=True)
    assert home is not None  # otherwise it would not have been offered
    return _fetched_first(home, folder, wheels)


class Program(NamedTuple):
    """One of the programs that the job runs."""

    title: str
    first: float
    """Progress of the whole job at which this program begins."""
    last: float
    command: list[str]


def _fetched_first(home: Path, folder: Path, wheels: str) -> worker.Messages:
    """Fetch a Python into `home`, then continue with the installation."""
    fetching = Program(FETCHING, 0.0, 0.01, standalone.command(home))
    yield [{"type": "progress", "fraction": fetching.first, "message": FETCHING}]
    last = yield from _told(worker.run(fetching.command, cwd=str(home.parent), env=environment(), grace=0.0), fetching)
    if last["outcome"] != "done":
        return last
    return (yield from run(base_python(), folder, wheels))


def run(base: str, folder: Path, wheels: str) -> worker.Messages:
    """Run all programs one after the other; the marker is written once the engine has passed its own check."""
    (folder / MARKER).unlink(missing_ok=True)
    last: worker.Message = {}
    for program in programs(base, folder, wheels):
        yield [{"type": "progress", "fraction": program.first, "message": program.title}]
        # only the engine handles a request to stop; pip is ended, and the packages it has fetched are kept
        last = yield from _told(worker.run(program.command, cwd=str(folder), env=environment(), grace=0.0), program)
        if last["outcome"] != "done":
            return last
    (folder / MARKER).write_text("made by Install Engine\n", encoding="utf-8")
    shutil.rmtree(folder / CACHE, ignore_errors=True)
    return last


def programs(base: str, folder: Path, wheels: str) -> list[Program]:
    """The programs to run.

    Args:
        base: a Python that can make environments.
        wheels: a folder of wheels to take everything from instead of the network, or "".
    """
    python = str(executable(folder))
    pip = [python, "-m", "pip", "install", "--no-input", "--disable-pip-version-check", "--progress-bar", "off"]
    engine = ROOT / "seeing_wind" / "engine"
    # --clear also deletes the cache in the folder, so it is used only if the environment is unusable
    made = [] if _runs(python) else [Program("Making the environment", 0.01, 0.03, [base, "-m", "venv", "--clear", str(folder)])]
    trying = Program(TRYING, 0.95, 1.0, command(python, "doctor"))
    # all that PyTorch needs on a CPU is locked with the other packages
    pytorch, packages = ["--no-deps", "-r", str(engine / "torch.lock")], ["--require-hashes", "-r", str(engine / "requirements.lock")]
    if wheels:
        local = [*pip, "--no-index", "--find-links", wheels]
        return [
            *made,
            Program("Installing PyTorch", 0.04, 0.5, [*local, *pytorch]),
            Program("Installing packages", 0.5, 0.94, [*local, *packages]),
            trying,
        ]
    fetch = [*pip, "--cache-dir", str(folder / CACHE), *RETRIES]
    return [
        *made,
        Program("Updating pip", 0.04, 0.06, [*fetch, "--upgrade", "pip"]),
        Program("Downloading PyTorch", 0.06, 0.5, [*fetch, *torch_index(), *pytorch]),
        Program("Downloading packages", 0.5, 0.94, [*fetch, *packages]),
        trying,
    ]


def torch_index(platform: str = sys.platform) -> list[str]:
    """pip's option for the CPU build of PyTorch; empty on macOS, where PyPI has it."""
    return [] if platform == "darwin" else ["--index-url", CPU_INDEX]


def _runs(python: str) -> bool:
    """Whether an environment left by an earlier attempt has a working Python with pip."""
    return Path(python).is_file() and said_by([python], "import pip; print('yes')").strip() == "yes"


def _told(messages: worker.Messages, program: Program) -> worker.Messages:
    """Turn pip's lines into progress: each package moves the bar closer to the program's end, as their number is not known beforehand."""
    fraction, cancel = program.first, None
    try:
        batch = next(messages)
        while True:
            told = []
            for message in batch:
                if message["type"] == "log":
                    if message["message"].lstrip().startswith(("Collecting", "Downloading", "Using cached", "Installing")):
                        fraction += (program.last - fraction) * 0.05
                    said = f"{program.title}: {message['message'].strip()[:80]}"
                    told.append({"type": "progress", "fraction": fraction, "message": said})
                elif message["type"] == "progress":
                    fraction = program.first + (program.last - program.first) * float(message["fraction"])
                    told.append({**message, "fraction": fraction})
                elif message["type"] == "error" and program.title not in (TRYING, FETCHING):
                    said = message["message"].replace("The engine stopped", f"{program.title} stopped")
                    told.append({**message, "message": said, "hint": AGAIN})
                else:
                    told.append(message)
            cancel = yield told
            batch = messages.send(cancel)
    except StopIteration as end:
        return end.value
    finally:
        messages.close()
