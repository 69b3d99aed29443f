"""`blender --command seeing_wind VERB ...`: the worker's verbs and options, unchanged, with Blender's scene on top.

`recover`, `recover-trajectories` and `resimulate` also take `--save FILE.blend`; `batch JOBS.toml` does many of them, see `batch`. Exit
codes are the worker's: 0 done, 1 failed, 2 wrong usage, 130 cancelled.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import bpy

from ..engine.errors import SeeingWindError, UsageError
from . import batch
from .job import console, takes, worker
from .job.install.choices import asked_model
from .job.install.environment import engine_python
from .job.worker_command import command, environment

NAME = "seeing_wind"
VERBS = ("recover", "recover-trajectories", "sample", "resimulate", "export", "identify", "doctor")
SAVES = ("recover", "recover-trajectories", "resimulate")

USAGE = f"""usage: blender --command {NAME} VERB ...

verbs: {", ".join(VERBS)}
Each takes the options of `python -m seeing_wind.engine VERB`; see `blender --command {NAME} VERB --help`.
{", ".join(SAVES)} also take --save FILE.blend.
batch JOBS.toml [--again] does many clips and edits; what is done already is not done again."""


def main(argv: list[str]) -> int:
    """Run one verb; returns the exit code."""
    if not argv or argv[0] in ("-h", "--help"):
        print(USAGE)
        return 0 if argv else 2
    out = console.Console()
    try:
        if argv[0] == "batch":
            return _batch(argv[1:], out)
        verb, options, save = _split(argv)
        python = engine_python()
        if "-h" in options or "--help" in options:
            return subprocess.run(command(python, verb, *options), env=environment(), check=False).returncode
        code = _run(python, verb, options, out)
        if code == 0 and save:
            code = _save(python, verb, options, save, out)
        return code
    except SeeingWindError as error:
        out.show({"type": "error", "message": error.message, "hint": error.hint})
        return error.exit_code


def _batch(options: list[str], out: console.Console) -> int:
    """All jobs of a file.

    Raises:
        UsageError: for wrong options, or a file that is none.
    """
    words = [word for word in options if word != "--again"]
    if len(words) != 1 or words[0].startswith("-"):
        raise UsageError("batch takes one file of jobs.", f"blender --command {NAME} batch JOBS.toml [--again]")
    python = engine_python()
    return batch.run(Path(words[0]), lambda each: _job(python, each, out), lambda line: print(line, flush=True), "--again" in options)


def _job(python: str, each: batch.Job, out: console.Console) -> int:
    """One job of a batch; returns its exit code."""
    code = _run(python, "recover", each.recover_options(), out) if each.clip is not None else 0
    if code == 0 and each.edit is not None:
        code = _run(python, "resimulate", each.resimulate_options(), out)
    if code == 0 and (each.save is not None or each.render is not None):
        code = _build(python, each.take, str(each.clip or ""), each.edit_take, out)
    if code:
        return code
    if each.save is not None:
        _save_file(str(each.save))
    if each.render is not None:
        from .composite import composite  # needs NumPy

        composite.set_up(bpy.context.scene)
        composite.render(bpy.context.scene, each.render)
    return 0


def _split(argv: list[str]) -> tuple[str, list[str], str]:
    """Verb, the worker's options, and the file to save ("" for none).

    Raises:
        UsageError: for an unknown verb, or a --save that makes no sense.
    """
    verb, options, save = argv[0], [], ""
    if verb not in VERBS:
        raise UsageError(f"There is no verb '{verb}'.", f"Verbs: {', '.join(VERBS)}, batch.")
    rest = iter(argv[1:])
    for word in rest:
        if word == "--save" or word.startswith("--save="):
            save = word.partition("=")[2] if "=" in word else next(rest, "")
            if verb not in SAVES or not save.endswith(".blend"):
                raise UsageError("--save takes the path of a .blend file, after recover or resimulate.", f"Got '{save}' after {verb}.")
            if not os.path.isdir(os.path.dirname(os.path.abspath(save))):
                raise UsageError(f"There is no folder for {save}.", "Make it first.")
        else:
            options.append(word)
    return verb, options, save


def _run(python: str, verb: str, options: list[str], out: console.Console) -> int:
    """Run the worker in the user's own folder, so that relative paths mean what they say."""
    call = command(python, verb, *options)
    key = asked_model()[2] if any(option.startswith("--material-endpoint") for option in options) else ""
    last = worker.wait(worker.run(call, cwd=os.getcwd(), env=environment(key) | {"PYTHONSAFEPATH": "1"}), out.show)
    return last["code"] if last["code"] in (0, 1, 2) else worker.CANCELLED if last["outcome"] == "cancelled" else 1


def _save(python: str, verb: str, options: list[str], save: str, out: console.Console) -> int:
    """A new file with the results: the field and the recovered object, and for a re-simulation its bodies with their motion."""
    take = Path(_value(options, "--take")).resolve()
    # The folder of the recovered field is the verb's own argument where --take names the re-simulation.
    source = Path(options[0]).resolve() if verb == "resimulate" else take
    clip = str(Path(options[0]).resolve()) if verb == "recover" else ""
    code = _build(python, source, clip, take if verb == "resimulate" else None, out)
    if code == 0:
        _save_file(save)
    return code


def _build(python: str, source: Path, clip: str, edit: Path | None, out: console.Console) -> int:
    """An empty file with the results of a take, and of a re-simulation; returns the exit code."""
    from .recover import results  # needs NumPy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    if not hasattr(scene, "seeing_wind"):  # factory settings switch extensions off
        switch_on()
    settings = scene.seeing_wind
    last = worker.wait(results.sampling(python, source, settings.field_resolution), out.show)
    if last["outcome"] != "done":
        return worker.CANCELLED if last["outcome"] == "cancelled" else 1
    results.build(scene, source, clip)
    takes.show(settings, source, "loaded")
    if edit is not None:
        settings.simulated_take, settings.simulated_digest = str(edit), "loaded"
        results.import_bodies(scene, edit, settings.frame_start)
    return 0


def _save_file(save: str) -> None:
    path = os.path.abspath(save)
    try:
        os.makedirs(os.path.dirname(path), exist_ok=True)
        bpy.ops.wm.save_as_mainfile(filepath=path)
    except (OSError, RuntimeError) as error:
        said = error.strerror if isinstance(error, OSError) else worker.said_by(error)
        raise SeeingWindError(f"{path} cannot be saved: {said}.", "Choose a folder that can be written.") from error
    print(f"Saved {path}", flush=True)


def _value(options: list[str], name: str) -> str:
    """The value of an option that the worker has accepted already."""
    for index, word in enumerate(options):
        if word == name:
            return options[index + 1]
        if word.startswith(f"{name}="):
            return word.partition("=")[2]
    raise UsageError(f"{name} is missing.", f"See `blender --command {NAME} --help`.")


def switch_on() -> None:
    """Register the whole extension. The package, which knows all of it, puts its own function in this one's place."""
    raise NotImplementedError


_handle: object | None = None


def register() -> None:
    """Make the command known."""
    global _handle
    unregister()
    _handle = bpy.utils.register_cli_command(NAME, main)


def unregister() -> None:
    """Forget the command."""
    global _handle
    if _handle is not None:
        bpy.utils.unregister_cli_command(_handle)
        _handle = None
