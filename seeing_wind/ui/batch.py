"""Writing results into files without a window: `batch JOBS.toml`, and `bake`, a single step for farms that run the steps themselves.

The file of jobs, the order and the summary are handled by the engine (`engine/command/batch/`); what needs Blender is here: build, save,
render.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ..engine.errors import CANCELLED, DONE_WITH_WARNINGS, SeeingWindError, UsageError
from ..engine.progress import Cancelled
from .job import console, notes, takes, worker
from .job.install.choices import asked_model, outline_model
from .job.install.environment import engine_python
from .job.worker_command import command, environment

if TYPE_CHECKING:
    from ..engine.command.batch.jobs import Job
    from ..engine.command.batch.summary import Summary

Show = Callable[[worker.Message], None]


def batch(options: list[str], out: console.Console) -> int:
    """`batch JOBS.toml [--again]`: run all jobs of a file; returns the exit code. The engine alone does it with --ray, --openjd or --check.

    Raises:
        UsageError: for wrong options, or a file that is not a valid file of jobs.
    """
    from ..engine.command.batch.in_order import run_in_order  # needs NumPy
    from ..engine.command.batch.jobs import read_jobs
    from ..engine.command.batch.summary import Summary

    python = engine_python()
    if any(word.partition("=")[0] in ("--ray", "--openjd", "--check") for word in options):
        return run_verb(python, "batch", options, out.show)
    words = [word for word in options if word != "--again"]
    if len(words) != 1 or words[0].startswith("-"):
        raise UsageError("batch takes one file of jobs.", "blender --command seeing_wind batch JOBS.toml [--again]")
    path = Path(words[0])
    summary = Summary(path, read_jobs(path), whole=True, again="--again" in options)

    def show(message: worker.Message) -> None:
        if message["type"] != "warning":  # the jobs tell theirs themselves
            out.show(message)

    code = run_verb(python, "batch", [*options, "--check"], show)
    if code != 0:
        return code
    run_in_order(summary, lambda each, made: _do(python, summary, each, made, out), lambda line: print(line, flush=True))
    print(summary.table(), flush=True)
    return summary.exit_code


def _do(python: str, summary: Summary, each: Job, made: bool, out: console.Console) -> None:
    """Run one job; `made`: whether its takes exist already. Raises SeeingWindError with the worker's message, or Cancelled."""
    said: list[str] = []

    def show(message: worker.Message) -> None:
        if message["type"] == "error":
            said.append(f"{message.get('message', '')} {message.get('hint', '')}".strip())
        out.show(message)

    def must(code: int) -> None:
        if code == CANCELLED:
            raise Cancelled
        if code not in (0, DONE_WITH_WARNINGS):
            raise SeeingWindError(said[-1] if said else f"The engine ended with exit code {code}.")

    for verb, *options in [] if made else each.calls():
        must(run_verb(python, verb, options, show))
        summary.recovered.add(each.take)
    if each.needs_blender:
        must(build(python, each.take, str(each.clip or ""), each.edit_take, show))
    if each.save is not None:
        save_file(str(each.save))
    if each.render is not None:
        from .composite import composite  # needs NumPy

        composite.set_up(bpy.context.scene)
        composite.render(bpy.context.scene, each.render)


def bake(options: list[str], out: console.Console) -> int:
    """`bake TAKE [--edit-take DIR] [--clip CLIP] [--composite] --save FILE.blend`: save the contents of takes; returns the exit code.

    With `--composite`, the file is ready to be rendered over the clip, in a Blender without this extension.

    Raises:
        UsageError: for wrong options.
    """
    parser = argparse.ArgumentParser(prog="bake", exit_on_error=False, add_help=False, allow_abbrev=False)
    parser.add_argument("take")
    for name in ("--edit-take", "--clip", "--save"):
        parser.add_argument(name, default="")
    parser.add_argument("--composite", action="store_true")
    try:
        asked, unknown = parser.parse_known_args(options)
    except (argparse.ArgumentError, SystemExit) as error:
        raise UsageError(f"bake cannot read its options: {error}.", BAKE) from error
    if unknown or not asked.save.endswith(".blend"):
        raise UsageError(f"bake takes a take and --save FILE.blend, not {' '.join(unknown) or repr(asked.save)}.", BAKE)
    edit = Path(asked.edit_take).resolve() if asked.edit_take else None
    clip = os.path.abspath(asked.clip) if asked.clip else ""
    code = build(engine_python(), Path(asked.take).resolve(), clip, edit, out.show)
    if code == 0:
        if asked.composite:
            from .composite import composite  # needs NumPy

            composite.set_up(bpy.context.scene)
        save_file(asked.save)
    return code


BAKE = "blender --command seeing_wind bake TAKE [--edit-take DIR] [--clip CLIP] [--composite] --save FILE.blend"


def run_verb(python: str, verb: str, options: list[str], show: Show) -> int:
    """Run the worker in the current folder, so that relative paths are resolved as the user expects; returns its exit code."""
    call = command(python, verb, *options)
    key = asked_model()[2] if any(option.startswith("--material-endpoint") for option in options) else ""
    env = environment(key, outline_model()) | {"PYTHONSAFEPATH": "1"}
    last = worker.wait(worker.run(call, cwd=os.getcwd(), env=env), show)
    return last["code"] if last["code"] in (0, 1, 2, DONE_WITH_WARNINGS) else CANCELLED if last["outcome"] == "cancelled" else 1


def build(python: str, source: Path, clip: str, edit: Path | None, show: Show) -> int:
    """Start from an empty file and load the results of a take, and of a re-simulation if given; returns the exit code."""
    from .recover import results, sampling, simulated  # need NumPy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    if not hasattr(scene, "seeing_wind"):  # factory settings switch extensions off
        switch_on()
    settings = scene.seeing_wind
    last = worker.wait(sampling.sampling(python, source), show)
    if last["outcome"] != "done":
        return CANCELLED if last["outcome"] == "cancelled" else 1
    filled = results.build(scene, source, clip)
    takes.show(settings, source, results.digest_of_loaded(scene, filled))
    notes.keep(settings, "recover", results.notes(scene, source))
    if edit is not None:
        simulated.import_bodies(scene, edit, settings.frame_start)
    return 0


def save_file(save: str) -> None:
    """Save the file under this path. Raises SeeingWindError when that fails."""
    path = os.path.abspath(save)
    try:
        os.makedirs(os.path.dirname(path), exist_ok=True)
        bpy.ops.wm.save_as_mainfile(filepath=path)
    except (OSError, RuntimeError) as error:
        said = error.strerror if isinstance(error, OSError) else worker.said_by(error)
        raise SeeingWindError(f"{path} cannot be saved: {said}.", "Choose a folder that can be written.") from error
    print(f"Saved {path}", flush=True)


def switch_on() -> None:
    """Register the whole extension. Placeholder, which the package `ui` replaces by its own `register`."""
    raise NotImplementedError
