"""Compiles what recoveries need of the solver into the compiler's cache: python tests/kernels.py

The tests start hundreds of processes. One that is killed, or ends without a word, keeps nothing of what it compiled, and those that run
side by side would compile the same. The cache is the compiler's own; the Makefile puts it into build/kernels. What else the tests compile
they add when they end.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
# The number of threads is part of the cache's key, and each process of the tests has one (tests/conftest.py).
os.environ["SEEING_WIND_THREADS"] = "1"

import numpy as np  # noqa: E402

from seeing_wind.engine.materials import SHEETS, Sheet  # noqa: E402
from seeing_wind.engine.mpm.shell import advance, at_rest, shell_of  # noqa: E402
from seeing_wind.engine.progress import Journal  # noqa: E402
from tests.engine.mpm.shell.conftest import grid  # noqa: E402
from tests.engine.mpm.test_body import gradients, problem  # noqa: E402
from tests.engine.recovery.test_checkpoint import by_descent, clay_by_descent, flowing, free, held  # noqa: E402


def sheets() -> None:
    """A soft sheet, whose matrices are factored in single precision, and a stiff one, whose matrices are in double."""
    for sheet, dt in ((SHEETS["silk"], 1e-3), (Sheet(0.12, 1e-3, 5e4, 1e-2), 2e-2)):
        shell = shell_of(*grid(0.3, 0.2, 12, 8), sheet)
        advance(shell, at_rest(shell, dt=dt), dt=dt, gravity=np.array([0.0, 0.0, -9.81]))


def main() -> None:
    """Recover small bodies of every kind, run a large one both ways, and let sheets fall."""
    began = time.perf_counter()
    for recover in (free, held, flowing, by_descent, clay_by_descent):
        recover(Journal())
    for law, precision in (("corotated", "double"), ("corotated", "single"), ("von_mises", "double")):
        gradients(*problem(law), precision)
    sheets()
    print(f"Kernels ready in {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
