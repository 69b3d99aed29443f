"""The end of a recovery: drawing the report, and the result that the verb sends. Whatever fails here, the field is already in the take.

Other verbs repeat from here what the recovery's notes say against the field, and count frames as the options do.
"""

from __future__ import annotations

import argparse
import contextlib
import traceback
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from ..conventions import as_in_file
from ..errors import SeeingWindError, WrongTake
from ..progress import Cancelled, Journal, Progress
from ..record_arrays import TRAJECTORY, is_draft, useless_notes
from ..records import Outcome, Recovery
from ..take import VERSION, Take, stamp_of

Result = dict[str, Any]
Draw = Callable[[Journal], dict[str, Any]]


def report_result(take: Take, recovery: Recovery, level: str, clip: str, draw: Draw, progress: Progress) -> Result:
    """Draw the report of a recovery whose field is in the take, and return the verb's result.

    A useless field, and parts of the report that could not be made, are warnings in the result; they do not fail the job.

    Args:
        level: how much of the report is drawn, see `look.report.write_report`.
        clip: path that the report names; "" for trajectories.
        draw: draws the report, keeping finished parts in the journal, and returns the content of report.json.
    """
    from ..conventions import distrusted

    try:
        report = _report_stage(take, level, clip, draw, progress)
        missing = report.get("report", {}).get("missing", {})
        warnings = distrusted(recovery.notes) + [f"{product}: {reason}" for product, reason in missing.items()]
        return _summary(report, take) | {"warnings": warnings}
    except Cancelled:
        raise
    except Exception as error:  # such as a codec, a full disk, or an unknown version of OpenCV or Matplotlib
        if not isinstance(error, (SeeingWindError, OSError)):
            traceback.print_exc()
        warning = f"The report could not be made, the field is there: {error}"
        progress.warn(warning)
        found = {"outcome": recovery.outcome.value, "iterations": recovery.iterations, "notes": recovery.notes}
        return _summary(found, take) | {"warnings": [*distrusted(recovery.notes), warning]}


@contextlib.contextmanager
def counting_in_file(arguments: argparse.Namespace, progress: Progress) -> Iterator[Progress]:
    """A `Progress` for a verb on a clip whose warnings count frames as --frames does; so do the errors that leave the context."""
    words = partial(as_in_file, first_frame=arguments.frames[0] if arguments.frames is not None else 0)
    try:
        yield progress.worded(words)
    except SeeingWindError as error:
        error.message, error.hint = words(error.message), words(error.hint)
        raise


def warn_of_field(take: Take, progress: Progress) -> None:
    """Repeat that a take's recovery calls its field useless, or a draft. A field that no recovery has made has no notes."""
    trajectory = take.file(TRAJECTORY)
    if trajectory.is_file():
        for note in useless_notes(trajectory):
            progress.warn(note)
        with contextlib.suppress(WrongTake):  # which the notes above have told
            if is_draft(trajectory):
                progress.warn(f"The field of {take.path} is a draft, from one iteration: what is made from it is as rough.")


def _summary(report: dict[str, Any], take: Take) -> Result:
    keys = ("outcome", "iterations", "residual", "residual_unit", "seconds", "notes", "wind")
    return {"take": str(take.path), **{("stage_seconds" if key == "seconds" else key): report[key] for key in keys if key in report}}


def diverged_result(recovery: Recovery) -> Result:
    """The result of a recovery that diverged and so has no field."""
    return {"outcome": Outcome.DIVERGED.value, "iterations": recovery.iterations, "notes": recovery.notes}


def _report_stage(take: Take, level: str, clip: str, draw: Draw, progress: Progress) -> dict[str, Any]:
    """Stage *report* for the recovery in the take: what `draw` returns, or the `report.json` of an earlier run.

    A report with missing products gets no stamp, so it is drawn again in the next run of the job.
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
    """Files that a report must have: if one is missing, the report is drawn again, whatever its stamp is."""
    if level == "none":
        return []
    return ["report.json", "report.png"] + ["overlay.mp4"] * bool(clip) + ["resimulated.mp4"] * (bool(clip) and level == "full")
