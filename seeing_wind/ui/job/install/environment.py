"""Finding the engine's own Python. `install` makes it.

Searched in this order: the preference, SEEING_WIND_PYTHON, the environment that Install Engine made in the extension's user folder, and a
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

from ....engine import systems
from ....engine.errors import MissingPackage, SeeingWindError
from .. import status
from ..worker_command import ROOT, environment
from . import standalone
from .choices import EXTENSION, preferred_python

VERSIONS = ((3, 11), (3, 12), (3, 13))
"""Python versions for which the engine's packages have wheels."""

MARKER = ".complete"
"""File written into an environment once it is complete."""

LONGEST_INSIDE = 189
"""Length of the longest path inside an environment [characters]: a licence in PyTorch's wheel."""

PROBE_SECONDS = 10.0

ABLE = (
    "import glob, os, sys, venv, ensurepip;"
    "made = glob.glob(os.path.join(os.path.dirname(venv.__file__), 'scripts', 'nt', '*.exe'));"
    "print(*sys.version_info[:2]) if made or os.name != 'nt' else None"
)
"""Code that prints the version of a Python if it can make environments. On Windows, that needs a launcher which some builds lack."""


class NoOnlineAccess(SeeingWindError):
    """Something must be downloaded, but the user has not allowed online access."""

    mend = "allow_online"


class WrongPython(SeeingWindError):
    """The preference, or SEEING_WIND_PYTHON, names a Python that does not exist."""

    mend = "open_preferences"


class NoPython(SeeingWindError):
    """There is no Python of a version for which the engine's packages are built."""


class FetchablePython(NoPython):
    """There is no such Python, but one can be fetched."""

    mend = "fetch_python"


def engine_python() -> str:
    """The executable that runs the engine.

    Raises:
        WrongPython: when the preference or SEEING_WIND_PYTHON names no file.
        MissingPackage: when no Python is found; `mend` names the operator that installs the engine.
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
    """The folder of the environment that Install Engine makes; None if this is not an installed extension.

    It lies in the extension's user folder, which Blender deletes with the extension. On a Windows without long paths, where PyTorch's files
    would not fit there, it lies in `seeing_wind` in the user's local application data instead.
    """
    if not EXTENSION.startswith("bl_ext."):
        return None
    try:
        folder = Path(bpy.utils.extension_path_user(EXTENSION, path="engine", create=create))
    except ValueError:  # not enabled through a repository
        return None
    local = os.environ.get("LOCALAPPDATA")
    if not local or not systems.too_long(folder, LONGEST_INSIDE):
        return folder
    folder = Path(local) / "seeing_wind" / f"engine-{bpy.app.version[0]}.{bpy.app.version[1]}"
    if create:
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def executable(folder: Path) -> Path:
    """The Python executable of a virtual environment."""
    return folder / "Scripts" / "python.exe" if systems.windows() else folder / "bin" / "python"


def base_python() -> str:
    """A Python that can make the environment: Blender's own if possible, else one of the system, else the fetched one.

    Raises:
        NoPython: when there is none of a version that the engine's packages are built for.
    """
    tried = []
    for candidate in candidates():
        version = version_of(candidate)
        if version in VERSIONS:
            return candidate
        if version:
            tried.append(f"{candidate} is {version[0]}.{version[1]}")
    wanted = ", ".join(f"{a}.{b}" for a, b in VERSIONS)
    found = f" ({'; '.join(dict.fromkeys(tried))})" if tried else ""
    message = f"No Python {wanted} with venv was found{found}."
    if standalone.build() is not None and standalone.place(create=False) is not None:
        raise FetchablePython(message, f"Fetch one for the engine alone: {standalone.SIZE}. Or name yours in the preferences.")
    raise NoPython(message, "Install one of these from your system or python.org, then try again, or name one in the preferences.")


def candidates() -> Iterator[str]:
    """Executables that may be a suitable Python, Blender's own first; they are not checked yet."""
    yield sys.executable
    launcher = shutil.which("py") if systems.windows() else None
    for major, minor in reversed(VERSIONS):
        found = shutil.which(f"python{major}.{minor}")
        if found:
            yield found
        if launcher:  # from python.org's installer, which puts no Python on the PATH
            said = said_by([launcher, f"-{major}.{minor}"], "import sys; print(sys.executable)").strip()
            if said:
                yield said
    for name in ("python3", "python"):
        found = shutil.which(name)
        if found:
            yield found
    fetched = standalone.place(create=False)
    if fetched is not None and standalone.executable(fetched).is_file():
        yield str(standalone.executable(fetched))


def version_of(candidate: str) -> tuple[int, int] | None:
    """The version of a Python that can make environments; None for anything else."""
    try:
        major, minor = said_by([candidate], ABLE).split()
        return int(major), int(minor)
    except ValueError:  # not a suitable Python: try the next candidate
        return None


def said_by(python: list[str], code: str) -> str:
    """The output of `python -c code`; "" if the program is missing or hangs."""
    try:
        answer = subprocess.run(
            [*python, "-c", code], stdin=subprocess.DEVNULL, capture_output=True, encoding="utf-8", errors="replace",
            timeout=PROBE_SECONDS, env=environment(), check=False, **systems.quiet(),
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return answer.stdout


def refresh() -> None:
    """Look for the engine, and store the result for the panel."""
    former = status.engine.python
    try:
        status.engine.python, status.engine.problem = engine_python(), None
    except SeeingWindError as error:
        status.engine.python = ""
        status.engine.problem = status.Step(status.State.FAILED, message=error.message, hint=error.hint, mend=error.mend)
    if status.engine.python != former:
        status.forget_engine_failures()
