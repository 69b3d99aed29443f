"""Runs a batch's jobs one after the other on this machine."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable

from ...errors import SeeingWindError
from ...progress import Cancelled
from .jobs import Job
from .summary import Summary


def run_in_order(summary: Summary, do: Callable[[Job, bool], None], say: Callable[[str], None]) -> None:
    """Run all jobs that are not done yet, and write the summary after each of them. A job that fails does not stop the others.

    Args:
        do: runs one job, given whether its takes are made already, and adds a take to `Summary.recovered` once it has a field. It raises
            `SeeingWindError` if the job fails, and `Cancelled` after a cancel, which leaves the remaining jobs for the next run.
        say: receives a line of text per job.
    """
    total = len(summary.jobs)
    for number, job in enumerate(summary.jobs, start=1):
        if summary.is_done(job):
            ended = summary.skip(job)
        else:
            say(f"[{number}/{total}] {job.name}")
            start = time.monotonic()
            outcome, message = _attempt(summary, do, job)
            ended = summary.end(job, outcome, time.monotonic() - start, message)
        say(f"[{number}/{total}] {ended.name}: {ended.outcome}, {ended.seconds:g} s {ended.message}".rstrip())
        if ended.outcome == "cancelled":
            break


def _attempt(summary: Summary, do: Callable[[Job, bool], None], job: Job) -> tuple[str, str]:
    try:
        summary.check_take(job)
        made = summary.takes_done(job)
        if made:
            summary.recovered.add(job.take)
        else:
            job.check_edit_take()
        do(job, made)
    except Cancelled:
        return "cancelled", ""
    except SeeingWindError as error:
        return "failed", str(error)
    except Exception as error:  # a defect in one job must not cost a night's work on the others
        traceback.print_exc()
        return "failed", f"{type(error).__name__}: {error}"
    return "done", ""
