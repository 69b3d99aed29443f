"""The products of a report, each made independently: one that cannot be made does not prevent the others."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from ...errors import SeeingWindError
from ...progress import Cancelled, Journal, Progress

T = TypeVar("T")

Level = Literal["none", "quick", "full"]
"""How much of a report is made: see `write_report`."""


@dataclass(frozen=True)
class _Numbers:
    found: str
    """JSON."""


class Products:
    """Makes products one by one, and records how long each takes, or why it is missing.

    Args:
        journal: the report's, so that a file made by a run that was killed is not made again.

    Attributes:
        record: `level`; `seconds` per product made; `missing`, a sentence for each product that could not be made.
    """

    def __init__(self, level: Level, progress: Progress, journal: Journal) -> None:
        self._progress, self.journal = progress, journal
        self.record: dict[str, Any] = {"level": level, "seconds": {}, "missing": {}}

    def make(self, name: str, work: Callable[[], T], *, timed: bool = True) -> T | None:
        """The result of `work`, or None, with a warning, if it fails. Without `timed` its seconds are not recorded."""
        started = time.perf_counter()
        try:
            result = work()
        except Cancelled:
            raise
        except SeeingWindError as error:
            self._miss(name, str(error))
            return None
        except Exception as error:
            # The field has been recovered already: whatever an odd codec or library does to an image of it must not fail the job.
            traceback.print_exc()
            self._miss(name, f"Unexpected {type(error).__name__}: {error}. The log has the details.")
            return None
        if timed:
            self.record["seconds"][name] = round(time.perf_counter() - started, 3)
        return result

    def film(self, path: Path, work: Callable[[], dict[str, float] | None]) -> dict[str, float] | None:
        """`make` for a `work` that writes the file `path`; returns the numbers about it that `work` returns."""

        def numbers() -> _Numbers:
            return _Numbers(json.dumps(work()))

        def kept() -> dict[str, float]:
            found = self.journal.once(path.name, _Numbers, numbers)
            return json.loads((found if path.is_file() else numbers()).found) or {}

        return self.make(path.name, kept)

    def _miss(self, name: str, why: str) -> None:
        self.record["missing"][name] = why
        self._progress.warn(f"The report's {name} could not be made. {why}")
