"""What the suites count, printed at the end of a run."""

from __future__ import annotations

import os
from collections import Counter

COUNTS: Counter[str] = Counter({"inputs": 0, "kills": 0, "disks": 0, "tracebacks": 0, "lost": 0})

WHOLE = os.environ.get("SEEING_WIND_FAULTS") == "whole"
"""Whether `make faults` runs: everything, instead of a quick draw."""


def draws(quick: int, whole: int) -> int:
    """How many draws of a suite are made."""
    return int(os.environ.get("SEEING_WIND_DRAWS", 0)) or (whole if WHOLE else quick)
