"""`batch JOBS.toml`: runs the jobs of a file here or on a Ray cluster, or writes them as a bundle for another farm."""

from __future__ import annotations

import argparse
import re
from functools import partial
from pathlib import Path
from typing import Any

from ...errors import SeeingWindError, UsageError
from ...progress import Cancelled, Progress
from .in_order import run_in_order
from .jobs import Job, read_jobs
from .process import messages_of
from .summary import Summary


def batch(arguments: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """`batch JOBS.toml [--again] [--ray ADDRESS [--shared] [--attempts N] | --openjd FOLDER | --check]`.

    Raises:
        UsageError: as `read_jobs`; or options do not go together.
        UsageError, ClipError, ObjectError, MaterialError, WrongTake: what a job names cannot be used; no job was started.
        SeeingWindError: a job failed; the others were still run.
        Cancelled: the batch was cancelled.
    """
    path = Path(arguments.jobs)
    jobs = read_jobs(path)
    if arguments.ray is None and (arguments.shared or arguments.attempts is not None):
        raise UsageError("--shared and --attempts belong to --ray.", "Add --ray auto, or leave them out.")
    if arguments.ray not in (None, "auto") and not re.fullmatch(r".+:\d{1,5}", arguments.ray):
        raise UsageError(f"--ray {arguments.ray} is not an address.", "Give HOST:PORT of the cluster's head, or auto.")
    summary = Summary(path, jobs, whole=False, again=arguments.again)
    made: list[Path] = []
    for number, job in enumerate(jobs):
        if arguments.openjd is not None or not summary.is_done(job):
            progress.stage = "batch"
            progress.update(0.0, f"checking {job.name}, job {number + 1} of {len(jobs)}")
            # otherwise the job tells its warnings itself
            _check(job, made, progress.worded(partial(_of_job, job)) if arguments.check else progress.quiet())
        made += job.takes()
    if arguments.check:
        return {"outcome": "converged", "checked": len(jobs)}
    if arguments.openjd is not None:
        from .openjd import write_bundle

        return {"outcome": "converged", **write_bundle(jobs, path, Path(arguments.openjd), progress)}
    if arguments.ray is None:

        def say(line: str) -> None:
            progress.stage = "batch"
            progress.update(len(summary.outcomes) / len(jobs), line)

        run_in_order(summary, lambda job, made: _do(summary, job, made, progress), say)
    else:
        from .farm import ATTEMPTS, Farm
        from .ray_cluster import Cluster

        with Cluster(arguments.ray) as cluster:
            Farm(cluster, summary, progress, shared=arguments.shared, attempts=arguments.attempts or ATTEMPTS).run()
    return _result(summary)


def _of_job(job: Job, warning: str) -> str:
    return f"{job.name}: {job.in_keys(warning)[0]}"


def _check(job: Job, made: list[Path], progress: Progress) -> None:
    """Refuse, before any job starts, what the job's verbs would refuse before their work.

    Args:
        made: takes that the jobs before this one make; files in them are checked when the job runs.
    """
    from ..arguments import parser
    from ..recover import check_recover
    from ..resimulate import check_resimulation
    from ..trajectories.verb import check_trajectories

    call: list[str] = []
    try:
        for call in job.calls():
            arguments = parser().parse_args(call)
            for key, file in job.named_files():
                if any(take in (file, *file.parents) for take in made):
                    setattr(arguments, key, [] if key == "view" else None)
            if arguments.verb == "recover":
                check_recover(arguments, progress)
            elif arguments.verb == "recover-trajectories":
                check_trajectories(arguments, progress)
            else:
                check_resimulation(arguments, progress, [*made, *job.takes()])
    except SeeingWindError as error:
        hint = f"See docs/reference/cli.md for the options of `{call[0]}`." if "--help" in error.hint else error.hint
        message, hint = job.in_keys(error.message, hint)
        raise type(error)(f'"{job.name}": {message}', hint) from error


def _do(summary: Summary, job: Job, made: bool, progress: Progress) -> None:
    """Run one job on this machine: each of its verbs in a process of its own, with its messages passed on.

    `made`: its takes are made already, so there is nothing to run.
    """
    for call in [] if made else job.calls():
        for messages in messages_of(call):
            progress.check()
            for message in messages:
                if message["type"] == "progress":
                    progress.stage = message["stage"]
                    progress.update(message["fraction"], f"{job.name}: {message['message']}")
                elif message["type"] == "warning":
                    progress.warn(f"{job.name}: {message['message']}")
        summary.recovered.add(job.take)


def _result(summary: Summary) -> dict[str, Any]:
    if summary.count("cancelled"):
        raise Cancelled
    failed = [each for each in summary.outcomes.values() if each.outcome == "failed"]
    if failed:
        told = "; ".join(f'"{each.name}": {each.message}' for each in failed)
        raise SeeingWindError(f"{len(failed)} of {len(summary.jobs)} jobs failed. {told}", f"All outcomes are in {summary.path}.")
    jobs = [{"name": each.name, "outcome": each.outcome, "seconds": each.seconds} for each in summary.outcomes.values()]
    return {"outcome": "converged", "summary": str(summary.path), "jobs": jobs, "warnings": summary.warnings}
