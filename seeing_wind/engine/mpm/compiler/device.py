"""The start of the compiler of the kernels: once, on first use, never at import."""

from __future__ import annotations

import contextlib
import io
import math
import mmap
import os
import threading
from pathlib import Path

from . import ti

_lock = threading.Lock()
_running = False
QUOTA = Path("/sys/fs/cgroup/cpu.max")
_ADDRESSES = 2**30 + 2**29
"""Bytes of address space that must be free: the compiler reserves 2**30 at its start, the rest is for its threads and the first kernels."""


def start() -> None:
    """Start the compiler unless it has been started already; then it costs nothing.

    The solver runs on the CPU: a recovery simulates hundreds of copies of a body of a thousand particles, one copy per core, which would
    leave most of a GPU idle. Kernels are in double precision unless traced within `settings.compiled_in`. Fast math stays off, because it
    lets the compiler assume that no number is NaN, and so drop the very test that stops a diverging run.

    Raises:
        MemoryError: when there is not the address space that the compiler reserves.
    """
    global _running
    with _lock:
        if not _running:
            _reserve()
            # The greeting goes to stdout, where the worker's messages go.
            with contextlib.redirect_stdout(io.StringIO()):
                ti.init(arch=ti.cpu, default_fp=ti.f64, fast_math=False, log_level=ti.ERROR, cpu_max_num_threads=cores())
            _running = True


def _reserve() -> None:
    """Raise MemoryError where the compiler would not get its memory: it would abort the process from one of its threads, silently."""
    try:
        mmap.mmap(-1, _ADDRESSES).close()
    except OSError as error:
        raise MemoryError(f"{_ADDRESSES} bytes of address space for the compiler of the kernels.") from error


def cores() -> int:
    """Cores that this process may use, or those of the machine where the system cannot tell. A container's share is rounded up.

    SEEING_WIND_THREADS lowers the number where several engines share a machine: with more threads than cores, threads spin while they wait
    for each other.
    """
    asked = os.environ.get("SEEING_WIND_THREADS", "")
    if asked.isdecimal() and int(asked) > 0:
        return min(_cores(), int(asked))
    return _cores()


def _cores() -> int:
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    share = QUOTA.read_text().split() if QUOTA.is_file() else []
    # Microseconds of processor time per period, and the period's length; further threads would be stopped while others wait for them.
    return min(count, math.ceil(int(share[0]) / int(share[1]))) if len(share) == 2 and share[0] != "max" else count
