"""A batch's file: JOBS.toml.

Every job is a TOML table; paths are relative to the file.

    [[job]]
    name = "leaf"
    clip = "leaf.mp4"                       # recover this clip (or `trajectories = "leaf.npz"`) ...
    take = "leaf.take"                      # ... into this folder (needed; without a clip it is there, or a job above makes it)
    recover = { box = [20, 20, 44, 44], distance = 2.0, material = "leaf" }     # options of the verb, without their dashes
    edit = "edit.toml"                      # then re-simulate this edit ...
    edit_take = "leaf.edit.take"            # ... into this folder; by default beside the take
    save = "leaf.blend"                     # and save a file with field, object and bodies
    render = "leaf_edited.mp4"              # and render it over the clip
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...conventions import image_files, in_the_way
from ...errors import NO_PATH, MaterialError, TakeError, UsageError
from ...materials import DEFAULT, find
from ...settings import ObserveSettings, RecoverSettings, options_of
from ...settings.mapping import shown
from ...settings.observe import NO_NETWORK
from ...settings.tables import names_in, read_users_toml, tables_of
from .words import check_kinds, in_keys, views_of, words_of

SOURCES = ("clip", "trajectories")
FILES = {"objects", *(one.name for one in options_of(ObserveSettings).values() if one.file)}
"""Options of `recover` that are paths of files."""
FOLDERS = {one.name for one in options_of(RecoverSettings).values() if one.folder}
"""Options of `recover` that are paths of folders."""
NETWORKS = {name for name in options_of(ObserveSettings) if name.endswith("_model")}
"""Options of `recover` that name a network, which may be a folder."""
NO_FILE = {"outline_model": NO_NETWORK}
"""Words that stand in the place of a file."""
SWITCHES = {"no_gravity"}
"""Options of `recover` that take no value."""
FIELD = "field.safetensors"
VIDEO, SCENE = ".mp4", ".blend"
"""Suffixes of the videos that Blender renders, H.264 in MP4 (`ui.composite.own.set_output`), and of the files that it saves."""


@dataclass(frozen=True)
class Job:
    """One table of the file, with absolute paths."""

    name: str
    take: Path
    clip: Path | None = None
    trajectories: Path | None = None
    recover: dict[str, Any] = field(default_factory=dict)
    edit: Path | None = None
    edit_take: Path | None = None
    save: Path | None = None
    render: Path | None = None

    @property
    def source(self) -> Path | None:
        """The clip or trajectories to recover; None if the take exists already or another job makes it."""
        return self.clip or self.trajectories

    @property
    def needs_blender(self) -> bool:
        """Whether the job saves or renders, which only Blender can do."""
        return self.save is not None or self.render is not None

    def calls(self) -> list[list[str]]:
        """The engine's verbs with their options, in order."""
        calls = []
        if self.source is not None:
            verb = "recover" if self.clip is not None else "recover-trajectories"
            calls.append([verb, str(self.source), "--take", str(self.take), *words_of(self.recover)])
        if self.edit is not None:
            calls.append(["resimulate", str(self.take), "--edit", str(self.edit), "--take", str(self.edit_take)])
        return calls

    def takes(self) -> list[Path]:
        """The folders that the job's verbs write to."""
        return [self.take] * (self.source is not None) + ([self.edit_take] if self.edit_take is not None else [])

    def reads(self) -> list[Path]:
        """The files that the job reads, as far as they exist."""
        found = [self.source, self.edit, *(file for _, file in self.named_files())]
        found += [self.edit.parent / name for name in names_in(self.edit)] if self.edit is not None else []
        found += [file for key, place in self.named_files() if key in NETWORKS and place.is_dir() for file in sorted(place.rglob("*"))]
        for clip in (self.clip, *(Path(view[0]) for view in self.recover.get("view", ()))):
            if clip is not None and _is_sequence(clip):
                found += sorted((clip if clip.is_dir() else clip.parent).iterdir())
        return [path for path in found if path is not None and path.is_file()]

    def named_files(self) -> list[tuple[str, Path]]:
        """The files and folders that the options of `recover` name, each as (option, path)."""
        named = [(key, Path(value)) for key, value in sorted(self.recover.items()) if _is_path(key, value)]
        return named + [("view", Path(word)) for view in self.recover.get("view", ()) for word in view]

    def takes_made(self) -> bool:
        """Whether the job's takes exist, and the re-simulation is that of the job's own edit."""
        simulated = self.edit_take is None or (self.edit_take / "resimulation.json").is_file()
        return simulated and (self.take / FIELD).is_file() and self._other_edit() is None

    def files_made(self) -> bool:
        """Whether the files that Blender makes of the takes exist."""
        return all(path.exists() for path in (self.save, self.render) if path is not None)

    def takes_digest(self) -> str:
        """Digest of all that the job's takes are made from: its table, and the files that the table names."""
        reads = self.reads() + [self.take / FIELD] * (self.source is None)
        marks = [(str(path), path.stat().st_mtime_ns, path.stat().st_size) for path in reads if path.is_file()]
        said = dataclasses.replace(self, save=None, render=None)
        return hashlib.sha256(json.dumps([repr(said), marks]).encode()).hexdigest()

    def digest(self) -> str:
        """Digest of the job's whole table and all files that it reads."""
        return hashlib.sha256(json.dumps([self.takes_digest(), str(self.save), str(self.render)]).encode()).hexdigest()

    def in_keys(self, *texts: str) -> list[str]:
        """An error's texts from one of the job's verbs, with the keys of the job's table in place of the flags of a command line."""
        return in_keys(texts, set(self.recover), self.edit_take)

    def check_edit_take(self) -> None:
        """Check that the re-simulation's folder is not that of another edit, such as one made in Blender's panel.

        Raises:
            TakeError: it is, or it cannot be read.
        """
        other = self._other_edit()
        if other is not None and self.edit is not None:
            raise TakeError(
                f"{self.edit_take} holds the re-simulation of another edit, {other}.",
                f'Give "{self.name}" an edit_take of its own, such as "{self.take.stem}.{self.edit.stem}.take", or remove that folder.',
            )

    def _other_edit(self) -> str | None:
        from ...take import Take  # imports NumPy, which Blender should not load when it starts

        if self.edit is None or self.edit_take is None:
            return None
        stages = Take(self.edit_take).description().get("stages", {})
        of = stages.get("resimulate", {}).get("settings", {}).get("edit")
        return None if of is None or Path(of).resolve() == self.edit.resolve() else str(of)


def read_jobs(path: Path) -> list[Job]:
    """The jobs of a file.

    Raises:
        UsageError: the file does not exist, is not TOML or has no jobs; an unknown key or material, a missing file, a suffix that cannot
            be rendered or saved, a result where none can be written, or two jobs with the same name or result.
    """
    values, hint = read_users_toml(path, "The file of jobs"), "See docs/guide/batch-and-farm.md for what belongs in it."
    tables = tables_of(values, "job", f"The file of jobs {path}", hint)
    if values:
        raise UsageError(f"{path} has {', '.join(values)} beside its [[job]].", hint)
    jobs = [_job(table, number, path) for number, table in enumerate(tables, start=1)]
    _check_together(jobs)
    return jobs


def _check_together(jobs: list[Job]) -> None:
    """Raises UsageError for jobs that overwrite each other's results, and for a job whose take neither has a field nor gets one."""
    names = [job.name for job in jobs]
    written: dict[Path, str] = {}
    takes = {job.take: job.name for job in jobs}
    makers: dict[Path, Job] = {}
    made: list[Path] = []
    # The takes of a list of objects lie in that job's folder, which is no take.
    wholes = [take for job in jobs if "objects" not in job.recover for take in job.takes()]
    for job in jobs:
        for key, file in job.named_files():
            if not _is_there(key, file) and not any(take in (file, *file.parents) for take in made):
                raise UsageError(f'{key} of "{job.name}": there is no {"folder" if key in FOLDERS else "file"} {file}.', RELATIVE)
        made += job.takes()
        if names.count(job.name) > 1:
            raise UsageError(f'Two jobs are named "{job.name}".', "Give each a name of its own.")
        if job.source is not None:
            other = makers.setdefault(job.take, job)
            if (other.source, other.recover) != (job.source, job.recover):
                raise UsageError(f'"{other.name}" and "{job.name}" recover different things into {job.take}.', "Give one another take.")
        elif job.take not in makers and not (job.take / FIELD).is_file():
            raise UsageError(
                f'"{job.name}" has neither a clip nor a take with a field.',
                'Add clip = "...", or put it under the job that makes the take.',
            )
        for kept in filter(None, (job.save, job.render)):
            reader = next((other.name for other in jobs if kept in other.reads()), None)
            if reader is not None:
                raise UsageError(f'"{job.name}" would write {kept}, which "{reader}" reads.', "Give it another path.")
        if job.edit_take in takes:
            said = f'The edit_take of "{job.name}" is the take of "{takes[job.edit_take]}", {job.edit_take}.'
            raise UsageError(said, "Give one of them another path.")
        for take in job.takes():
            around = next((whole for whole in wholes if whole in take.parents), None)
            if around is not None:
                raise UsageError(f'"{job.name}" writes {take}, which is inside the take {around}.', "Give it a path beside that.")
        for output in (job.edit_take, job.save, job.render):
            if output is not None and written.setdefault(output, job.name) != job.name:
                raise UsageError(f'"{written[output]}" and "{job.name}" both write {output}.', "Give one of them another path.")


RELATIVE = "Correct the path; it is relative to the file of jobs."
KEYS = {each.name for each in dataclasses.fields(Job)}
PATHS = KEYS - {"name", "recover"}


def _job(table: dict[str, Any], number: int, path: Path) -> Job:
    unknown = sorted(set(table) - KEYS)
    if unknown:
        raise UsageError(f"Job {number} has the unknown key {unknown[0]}.", f"Known are {', '.join(sorted(KEYS))}.")
    name = f'"{table.get("name", f"job {number}")}"'
    for key in sorted(set(table) - {"recover"}):
        if not isinstance(table[key], str) or not table[key].strip():
            hint = "Write something in it, or leave it out." if isinstance(table[key], str) else "Write a text in quotation marks."
            raise UsageError(f"{key} of job {number} is {shown(table[key])}.", hint)
    options = table.get("recover", {})
    if not isinstance(options, dict):
        raise UsageError(f"recover of {name} is {shown(options)}, not a table.", "Write it as { distance = 2.0 }.")
    if "take" in options:
        raise UsageError(f"recover of {name} names a take.", "Write take beside recover, not in it.")
    for key in SWITCHES & options.keys():
        if not isinstance(options[key], bool):
            raise UsageError(f"{key} in recover of {name} is {shown(options[key])}.", "Write true or false, without quotes.")
    if "take" not in table:
        raise UsageError(f"{name} has no take.", 'Say with take = "NAME.take" where the results go.')
    if set(SOURCES) <= table.keys():
        raise UsageError(f"{name} has a clip and trajectories.", "Leave one out, or make two jobs of it.")
    if "recover" in table and not set(SOURCES) & table.keys():
        raise UsageError(f"{name} has a table recover, but nothing to recover.", "Add a clip or trajectories, or leave recover out.")
    if not {*SOURCES, "edit", "save", "render"} & table.keys():
        hint = "Add a clip or trajectories to recover, an edit to re-simulate, or a file to save or render."
        raise UsageError(f"{name} has nothing to do.", hint)
    if "trajectories" in table and "render" in table:
        raise UsageError(f"{name} has trajectories and a render, which goes over a clip.", "Save a .blend file and render that.")
    home = path.resolve().parent
    paths = {key: Path(_beside(home, table[key])) for key in PATHS & table.keys()}
    for key in (*SOURCES, "edit"):
        if key in paths and not paths[key].is_file() and not (key == "clip" and _is_sequence(paths[key])):
            raise UsageError(f"{key} of {name}: there is no file {paths[key]}.", RELATIVE)
    if "clip" in paths and _is_sequence(paths["clip"]) and not paths["clip"].is_file() and not image_files(str(paths["clip"])):
        raise UsageError(f"clip of {name}: there are no images {paths['clip']}.", RELATIVE)
    _check_places(paths, name)
    if "render" in paths and paths["render"].suffix.lower() != VIDEO:
        raise UsageError(f"render of {name}: {paths['render'].name} cannot be written.", f"Blender renders a video: let it end in {VIDEO}.")
    if "save" in paths and paths["save"].suffix != SCENE:
        raise UsageError(f"save of {name}: {paths['save'].name} cannot be saved.", f"Blender saves its own files: let it end in {SCENE}.")
    if isinstance(options.get("material"), str):
        try:
            find(options["material"])
        except MaterialError as error:
            raise UsageError(f"material of {name}: {error.message}", error.hint) from error
    if "edit" in paths:
        paths.setdefault("edit_take", paths["take"].with_name(f"{paths['take'].name.removesuffix('.take')}.edit.take"))
    for key in sorted((FILES | FOLDERS | NETWORKS | {"material"}) & options.keys()):
        if options[key] is not False and not (isinstance(options[key], str) and options[key].strip()):
            raise UsageError(f"{key} in recover of {name} is {shown(options[key])}.", f"Write the {_named_by(key)} in quotation marks.")
    check_kinds(options, name)
    options = {key: NO_FILE[key] if value is False and key in NO_FILE else value for key, value in options.items()}
    beside = {key: _beside(home, value) for key, value in options.items() if isinstance(value, str)}
    folders = {key for key in NETWORKS & beside.keys() if os.path.isdir(beside[key])}  # else it is the name of one that is known
    options = {key: beside[key] if key in folders or _is_path(key, value) else value for key, value in options.items()}
    if "view" in options:
        options["view"] = [[_beside(home, word) for word in view] for view in views_of(options["view"], name)]
    return Job(name=table.get("name", f"job {number}"), recover=options, **paths)


def _named_by(key: str) -> str:
    """What the text of the option `key` is, as a part of a sentence."""
    if key in FILES | FOLDERS:
        return f"path of one {'folder' if key in FOLDERS else 'file'}" + (f', or "{NO_FILE[key]}",' if key in NO_FILE else "")
    return "name of one network" if key in NETWORKS else f'name of one material, such as "{DEFAULT}",'


def _is_path(key: str, value: Any) -> bool:
    """Whether the option `key` of `recover` names a file or a folder by its `value`; a network's folder has an absolute path by then."""
    named = key in FILES | FOLDERS or (key in NETWORKS and os.path.isabs(str(value)))
    return named and isinstance(value, str) and value != NO_FILE.get(key)


def _check_places(paths: dict[str, Path], name: str) -> None:
    """Raises UsageError if a result of the job `name` cannot be written at its path because of what is there already."""
    for key in ("take", "edit_take", "save", "render"):
        if key not in paths:
            continue
        file = key in ("save", "render")
        other = in_the_way(paths[key].parent if file else paths[key])
        if other is not None:
            raise UsageError(f"{key} of {name}, {paths[key]}, cannot be written: {other} is not a folder.", "Give it another path.")
        if file and os.path.isdir(paths[key]):
            raise UsageError(f"{key} of {name}, {paths[key]}, is a folder.", "Give it the path of a file.")
        try:
            os.stat(paths[key])
        except OSError as error:
            if error.errno in NO_PATH:  # too long a name, or links in a circle
                raise UsageError(f"{key} of {name} cannot be written: {error.strerror}.", "Give it another path.") from error


def _beside(home: Path, path: str) -> str:
    """A path from the jobs' file, which lies in the folder `home`, as an absolute path."""
    return os.path.abspath(home / os.path.expanduser(path))


def _is_there(key: str, path: Path) -> bool:
    """Whether what the option `key` names exists: a file, a folder, or the images of a further view."""
    if key in FOLDERS:
        return path.is_dir()
    return path.is_file() or (key in NETWORKS and path.is_dir()) or (key == "view" and _is_sequence(path) and bool(image_files(str(path))))


def _is_sequence(clip: Path) -> bool:
    """Whether a clip is a folder or a pattern of images; the engine checks their content."""
    return clip.is_dir() or (clip.parent.is_dir() and ("*" in clip.name or "%" in clip.name))
