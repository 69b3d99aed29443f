"""Progress, cancelling and a journal: arguments with a no-op default, so that no stage knows who watches it or keeps its results."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import numpy as np

R = TypeVar("R")

CANCEL_BY_STDIN = "SEEING_WIND_CANCEL_BY_STDIN"
"""Environment variable: a parent that cancels through the worker's stdin sets it to "1". Otherwise stdin may be anything, or nothing."""


class Cancelled(Exception):
    """Raised at a safe point after the user asked to stop. Nothing half-written is left behind."""


class Progress:
    """Receives the reports of a long job. A function that takes one reaches a safe point at least twice a second, where it may raise
    `Cancelled`.

    Args:
        emit: receives one message (a dict that JSON can hold) per call, or None to be silent.
        cancelled: called at every safe point; True raises `Cancelled` there.
    """

    def __init__(self, emit: Callable[[dict[str, Any]], None] | None = None, cancelled: Callable[[], bool] | None = None) -> None:
        self._emit = emit or (lambda message: None)
        self._cancelled = cancelled or (lambda: False)
        self.stage = ""

    def begin(self, stage: str, message: str = "") -> None:
        """Name the stage that the following `update` calls belong to (observe, build, recover, resimulate, report)."""
        self.stage = stage
        self.update(0.0, message)

    def update(self, fraction: float, message: str = "", **figures: float | str) -> None:
        """Report `fraction` (0..1) of the current stage, with optional figures such as `residual`. A safe point."""
        self.check()
        self._emit({"type": "progress", "stage": self.stage, "fraction": round(float(fraction), 4), "message": message, **figures})

    def part(self, begin: float, end: float) -> Progress:
        """A `Progress` for the part of the current stage from fraction `begin` to `end`."""
        return _Part(self, begin, end)

    def quiet(self) -> Progress:
        """A `Progress` with the same safe points that reports nothing."""
        return _Quiet(self)

    def noting(self, told: list[str]) -> Progress:
        """A `Progress` for the same stage that also adds to `told` every warning that no verdict repeats."""
        return _Noting(self, told)

    def worded(self, words: Callable[[str], str]) -> Progress:
        """A `Progress` for the same stage that tells every warning in the words that `words` makes of it."""
        return _Worded(self, words)

    def warn(self, message: str, judged: bool = False) -> None:
        """Tell the user something that does not stop the job; `judged`: a verdict of the preview says the same."""
        self._emit({"type": "warning", "stage": self.stage, "message": message})

    def check(self) -> None:
        """A safe point without a report: raises `Cancelled` once the user has asked to stop."""
        if self._cancelled():
            raise Cancelled


class _Part(Progress):
    def __init__(self, whole: Progress, begin: float, end: float) -> None:
        super().__init__()
        self._whole, self._begin, self._end = whole, begin, end

    def begin(self, stage: str, message: str = "") -> None:
        self._whole.stage = stage
        self.update(0.0, message)

    def update(self, fraction: float, message: str = "", **figures: float | str) -> None:
        self._whole.update(self._begin + fraction * (self._end - self._begin), message, **figures)

    def warn(self, message: str, judged: bool = False) -> None:
        self._whole.warn(message, judged)

    def check(self) -> None:
        self._whole.check()


class _Noting(_Part):
    def __init__(self, whole: Progress, told: list[str]) -> None:
        super().__init__(whole, 0.0, 1.0)
        self._told = told

    def warn(self, message: str, judged: bool = False) -> None:
        super().warn(message, judged)
        if not judged:
            self._told.append(message)


class _Worded(_Part):
    def __init__(self, whole: Progress, words: Callable[[str], str]) -> None:
        super().__init__(whole, 0.0, 1.0)
        self._words = words

    def warn(self, message: str, judged: bool = False) -> None:
        super().warn(self._words(message), judged)


class _Quiet(Progress):
    def __init__(self, whole: Progress) -> None:
        super().__init__()
        self._whole = whole

    def check(self) -> None:
        self._whole.check()


class NoProgress(Progress):
    """Reports to nobody, and is never cancelled."""


class Loop:
    """A loop that cannot be resumed."""

    def resume(self) -> tuple[int, dict[str, np.ndarray]]:
        """The number of rounds that an earlier run has done, and the state after them; 0 and nothing for a new loop."""
        return 0, {}

    def reached(self, done: int, state: Callable[[], dict[str, np.ndarray]]) -> None:
        """Call it after each round with the number of rounds done; `state` is called when it is time to keep it."""


class Journal:
    """A journal of a long computation that keeps nothing: the default wherever one is asked for. See `recovery.journal`."""

    def once(self, name: str, kind: type[R], work: Callable[[], R], *inputs: Any) -> R:
        """The result of `work`, a record of the class `kind` (see `records`); it is read instead if an earlier run has got past this point.

        Args:
            name: of this part of the computation; parts with the same name are distinguished by their order.
            inputs: what may differ between runs with the same stamp of the journal (see `stamp_of`).
        """
        return work()

    def array(self, name: str, work: Callable[[], np.ndarray], *inputs: Any) -> np.ndarray:
        """`once` for a single array."""
        return work()

    def loop(self, name: str, *inputs: Any) -> Loop:
        """The loop that begins here; arguments as for `once`."""
        return Loop()


def in_words(seconds: float) -> str:
    """A time in words, no more precise than an estimate is."""
    if seconds < 55.0:
        return f"{max(5, 5 * round(seconds / 5))} seconds"
    if seconds < 5400.0:
        minutes = round(seconds / 60)
        return "a minute" if minutes == 1 else f"{minutes} minutes"
    return f"{seconds / 3600:.1f} hours"
