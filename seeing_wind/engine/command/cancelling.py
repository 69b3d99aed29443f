"""Cancelling through a pipe: on every system, the parent of a worker writes "cancel" to the worker's stdin.

The end of the pipe cancels, too, as the parent is then gone. A worker listens only if the environment variable `CANCEL_BY_STDIN` says so.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable

from .. import systems
from ..progress import CANCEL_BY_STDIN

LOOK_SECONDS = 0.05
"""Time between two checks of the pipe on Windows."""


def listen(cancel: Callable[[], None]) -> threading.Thread | None:
    """Call `cancel` once the parent writes a line "cancel" or is gone.

    Returns the listening thread; None if the environment does not ask for one.
    """
    if os.environ.pop(CANCEL_BY_STDIN, "") != "1" or sys.__stdin__ is None:  # removed: processes that we start have another stdin
        return None
    stdin = sys.__stdin__.fileno()
    pipe = os.dup(stdin)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, stdin)  # so that no library, and no process that it starts, reads the pipe or keeps it open
    os.close(nothing)
    thread = threading.Thread(target=_follow, args=(pipe, cancel), daemon=True, name="seeing-wind-cancel")
    thread.start()
    return thread


def _follow(pipe: int, cancel: Callable[[], None]) -> None:
    said = b""
    while b"cancel" not in said.splitlines():
        try:
            more = _read(pipe)
        except OSError:  # a broken pipe: its other end is gone
            more = b""
        if not more:
            break
        said = said[-16:] + more
    os.close(pipe)
    cancel()


def _read(pipe: int) -> bytes:
    """The next bytes from the pipe; b"" at its end."""
    while systems.windows() and not bytes_waiting(pipe):
        time.sleep(LOOK_SECONDS)
    return os.read(pipe, 4096)


def bytes_waiting(pipe: int) -> int:
    """Number of bytes that can be read from a pipe on Windows without waiting.

    On Windows, a thread that waits in a read blocks every other query of the pipe, such as that of a C library that inspects stdin when it
    is loaded.

    Raises:
        OSError: the pipe is broken.
    """
    import ctypes
    import msvcrt

    count = ctypes.c_ulong()
    handle = msvcrt.get_osfhandle(pipe)  # type: ignore[attr-defined]
    if not ctypes.windll.kernel32.PeekNamedPipe(ctypes.c_void_p(handle), None, 0, None, ctypes.byref(count), None):  # type: ignore[attr-defined]
        raise OSError("the pipe is broken")
    return count.value
