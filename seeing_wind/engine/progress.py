"""Progress and cancelling: an argument with a no-op default, so that no stage knows who watches."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

CANCEL_BY_STDIN = "SEEING_WIND_CANCEL_BY_STDIN"
"""Environment variable, "1" from a parent that cancels by the worker's stdin. stdin may also be a terminal, an empty file or nothing."""


class Cancelled(Exception):
    """Raised at a safe point after the user asked to stop. Nothing half-written is left behind."""


class Progress:
    """What a long job reports to.

    Args:
        emit: receives one message (a dict that JSON can hold) per call, or None to be silent.
        cancelled: asked at every safe point; True raises `Cancelled` there.
    """

    def __init__(self, emit: Callable[[dict[str, Any]], None] | None = None, cancelled: Callable[[], bool] | None = None) -> None:
        self._emit = emit or (lambda message: None)
        self._cancelled = cancelled or (lambda: False)
        self.stage = ""

    def begin(self, stage: str, message: str = "") -> None:
        """Name the stage that the following `update` calls belong to (observe, build, recover, resimulate, report)."""
        self.stage = stage
        self.update(0.0, message)

    def update(self, fraction: float, message: str = "", **figures: float) -> None:
        """Report `fraction` (0..1) of the current stage, with optional figures such as `residual`. A safe point.

        Raises:
            Cancelled: when the user asked to stop.
        """
        self.check()
        self._emit({"type": "progress", "stage": self.stage, "fraction": round(float(fraction), 4), "message": message, **figures})

    def warn(self, message: str) -> None:
        """Something the user should know that does not stop the job."""
        self._emit({"type": "warning", "stage": self.stage, "message": message})

    def check(self) -> None:
        """A safe point without a report. Call it at least twice a second.

        Raises:
            Cancelled: when the user asked to stop.
        """
        if self._cancelled():
            raise Cancelled


class NoProgress(Progress):
    """Nobody watches and nobody cancels."""
