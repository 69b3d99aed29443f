"""A batch as an Open Job Description (job template 2023-09): steps that a studio's farm runs in its own order on its own machines.

Each job has the steps recover -> re-simulate -> bake (a .blend, in Blender with this extension) -> render (a task per frame, in any
Blender). Paths are relative to the folder of the jobs' file, which is a parameter, so that a farm can map it to its machines' path.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from ...errors import UsageError
from ...progress import Progress
from ...settings import ObserveSettings, options_of
from ...take import Take
from .jobs import Job
from .needs import BLENDER, MIB, TABLE, Needs
from .node import edition
from .process import ROOT

TEMPLATE, PARAMETERS = "template.json", "parameters.json"
"""File names of the job template, and of the values of its parameters on the machine that wrote it."""
NAME_LENGTH = 64
"""Most characters of a step's name, by the specification."""
FIRST_FRAME = 1
"""Scene frame that shows clip frame 0 in a file made by `bake`."""

CHECK = """\
import sys
from seeing_wind.engine.command.batch.node import edition
if edition() != sys.argv[1]:
    print(f"openjd_fail: this machine has the engine {edition()}, the job was written by {sys.argv[1]}")
    sys.exit(1)
"""

ENGINE = """\
import sys
from seeing_wind.engine.__main__ import main
from seeing_wind.engine.errors import DONE_WITH_WARNINGS
code = main(sys.argv[1:])
sys.exit(0 if code == DONE_WITH_WARNINGS else code)
"""
"""Runs the engine and exits with 0 for a job with warnings: a farm treats every other exit code as a failure and holds back later steps."""


def write_bundle(jobs: list[Job], path: Path, folder: Path, progress: Progress) -> dict[str, Any]:
    """Write template.json and parameters.json into `folder` for all `jobs` of the file `path`.

    Jobs that are done on this machine are included: the farm decides what to repeat.

    Returns:
        Both paths, the steps' names and the number of frames to render.

    Raises:
        UsageError: a name is too long for a step, or has double braces, which have a meaning in a template.
        ClipError: a clip that is to be rendered cannot be read.
    """
    progress.begin("batch", "counts frames")
    bundle = Bundle(path.resolve().parent)
    for job in jobs:
        progress.check()
        bundle.add(job, next((other for other in jobs if other.take == job.take and other.source is not None), None))
    template = bundle.template(f"Seeing Wind: {path.name}")
    Take(folder).write_json(PARAMETERS, bundle.parameters())
    Take(folder).write_json(TEMPLATE, template)
    files = {"template": str(folder / TEMPLATE), "parameters": str(folder / PARAMETERS)}
    return {**files, "steps": [step["name"] for step in bundle.steps], "frames": bundle.frames}


class Bundle:
    """The steps of a template, collected job by job.

    Args:
        home: the folder of the jobs' file, to which paths are relative.
    """

    def __init__(self, home: Path) -> None:
        self.folders = [home]
        self.steps: list[dict[str, Any]] = []
        self.frames = 0

    def add(self, job: Job, maker: Job | None) -> None:
        """Add the steps of one job. `maker` is the first job that recovers into its take, None if the take exists already."""
        after: str | None = f"{maker.name}: recover" if maker is not None else None
        for call in job.calls():
            if call[0] == "resimulate":
                after = self._step(f"{job.name}: re-simulate", TABLE[call[0]], self._engine(call), after, [_ENGINE])
            elif maker is job:
                self._step(f"{job.name}: recover", TABLE[call[0]], self._engine(call), None, [_ENGINE])
        if not job.needs_blender:
            return
        scene = job.save or job.render.with_suffix(".blend")  # type: ignore[union-attr]
        words = ["--command", "seeing_wind", "bake", self._path(job.take), "--save", self._path(scene)]
        clip = maker.clip if maker is not None else None
        words += ["--clip", self._path(clip)] if clip is not None else []
        words += ["--edit-take", self._path(job.edit_take)] if job.edit_take is not None else []
        words += ["--composite"] if job.render is not None else []
        after = self._step(f"{job.name}: bake", BLENDER, _action("{{Param.Blender}}", words), after, [_ENGINE, _EXTENSION])
        if job.render is not None:
            frames = self._path(job.render.with_suffix(".frames"))
            words = ["--background", self._path(scene), "--render-output", f"{frames}/####", "--render-format", "PNG"]
            words += ["--use-extension", "1", "--render-frame", "{{Task.Param.Frame}}"]
            count = _frame_count(job, maker)
            self.frames += count
            last = FIRST_FRAME + count - 1
            space = {"taskParameterDefinitions": [{"name": "Frame", "type": "INT", "range": f"{FIRST_FRAME}-{last}"}]}
            self._step(f"{job.name}: render", BLENDER, _action("{{Param.Blender}}", words), after, [], space)

    def template(self, name: str) -> dict[str, Any]:
        """The whole job template."""
        folders = [
            {"name": name, "type": "PATH", "objectType": "DIRECTORY", "dataFlow": "INOUT"} for name in self.parameters() if name != "Engine"
        ]
        folders[0]["description"] = "Holds the jobs' file, its clips and its takes; the same for all machines."
        return {
            "specificationVersion": "jobtemplate-2023-09",
            "name": name[:128],
            "parameterDefinitions": [
                *folders,
                {"name": "Python", "type": "STRING", "default": sys.executable, "description": "Python with the engine's packages"},
                {"name": "Engine", "type": "PATH", "objectType": "DIRECTORY", "dataFlow": "NONE",
                 "description": "The folder that holds the package seeing_wind"},
                {"name": "Edition", "type": "STRING", "default": edition(), "description": "The engine that all machines must have"},
                {"name": "Blender", "type": "STRING", "default": "blender", "description": "For bake with the extension switched on"},
            ],
            "steps": self.steps,
        }  # fmt: skip

    def parameters(self) -> dict[str, str]:
        """The folders' paths on this machine, by parameter; a template may not have them as defaults."""
        return {**{f"Folder{k or ''}": str(folder) for k, folder in enumerate(self.folders)}, "Engine": str(ROOT)}

    def _step(
        self, name: str, needs: Needs, script: dict[str, Any], after: str | None, environments: list[dict[str, Any]],
        space: dict[str, Any] | None = None,
    ) -> str:  # fmt: skip
        if len(name) > NAME_LENGTH:
            raise UsageError(f"'{name}' is too long for a step.", f"Shorten the job's name: {NAME_LENGTH} characters with the step's.")
        _plain(name)
        step: dict[str, Any] = {"name": name, "script": script}
        if after is not None:
            step["dependencies"] = [{"dependsOn": after}]
        if environments:
            step["stepEnvironments"] = environments
        if space is not None:
            step["parameterSpace"] = space
        amounts = {"vcpu": 1, "memory": needs.memory // MIB}  # no step needs a second core
        step["hostRequirements"] = {"amounts": [{"name": f"amount.worker.{key}", "min": value} for key, value in amounts.items()]}
        self.steps.append(step)
        return name

    def _engine(self, call: list[str]) -> dict[str, Any]:
        # A job's paths are absolute, and no other word of a call looks like an absolute path.
        words = [self._path(Path(word)) if Path(word).is_absolute() else word for word in call]
        return _action("{{Param.Python}}", ["-c", ENGINE, *words])

    def _path(self, path: Path) -> str:
        """A path, written relative to the parameter for its folder. A path outside the jobs' folder adds a parameter for its own folder."""
        for k, folder in enumerate(self.folders):
            if path.is_relative_to(folder):
                return f"{{{{Param.Folder{k or ''}}}}}/{_plain(path.relative_to(folder).as_posix())}"
        self.folders.append(path.parent)
        return self._path(path)


def _plain(text: str) -> str:
    if "{{" in text or "}}" in text:
        raise UsageError(f"'{text}' holds double braces, which a job template reads as its own.", "Rename it.")
    return text


def _action(command: str, words: list[str]) -> dict[str, Any]:
    for word in words:
        if "{{Param." not in word and "{{Task." not in word:
            _plain(word)
    return {"actions": {"onRun": {"command": command, "args": words}}}


def _frame_count(job: Job, maker: Job | None) -> int:
    """Number of frames of the job's clip, all of which are rendered.

    Raises:
        UsageError: the take comes from trajectories, so there is no clip to render over.
        TakeError: the take should exist already, but has no report.
        ClipError: as `count_frames`.
    """
    from ...observe.clip.frames import count_frames

    if maker is None:
        return int(Take(job.take).read_json("report.json")["frames"]) + 1
    if maker.clip is None:
        raise UsageError(f'"{job.name}" renders, and its take comes from trajectories.', "Leave `render` out: it goes over a clip.")
    frames = maker.recover.get("frames")
    if isinstance(frames, str):
        first, last = options_of(ObserveSettings)["frames"].read(frames)
        return last - first + 1
    return count_frames(str(maker.clip))


_ENGINE: dict[str, Any] = {
    "name": "Seeing Wind's engine",
    "variables": {"PYTHONPATH": "{{Param.Engine}}", "SEEING_WIND_PYTHON": "{{Param.Python}}"},
    "script": {
        "actions": {"onEnter": {"command": "{{Param.Python}}", "args": ["{{Env.File.Check}}", "{{Param.Edition}}"]}},
        "embeddedFiles": [{"name": "Check", "type": "TEXT", "filename": "check.py", "data": CHECK}],
    },
}
_EXTENSION: dict[str, Any] = {
    "name": "Seeing Wind in Blender",
    "script": {"actions": {"onEnter": {"command": "{{Param.Blender}}", "args": ["--command", "seeing_wind", "--help"]}}},
}
