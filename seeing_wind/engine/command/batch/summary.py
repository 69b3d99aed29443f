"""The outcomes of a batch's jobs, kept in JOBS.summary.json beside the jobs' file, so that a finished job is not done twice."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

from ... import systems
from ...errors import SeeingWindError, UsageError
from ...reading import read_json
from .jobs import Job

SUMMARY = ".summary.json"
"""Suffix of the summary's file name; it replaces that of the jobs' file."""


@dataclass
class Outcome:
    """How a job ended."""

    name: str
    outcome: str
    """done, skipped, failed or cancelled; in the file also left, for a job that was not reached."""
    seconds: float = 0.0
    message: str = ""
    takes: str = ""
    """Digest of all that the job's takes are made from; "" until they are made."""
    digest: str = ""
    """Digest of the whole job; "" until it is done."""
    warnings: list[str] = field(default_factory=list)
    """Why the field that the job recovers or uses should not be used."""


class Summary:
    """The jobs of one file and how they ended.

    Args:
        path: the jobs' file.
        whole: whether this process also makes what needs Blender; otherwise a job is done once its takes are made.
        again: treat finished jobs as not done.

    Raises:
        UsageError: the summary's path is taken by something other than a file.
    """

    def __init__(self, path: Path, jobs: list[Job], *, whole: bool, again: bool) -> None:
        self.path = path.with_name(path.stem + SUMMARY)
        if self.path.exists() and not self.path.is_file():
            raise UsageError(f"The summary cannot be written: {self.path} is not a file.", "Move it away, or rename the file of jobs.")
        self.jobs, self.whole, self.again = jobs, whole, again
        self.outcomes: dict[str, Outcome] = {}
        self.recovered: set[Path] = set()
        """Takes whose field a job of this run has recovered, even if the rest of the job failed."""
        self._before = _former(self.path)

    def takes_done(self, job: Job) -> bool:
        """Whether the job's takes exist and were made from exactly the table and files that it has now."""
        return not self.again and self._before.get(job.name, ("", ""))[0] == job.takes_digest() and job.takes_made()

    def is_done(self, job: Job) -> bool:
        """Whether nothing of the job is left to do for this process."""
        if not self.whole:
            return self.takes_done(job)
        return self.takes_done(job) and self._before[job.name][1] == job.digest() and job.files_made()

    def check_take(self, job: Job) -> None:
        """Check that a job does not use a take from an earlier run if the job that makes the take has failed in this run.

        Raises:
            SeeingWindError: it would use such a take.
        """
        if job.source is not None or job.take in self.recovered:
            return
        for other in self.jobs[: self.jobs.index(job)]:
            ended = self.outcomes.get(other.name)
            if other.source is not None and other.take == job.take and ended is not None and ended.outcome == "failed":
                raise SeeingWindError(
                    f'Left out: it needs {job.take}, and "{other.name}", which makes that, failed.',
                    "Mend that job, and run the batch again.",
                )

    def skip(self, job: Job) -> Outcome:
        """Note that a job was done in an earlier run."""
        takes, digest = self._before[job.name]
        message = self._rest(job, "done before, nothing has changed")
        return self._note(Outcome(job.name, "skipped", 0.0, message, takes, digest, _warnings(job)))

    def end(self, job: Job, outcome: str, seconds: float, message: str = "") -> Outcome:
        """Note how a job ended, and write the summary."""
        takes, digest, warnings = "", "", []
        (message,) = job.in_keys(message)
        if outcome == "done":
            warnings = _warnings(job)
            takes, message = job.takes_digest(), self._rest(job, message)
            digest = job.digest() if self.whole or not job.needs_blender else ""
        return self._note(Outcome(job.name, outcome, round(seconds, 1), message, takes, digest, warnings))

    def _rest(self, job: Job, message: str) -> str:
        left = "save and render are left for Blender" if job.needs_blender and not self.whole else ""
        return "; ".join(part for part in (message, left) if part)

    def _note(self, outcome: Outcome) -> Outcome:
        self.outcomes[outcome.name] = outcome
        rows = [self.outcomes.get(job.name) or Outcome(job.name, "left", 0.0, "", *self._before.get(job.name, ())) for job in self.jobs]
        aside = self.path.with_name(self.path.name + ".part")
        aside.write_text(json.dumps({"jobs": [vars(each) for each in rows]}, indent=2) + "\n", encoding="utf-8")
        systems.replace(aside, self.path)
        return outcome

    def count(self, *outcomes: str) -> int:
        """Number of jobs that ended with one of these outcomes."""
        return sum(each.outcome in outcomes for each in self.outcomes.values())

    @property
    def exit_code(self) -> int:
        """130 if a job was cancelled, 1 if one failed, 3 if a field should not be used, otherwise 0."""
        return 130 if self.count("cancelled") else 1 if self.count("failed") else 3 if self.warnings else 0

    @property
    def warnings(self) -> list[str]:
        """Those of all jobs, each after its job's name."""
        return [f"{each.name}: {warning}" for each in self.outcomes.values() for warning in each.warnings]

    def table(self) -> str:
        """The outcomes as a text table, in the order of the jobs' file."""
        rows = [self.outcomes[job.name] for job in self.jobs if job.name in self.outcomes]
        width = max((len(each.name) for each in rows), default=0)
        lines = [f"  {each.name:<{width}}  {each.outcome:<9}  {each.seconds:>8.1f} s  {each.message}".rstrip() for each in rows]
        return "\n".join([*lines, *self.warnings, f"{self.count('done', 'skipped')} of {len(self.jobs)} jobs are done"])


def _warnings(job: Job) -> list[str]:
    """Why the fields that the job recovered, or only uses, should not be used; [] where they can be."""
    from ...record_arrays import TRAJECTORY, useless_notes  # imports NumPy, which Blender should not load when it starts

    # A job recovers several takes where it has a list of objects; it uses one, which came without notes if no recovery made it.
    found = sorted(job.take.rglob(TRAJECTORY)) if job.source is not None else [job.take / TRAJECTORY]
    return [note for made in found if made.is_file() for note in useless_notes(made)]


def _former(summary: Path) -> dict[str, tuple[str, str]]:
    """By name, digests of the takes and of the whole job, for jobs whose takes an earlier run made; empty if the summary cannot be read."""
    try:
        rows = read_json(summary)["jobs"]
        return {row["name"]: (row["takes"], row["digest"]) for row in rows if row["takes"]}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
