"""A job's messages as lines of text for people and farm logs."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, TextIO

from .panel_words import in_panel_words, residual_told

if TYPE_CHECKING:
    from .worker import Message

EVERY = 2.0
"""Least time between two progress lines of one stage [s]."""


class Console:
    """Prints progress on `out`, warnings and errors on `err`: a line per stage, and one every few seconds within a stage."""

    def __init__(self, out: TextIO | None = None, err: TextIO | None = None) -> None:
        self.out, self.err = out or sys.stdout, err or sys.stderr
        self.stage, self.shown = "", -EVERY

    def show(self, message: Message) -> None:
        """Print one message."""
        kind = message["type"]
        if kind == "progress":
            self._progress(message)
        elif kind == "warning":
            print(f"Warning: {message.get('message', '')}", file=self.err, flush=True)
        elif kind == "error":
            if message.get("log"):
                print(message["log"], file=self.err)
            print(f"Error: {message.get('message', '')} {message.get('hint', '')}".rstrip(), file=self.err, flush=True)
        elif kind == "log":
            print(message["message"], file=self.out, flush=True)
        elif kind == "result" and message.get("outcome") != "failed":  # the error message has been printed already
            for check in message.get("checks", ()):  # from the verb `doctor`
                advice = f" ({check['advice']})" if "advice" in check else ""
                mark = "ok" if check["ok"] else "optional" if check.get("optional") else "missing"
                print(f"{mark:>8}  {check['name']}: {check['detail']}{advice}", file=self.out)
            figures = [
                f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}"
                for key, value in message.items()
                if _is_figure(key, value)
            ]
            print(", ".join([str(message.get("outcome", "done")), *figures]), file=self.out, flush=True)

    def _progress(self, message: Message) -> None:
        stage, now = message.get("stage", ""), time.monotonic()
        last = message.get("fraction", 0.0) >= 1.0
        if stage == self.stage and now - self.shown < EVERY and not last:
            return
        self.stage, self.shown = stage, now
        residual = residual_told(message)
        told = f"{message.get('message', '')}{', residual ' * bool(residual)}{residual}"
        print(f"{stage:>10} {100 * message.get('fraction', 0.0):4.0f} %  {told}", file=self.out, flush=True)


class ReportsBesides(Console):
    """Console for an operator. Blender prints its reports, which include failures, so of an error only the log is printed here. Warnings
    use the panel's words, as the reports do."""

    def show(self, message: Message) -> None:
        """Print one message."""
        if message["type"] == "error":
            if message.get("log"):
                print(message["log"], file=self.err, flush=True)
            return
        if message["type"] == "warning":
            message = message | {"message": in_panel_words(str(message.get("message", "")))}
        super().show(message)


def _is_figure(key: str, value: object) -> bool:
    return key not in ("type", "outcome") and isinstance(value, (int, float, str)) and not isinstance(value, bool)
