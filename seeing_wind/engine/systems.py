"""What Linux, macOS and Windows do differently: starting a process, replacing a file, the length of a path.

Everything asks `windows()` here, so that a test can substitute another system's rules.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

LONGEST_PATH = 259
"""Longest path that Windows accepts [characters], unless long paths are enabled in its registry."""

NO_WINDOW = 0x08000000
"""CREATE_NO_WINDOW: a console program started from a window does not open a console. (`subprocess` has the names on Windows only.)"""
NEW_GROUP = 0x00000200
"""CREATE_NEW_PROCESS_GROUP: a Ctrl-C in this process's console does not reach the child."""

PAUSES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
"""Seconds between attempts to replace a file that is open elsewhere. A virus scanner or an indexer releases a new file within a second."""


def windows() -> bool:
    """Whether this is Windows."""
    return sys.platform == "win32"


def quiet() -> dict[str, Any]:
    """Options of `subprocess.run` for a short program: no console window flashes up."""
    return {"creationflags": NO_WINDOW} if windows() else {}


def apart() -> dict[str, Any]:
    """Options of `subprocess.Popen` for a worker in its own process group, which a Ctrl-C in our terminal does not reach."""
    return {"creationflags": NO_WINDOW | NEW_GROUP} if windows() else {"start_new_session": True}


def replace(source: str | os.PathLike[str], target: str | os.PathLike[str]) -> None:
    """Replace `target` by the file or folder `source`, atomically.

    Windows refuses this while either is open in another program, such as a virus scanner; there it is tried for almost two seconds.

    Raises:
        OSError: as `os.replace`; PermissionError on Windows while the file is still open elsewhere.
    """
    for pause in PAUSES if windows() else ():
        try:
            return os.replace(source, target)
        except PermissionError:
            time.sleep(pause)
    os.replace(source, target)


def too_long(folder: str | os.PathLike[str], inside: int) -> bool:
    """Whether a path of `inside` characters within `folder` is longer than this Windows accepts; never on other systems."""
    return windows() and len(str(Path(folder).absolute())) + 1 + inside > LONGEST_PATH and not long_paths()


def long_paths() -> bool:
    """Whether long paths are enabled in Windows (Python declares in its manifest that it supports them)."""
    import winreg

    try:
        with winreg.OpenKey(winreg.HKEY_LOCAL_MACHINE, r"SYSTEM\CurrentControlSet\Control\FileSystem") as key:  # type: ignore[attr-defined]
            return bool(winreg.QueryValueEx(key, "LongPathsEnabled")[0])  # type: ignore[attr-defined]
    except OSError:
        return False


def alive(pid: int) -> bool:
    """Whether there is a process with this number on this machine."""
    if sys.platform == "win32":  # where os.kill would end the process
        import ctypes

        kernel, synchronize = ctypes.windll.kernel32, 0x100000
        handle = kernel.OpenProcess(synchronize, False, pid)
        if handle:
            running = kernel.WaitForSingleObject(handle, 0) != 0
            kernel.CloseHandle(handle)
            return bool(running)
        return kernel.GetLastError() == 5  # access denied: it exists, and is another user's
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def reader(stream: IO[str] | None, put: Callable[[str], Any]) -> threading.Thread:
    """A thread that passes on the lines of a pipe and touches nothing else; it is needed because not every system can poll pipes."""

    def read() -> None:
        with contextlib.suppress(ValueError, OSError):  # the pipe was closed from this side
            for line in stream or ():
                put(line.rstrip("\n"))

    thread = threading.Thread(target=read, daemon=True, name="seeing-wind-reader")
    thread.start()
    return thread


@contextlib.contextmanager
def scratch() -> Iterator[Path]:
    """A folder for this process alone, removed at the end. Folders left behind by processes that were killed are removed first."""
    host = re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname())  # other machines may use the same folder for temporary files
    for path in Path(tempfile.gettempdir()).iterdir():
        found = re.fullmatch(rf"seeing_wind_{host}_(\d+)_.*", path.name)
        if found and not alive(int(found[1])):
            shutil.rmtree(path, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix=f"seeing_wind_{host}_{os.getpid()}_") as folder:
        yield Path(folder)
