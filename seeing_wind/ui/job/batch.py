"""Many clips and edits one after the other: `blender --command seeing_wind batch JOBS.toml`.

Every job is a TOML table; paths count from the file. What is done already is not done again: a take's stages carry stamps of their inputs,
and a job whose results are there with the same text in the file is skipped. A job that fails does not stop the others, whatever it was that
failed.

    [[job]]
    name = "leaf"
    clip = "leaf.mp4"                       # recover this clip ...
    take = "leaf.take"                      # ... into this folder (needed; without `clip` it is there, or a job above makes it)
    recover = { box = [20, 20, 44, 44], distance = 2.0, material = "leaf" }     # options of `recover`, without their dashes
    edit = "edit.toml"                      # then re-simulate this edit ...
    edit_take = "leaf.edit.take"            # ... into this folder; by default beside the take
    save = "leaf.blend"                     # and save a file with field, object and bodies
    render = "leaf_edited.mp4"              # and render it over the clip
"""

from __future__ import annotations

import hashlib
import json
import os
import time
import tomllib
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...engine import systems
from ...engine.errors import SeeingWindError, UsageError

KEYS = {"name", "clip", "take", "recover", "edit", "edit_take", "save", "render"}
PATHS = {"clip", "take", "edit", "edit_take", "save", "render"}
SUMMARY = ".summary.json"
"""Ending of the summary's name, which begins with that of the jobs' file."""
FILES = {"mask", "pin", "camera", "tracks", "depth"}
"""Options of `recover` that are paths."""
EDIT_FILES = ("mesh", "pin", "pin_weights", "free")
"""Keys of an edit's bodies and colliders that are paths."""


@dataclass(frozen=True)
class Job:
    """One row of the file, its paths absolute."""

    name: str
    take: Path
    clip: Path | None = None
    recover: dict[str, Any] = field(default_factory=dict)
    edit: Path | None = None
    edit_take: Path | None = None
    save: Path | None = None
    render: Path | None = None

    def recover_options(self) -> list[str]:
        """The words of `recover` after the verb."""
        words = [str(self.clip), "--take", str(self.take)]
        for key, value in self.recover.items():
            option = f"--{key.replace('_', '-')}"
            if value is False:
                continue
            words.append(option)
            if value is not True:
                words += [str(each) for each in (value if isinstance(value, list) else [value])]
        return words

    def resimulate_options(self) -> list[str]:
        """The words of `resimulate` after the verb."""
        return [str(self.take), "--edit", str(self.edit), "--take", str(self.edit_take)]

    def results(self) -> list[Path]:
        """Files that are there when the job is done."""
        found = [self.take / "field.safetensors", self.save, self.render]
        return [path for path in found if path is not None]

    def outputs(self) -> list[Path]:
        """What no other job may write too. A take may be shared by jobs that recover the same into it."""
        return [path for path in (self.edit_take, self.save, self.render) if path is not None]

    def digest(self) -> str:
        """Of all that the job says, and of the files that it reads."""
        reads = [self.clip, self.edit, *(Path(self.recover[key]) for key in FILES & self.recover.keys()), *_named_in(self.edit)]
        if self.clip is None:
            reads.append(self.take / "field.safetensors")
        if self.clip is not None and _is_sequence(self.clip):
            reads += sorted((self.clip if self.clip.is_dir() else self.clip.parent).iterdir())
        marks = [(str(path), path.stat().st_mtime_ns, path.stat().st_size) for path in reads if path is not None and path.is_file()]
        return hashlib.sha256(json.dumps([repr(self), marks]).encode()).hexdigest()


@dataclass
class Outcome:
    """How a job ended."""

    name: str
    outcome: str
    """done, skipped, failed or cancelled; in the summary also left: not reached yet."""
    seconds: float = 0.0
    message: str = ""
    digest: str = ""


def read_jobs(path: Path) -> list[Job]:
    """The jobs of a file.

    Raises:
        UsageError: no such file, no TOML, no jobs, an unknown key, a missing file, two jobs of one name or with one result.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"The jobs {path} cannot be read: {error.strerror}.", "Give the path of a TOML file.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"The jobs {path} are no TOML: {error}.", "Mend that line.") from error
    tables = values.pop("job", [])
    if values or not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        raise UsageError(f"{path} has no [[job]], or something beside them.", "See docs/batch.md for what belongs in it.")
    jobs = [_job(table, number, path) for number, table in enumerate(tables, start=1)]
    names = [job.name for job in jobs]
    for name in names:
        if names.count(name) > 1:
            raise UsageError(f"Two jobs are named {name}.", "Give each a name of its own.")
    written: dict[Path, str] = {}
    makers: dict[Path, Job] = {}
    for job in jobs:
        if job.clip is not None:
            other = makers.setdefault(job.take, job)
            if (other.clip, other.recover) != (job.clip, job.recover):
                raise UsageError(f"{other.name} and {job.name} recover different things into {job.take}.", "Give one another take.")
        if job.clip is None and job.take not in makers and not (job.take / "field.safetensors").is_file():
            raise UsageError(
                f"{job.name} has neither a clip nor a take with a field.", 'Add clip = "...", or put it under the job that makes the take.'
            )
        for output in job.outputs():
            if written.setdefault(output, job.name) != job.name:
                raise UsageError(f"{written[output]} and {job.name} both write {output}.", "Give one of them another path.")
    return jobs


def _job(table: dict[str, Any], number: int, path: Path) -> Job:
    unknown = sorted(set(table) - KEYS)
    if unknown:
        raise UsageError(f"Job {number} has the unknown key {unknown[0]}.", f"Known are {', '.join(sorted(KEYS))}.")
    name = table.get("name", f"job {number}")
    for key in sorted(set(table) - {"recover"}):
        if not isinstance(table[key], str) or not table[key]:
            raise UsageError(f"{key} of {name} is no text.", "Put it into quotation marks.")
    options = table.get("recover", {})
    if not isinstance(options, dict):
        raise UsageError(f"recover of {name} is no table.", "Write it as { distance = 2.0 }.")
    if "take" not in table:
        raise UsageError(f"{name} has no take.", 'Say with take = "NAME.take" where the results go.')
    home = path.resolve().parent
    paths = {key: home / os.path.expanduser(table[key]) for key in PATHS & table.keys()}
    for key in ("clip", "edit"):
        if key in paths and not paths[key].is_file() and not (key == "clip" and _is_sequence(paths[key])):
            raise UsageError(f"{key} of {name}: there is no file {paths[key]}.", "Correct the path; it counts from the jobs' file.")
    if "edit" in paths:
        paths.setdefault("edit_take", paths["take"].with_name(f"{paths['take'].name.removesuffix('.take')}.edit.take"))
    options = {key: str(home / value) if key in FILES and isinstance(value, str) else value for key, value in options.items()}
    return Job(name=name, recover=options, **paths)


def _is_sequence(clip: Path) -> bool:
    """Whether it is a folder or a pattern of pictures; what is in it is the engine's to say."""
    return clip.is_dir() or (clip.parent.is_dir() and ("*" in clip.name or "%" in clip.name))


def _named_in(edit: Path | None) -> list[Path]:
    """Meshes and lists of vertices that an edit names; of an edit that cannot be read the engine speaks when its turn comes."""
    try:
        tables = tomllib.loads(edit.read_text(encoding="utf-8")) if edit is not None else {}
    except (OSError, ValueError):
        return []
    rows = [row for key in ("body", "collider") for row in tables.get(key, ()) if isinstance(row, dict)]
    return [edit.parent / row[key] for row in rows for key in EDIT_FILES if isinstance(row.get(key), str)]


def run(path: Path, do: Callable[[Job], int], say: Callable[[str], None], again: bool = False) -> int:
    """Do all jobs of a file and write the summary beside it, after every job.

    Args:
        do: does one job and returns its exit code as the worker has them: 0 done, 130 cancelled, else failed.
        say: told a line per job.
        again: do those that are done, too.

    Returns:
        0 when all are done, 130 after a cancel (the rest is left), else 1.

    Raises:
        UsageError: as `read_jobs` does, before anything is done.
    """
    jobs = read_jobs(path)
    summary = path.with_name(path.stem + SUMMARY)
    before = _former(summary)
    outcomes: list[Outcome] = []
    for number, job in enumerate(jobs, start=1):
        digest, start = job.digest(), time.monotonic()
        if not again and before.get(job.name) == digest and all(each.exists() for each in job.results()):
            outcomes.append(Outcome(job.name, "skipped", 0.0, "done before, nothing has changed", digest))
        else:
            say(f"[{number}/{len(jobs)}] {job.name}")
            code, message = 1, ""
            try:
                code = do(job)
            except SeeingWindError as error:
                code, message = error.exit_code, str(error)
            except Exception as error:  # a defect in one job shall not cost a night's work on the others
                traceback.print_exc()
                message = f"{type(error).__name__}: {error}"
            ended = "done" if code == 0 else "cancelled" if code == 130 else "failed"
            seconds = round(time.monotonic() - start, 1)
            outcomes.append(Outcome(job.name, ended, seconds, message or ("" if code == 0 else f"exit code {code}"), digest * (code == 0)))
        last = outcomes[-1]
        say(f"[{number}/{len(jobs)}] {last.name}: {last.outcome}, {last.seconds:g} s {last.message}".rstrip())
        _write(summary, [*outcomes, *(Outcome(each.name, "left", digest=before.get(each.name, "")) for each in jobs[number:])])
        if last.outcome == "cancelled":
            break
    say(table(outcomes, len(jobs)))
    if any(each.outcome == "cancelled" for each in outcomes):
        return 130
    return 1 if any(each.outcome == "failed" for each in outcomes) else 0


def table(outcomes: list[Outcome], jobs: int) -> str:
    """The summary as text."""
    width = max(len(each.name) for each in outcomes)
    lines = [f"  {each.name:<{width}}  {each.outcome:<9}  {each.seconds:>8.1f} s  {each.message}".rstrip() for each in outcomes]
    good = sum(each.outcome in ("done", "skipped") for each in outcomes)
    return "\n".join([*lines, f"{good} of {jobs} jobs are done"])


def _former(summary: Path) -> dict[str, str]:
    """Digests of the jobs that a former run finished; a summary that cannot be read counts as none."""
    try:
        rows = json.loads(summary.read_text(encoding="utf-8"))["jobs"]
        return {row["name"]: row["digest"] for row in rows if row["digest"]}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _write(summary: Path, outcomes: list[Outcome]) -> None:
    aside = summary.with_name(summary.name + ".part")
    aside.write_text(json.dumps({"jobs": [vars(each) for each in outcomes]}, indent=2) + "\n", encoding="utf-8")
    systems.replace(aside, summary)
