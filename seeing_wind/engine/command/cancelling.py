"""Cancel by the pipe: who starts a worker writes "cancel" to its stdin, on every system. The end of the pipe cancels too: nobody waits.

Only a worker that is told so listens (`CANCEL_BY_STDIN`).
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
"""Between two looks into the pipe on Windows."""


def listen(cancel: Callable[[], None]) -> threading.Thread | None:
    """Call `cancel` once the parent writes a line "cancel" or is gone. Returns the listening thread; None where nobody asked for one."""
    if os.environ.pop(CANCEL_BY_STDIN, "") != "1" or sys.__stdin__ is None:  # popped: programs that we start have another stdin
        return None
    stdin = sys.__stdin__.fileno()
    pipe = os.dup(stdin)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, stdin)  # neither a library nor a program that it starts shall read the pipe or keep it open
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
    """What comes next; b"" at the end."""
    while systems.windows() and not bytes_waiting(pipe):
        time.sleep(LOOK_SECONDS)
    return os.read(pipe, 4096)


def bytes_waiting(pipe: int) -> int:
    """Bytes that lie in a pipe of Windows. There a thread that waits in a read blocks whatever else asks about the pipe, such as a C
    library that looks at stdin as it is loaded.

    Raises:
        OSError: when the pipe is broken.
    """
    import ctypes
    import msvcrt

    count = ctypes.c_ulong()
    handle = msvcrt.get_osfhandle(pipe)  # type: ignore[attr-defined]
    if not ctypes.windll.kernel32.PeekNamedPipe(ctypes.c_void_p(handle), None, 0, None, ctypes.byref(count), None):  # type: ignore[attr-defined]
        raise OSError("the pipe is broken")
    return count.value
