"""The end of a recovery: the report drawn, and the result that the verb sends. The field is in the take by then, whatever happens here."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from ..errors import SeeingWindError
from ..progress import Cancelled, Journal, Progress
from ..records import Outcome, Recovery
from ..take import VERSION, Take, stamp_of

Result = dict[str, Any]
Draw = Callable[[Journal], dict[str, Any]]


def report_result(take: Take, recovery: Recovery, level: str, clip: str, draw: Draw, progress: Progress) -> Result:
    """The result of a recovery whose field is in the take. That the field is of no use, and what of the report could not be made, are
    warnings in it: they fail no job.

    Args:
        level: how much of it is drawn, see `look.report.write_report`.
        clip: path that the report names; "" for trajectories.
        draw: draws it, keeping in the journal what is made, and returns what report.json holds.
    """
    from ..recovery.diagnostics.remarks import distrusted

    try:
        report = _report_stage(take, level, clip, draw, progress)
        missing = report.get("report", {}).get("missing", {})
        warnings = distrusted(recovery.notes) + [f"{product}: {reason}" for product, reason in missing.items()]
        return _summary(report, take) | {"warnings": warnings}
    except Cancelled:
        raise
    except Exception as error:  # a codec, a full disk, an OpenCV or a Matplotlib that is unlike those we know
        if not isinstance(error, (SeeingWindError, OSError)):
            traceback.print_exc()
        warning = f"The report could not be made, the field is there: {error}"
        progress.warn(warning)
        found = {"outcome": recovery.outcome.value, "iterations": recovery.iterations, "notes": recovery.notes}
        return _summary(found, take) | {"warnings": [*distrusted(recovery.notes), warning]}


def _summary(report: dict[str, Any], take: Take) -> Result:
    keys = ("outcome", "iterations", "residual", "residual_unit", "seconds", "notes", "wind")
    return {"take": str(take.path), **{("stage_seconds" if key == "seconds" else key): report[key] for key in keys if key in report}}


def diverged_result(recovery: Recovery) -> Result:
    """The result of a recovery that has no field."""
    return {"outcome": Outcome.DIVERGED.value, "iterations": recovery.iterations, "notes": recovery.notes}


def _report_stage(take: Take, level: str, clip: str, draw: Draw, progress: Progress) -> dict[str, Any]:
    """Stage *report* of the recovery that the take holds: what `draw` returns, or what it has left in `report.json`.

    A report that lacks a product gets no stamp, so that it is drawn again when the job is.
    """
    from ..recovery.journal import TakeJournal

    stages = take.description().get("stages", {})
    recovered, wind = (stages.get(stage, {}).get("stamp", "") for stage in ("recover", "wind"))
    stamp = stamp_of("report", VERSION, recovered, level, clip, *([wind] if wind else []))
    if all(take.file(name).is_file() for name in _products(level, clip)):
        kept = take.kept("report", stamp, lambda: take.read_json("report.json"), progress)
        if kept is not None:
            return kept
    progress.begin("report", "drawing the report")
    take.withdraw("report")
    with TakeJournal(take, stamp, progress) as journal:
        report = draw(journal)
        if level != "none" and not report["report"]["missing"]:
            take.finish("report", stamp, {"level": level})
    progress.update(1.0, "done")
    return report


def _products(level: str, clip: str) -> list[str]:
    """Files without which a report is drawn again, whatever its stamp says."""
    if level == "none":
        return []
    return ["report.json", "report.png"] + ["overlay.mp4"] * bool(clip) + ["resimulated.mp4"] * (bool(clip) and level == "full")
