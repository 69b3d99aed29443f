"""What became of a batch's jobs: JOBS.summary.json beside the file, by which a finished job is not done twice."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ... import systems
from ...errors import SeeingWindError, UsageError
from ...reading import read_json
from .jobs import Job

SUMMARY = ".summary.json"
"""Ending of the summary's name, which begins with that of the jobs' file."""


@dataclass
class Outcome:
    """How a job ended."""

    name: str
    outcome: str
    """done, skipped, failed or cancelled; in the summary also left: not reached yet."""
    seconds: float = 0.0
    message: str = ""
    takes: str = ""
    """Digest of the job's takes, "" while they are not made."""
    digest: str = ""
    """Digest of the whole job, "" while it is not done."""


class Summary:
    """The jobs of one file and how they ended.

    Args:
        path: of the jobs' file.
        whole: whether this process also makes what needs Blender; else a job is done with its takes.
        again: whether what is done counts as not done.

    Raises:
        UsageError: where the summary is to be, there is a folder.
    """

    def __init__(self, path: Path, jobs: list[Job], *, whole: bool, again: bool) -> None:
        self.path = path.with_name(path.stem + SUMMARY)
        if self.path.exists() and not self.path.is_file():
            raise UsageError(f"The summary's place {self.path} is taken by what is no file.", "Move it away, or rename the file of jobs.")
        self.jobs, self.whole, self.again = jobs, whole, again
        self.outcomes: dict[str, Outcome] = {}
        self.recovered: set[Path] = set()
        """Takes that a job of this run has recovered, whatever became of the rest of it."""
        self._before = _former(self.path)

    def takes_done(self, job: Job) -> bool:
        """Whether its takes were made from exactly what it says and reads now."""
        return not self.again and self._before.get(job.name, ("", ""))[0] == job.takes_digest() and job.takes_made()

    def is_done(self, job: Job) -> bool:
        """Whether nothing of it is left for this process."""
        if not self.whole:
            return self.takes_done(job)
        return self.takes_done(job) and self._before[job.name][1] == job.digest() and job.files_made()

    def check_take(self, job: Job) -> None:
        """See that a job does not go on from what an earlier run left in a take, where the job that makes it has failed in this one.

        Raises:
            SeeingWindError: it would.
        """
        if job.source is not None or job.take in self.recovered:
            return
        for other in self.jobs[: self.jobs.index(job)]:
            ended = self.outcomes.get(other.name)
            if other.source is not None and other.take == job.take and ended is not None and ended.outcome == "failed":
                raise SeeingWindError(
                    f"Left out: it needs {job.take}, and {other.name}, which makes that, failed.", "Mend that job, and run the batch again."
                )

    def skip(self, job: Job) -> Outcome:
        """Note a job that was done before."""
        takes, digest = self._before[job.name]
        return self._note(Outcome(job.name, "skipped", 0.0, self._rest(job, "done before, nothing has changed"), takes, digest))

    def end(self, job: Job, outcome: str, seconds: float, message: str = "") -> Outcome:
        """Note how a job ended, and write the summary."""
        takes = digest = ""
        if outcome == "done":
            takes, message = job.takes_digest(), self._rest(job, message)
            digest = job.digest() if self.whole or not job.needs_blender else ""
        return self._note(Outcome(job.name, outcome, round(seconds, 1), message, takes, digest))

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
        """How many jobs ended so."""
        return sum(each.outcome in outcomes for each in self.outcomes.values())

    @property
    def exit_code(self) -> int:
        """130 after a cancel, 1 when a job failed, else 0."""
        return 130 if self.count("cancelled") else 1 if self.count("failed") else 0

    def table(self) -> str:
        """The outcomes as text, in the file's order."""
        rows = [self.outcomes[job.name] for job in self.jobs if job.name in self.outcomes]
        width = max((len(each.name) for each in rows), default=0)
        lines = [f"  {each.name:<{width}}  {each.outcome:<9}  {each.seconds:>8.1f} s  {each.message}".rstrip() for each in rows]
        return "\n".join([*lines, f"{self.count('done', 'skipped')} of {len(self.jobs)} jobs are done"])


def _former(summary: Path) -> dict[str, tuple[str, str]]:
    """Digests of the takes and of the whole job, of those that a former run finished; a summary that cannot be read counts as none."""
    try:
        rows = read_json(summary)["jobs"]
        return {row["name"]: (row["takes"], row["digest"]) for row in rows if row["takes"]}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
