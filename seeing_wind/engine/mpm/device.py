"""Where Taichi starts: once, on first use, never at import."""

from __future__ import annotations

import contextlib
import io
import math
import os
import threading
from pathlib import Path

import taichi as ti

from ..errors import SimulationError, UsageError

_lock = threading.Lock()
_running: str | None = None
_QUOTA = Path("/sys/fs/cgroup/cpu.max")


def start(device: str = "auto") -> None:
    """Start Taichi for `device` (auto, cpu or cuda) if it does not run yet; cheap afterwards.

    `auto` is the CPU: a recovery simulates hundreds of copies of a body of a thousand particles, one copy per core, which leaves a
    GPU's lanes idle. Double precision unless a kernel is traced within `precision.compiled_in`. Fast math stays off, as it lets the
    compiler assume that no number is NaN and so drop the very test that stops a diverging run.

    Raises:
        UsageError: for an unknown device.
        SimulationError: when CUDA is asked for and not there, or Taichi already runs elsewhere.
    """
    global _running
    wanted = {"auto": "cpu", "cpu": "cpu", "cuda": "cuda"}.get(device)
    if wanted is None:
        raise UsageError(f"There is no device {device!r}.", "Choose auto, cpu or cuda.")
    with _lock:
        if _running is None:
            arch = ti.cuda if wanted == "cuda" else ti.cpu
            # Taichi greets on stdout, where the worker's messages go.
            with contextlib.redirect_stdout(io.StringIO()):
                ti.init(arch=arch, default_fp=ti.f64, fast_math=False, log_level=ti.ERROR, cpu_max_num_threads=cores())
            _running = "cuda" if ti.cfg.arch == ti.cuda else "cpu"
    if _running != wanted and device != "auto":
        raise SimulationError(f"The solver runs on {_running}, not on {wanted}.", "Choose --device auto, or start the engine afresh.")


def on_gpu() -> bool:
    """Whether Taichi runs on a GPU."""
    return _running == "cuda"


def cores() -> int:
    """Cores that this process may use; some systems cannot say and count the machine's. A container's share is rounded up.

    SEEING_WIND_THREADS lowers it, where several engines share a machine: threads in excess of the cores wait for each other on the spot.
    """
    asked = os.environ.get("SEEING_WIND_THREADS", "")
    if asked.isdecimal() and int(asked) > 0:
        return min(_cores(), int(asked))
    return _cores()


def _cores() -> int:
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    share = _QUOTA.read_text().split() if _QUOTA.is_file() else []
    # Microseconds of processor time in each period of so many; more threads than that would be stopped while others wait for them.
    return min(count, math.ceil(int(share[0]) / int(share[1]))) if len(share) == 2 and share[0] != "max" else count
