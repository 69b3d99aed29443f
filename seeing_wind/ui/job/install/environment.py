"""The engine's own Python: where it is. `install` makes it.

Found in this order: the preference, SEEING_WIND_PYTHON, the environment that Install Engine made in the extension's user folder, and a
`.venv` beside the source (development).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

from ....engine.errors import MissingPackage, SeeingWindError
from .. import status
from ..worker_command import ROOT, environment
from .choices import EXTENSION, preferred_python

VERSIONS = ((3, 11), (3, 12), (3, 13))
"""Pythons that the engine's packages have wheels for."""

MARKER = ".complete"
"""Written into an environment when all packages are in it."""

PROBE_SECONDS = 10.0


class NoOnlineAccess(SeeingWindError):
    """Something must be downloaded and the user has not allowed it."""

    mend = "allow_online"


class WrongPython(SeeingWindError):
    """The preference names something that is no Python."""

    mend = "open_preferences"


def engine_python() -> str:
    """The executable that runs the engine.

    Raises:
        WrongPython: when the preference or SEEING_WIND_PYTHON names no file.
        MissingPackage: when there is none; `mend` names the operator that installs it.
    """
    for chosen, where in ((preferred_python(), "the preferences"), (os.environ.get("SEEING_WIND_PYTHON", ""), "SEEING_WIND_PYTHON")):
        if chosen:
            if not os.path.isfile(chosen):
                raise WrongPython(
                    f"The engine's Python named by {where} is not there: {chosen}.", "Correct it, or clear it to use the installed engine."
                )
            return chosen
    home = user_environment(create=False)
    if home is not None and (home / MARKER).is_file() and executable(home).is_file():
        return str(executable(home))
    for folder in (ROOT, *ROOT.parents):
        if executable(folder / ".venv").is_file():
            return str(executable(folder / ".venv"))
    raise MissingPackage("The engine is not installed yet.", "Install it once: 400 MB to download, 1.6 GB on disk (CPU build).")


def user_environment(create: bool) -> Path | None:
    """The folder of the environment that Install Engine makes; None where this is no installed extension."""
    if not EXTENSION.startswith("bl_ext."):
        return None
    try:
        return Path(bpy.utils.extension_path_user(EXTENSION, path="engine", create=create))
    except ValueError:  # enabled in another way than through a repository
        return None


def executable(folder: Path) -> Path:
    """The Python of a virtual environment."""
    return folder / "Scripts" / "python.exe" if sys.platform == "win32" else folder / "bin" / "python"


def base_python() -> str:
    """A Python to make the environment with: Blender's own if it can, else one of the PATH.

    Raises:
        SeeingWindError: when there is none of a version that the engine's packages are built for.
    """
    tried = []
    for candidate in _candidates():
        version = _probe(candidate)
        if version in VERSIONS:
            return candidate
        if version:
            tried.append(f"{candidate} is {version[0]}.{version[1]}")
    wanted = ", ".join(f"{a}.{b}" for a, b in VERSIONS)
    found = f" ({'; '.join(tried)})" if tried else ""
    raise SeeingWindError(
        f"No Python {wanted} with venv was found{found}.",
        "Install one of these from your system or python.org, then try again, or name one in the preferences.",
    )


def _candidates() -> Iterator[str]:
    yield sys.executable
    for major, minor in reversed(VERSIONS):
        found = shutil.which(f"python{major}.{minor}")
        if found:
            yield found
    for name in ("python3", "python"):
        found = shutil.which(name)
        if found:
            yield found


def _probe(candidate: str) -> tuple[int, int] | None:
    """The version of a Python that can make environments, None for anything else."""
    try:
        major, minor = _said(candidate, "import sys, venv, ensurepip; print(*sys.version_info[:2])").split()
        return int(major), int(minor)
    except ValueError:  # no such Python: the next candidate
        return None


def answers(python: str, code: str) -> bool:
    """Whether `python` runs `code` without an error."""
    return _said(python, f"{code}; print('yes')").strip() == "yes"


def _said(python: str, code: str) -> str:
    """What `python -c code` prints; "" where it is not there or hangs."""
    try:
        answer = subprocess.run(
            [python, "-c", code],
            capture_output=True, text=True, timeout=PROBE_SECONDS, env=environment(), stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return answer.stdout


def refresh() -> None:
    """Look for the engine and keep what the panel says about it."""
    try:
        status.engine.python, status.engine.problem = engine_python(), None
    except SeeingWindError as error:
        status.engine.python = ""
        status.engine.problem = status.Step(status.State.FAILED, message=error.message, hint=error.hint, mend=error.mend)
