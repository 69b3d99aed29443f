"""`blender --command seeing_wind VERB ...`: the worker's verbs and options, unchanged, with Blender's scene in addition.

`recover`, `recover-trajectories` and `resimulate` also take `--save FILE.blend`; `batch JOBS.toml` runs many of them, and `bake` makes
a file from existing takes, see `batch`. Exit codes are the worker's: 0 done, 1 the work failed, 2 the input cannot be used, 3 done with
warnings, 130 cancelled.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import bpy

from ..engine.errors import DONE_WITH_WARNINGS, SeeingWindError, UsageError
from . import batch
from .job import console
from .job.install.environment import engine_python
from .job.worker_command import command, environment

NAME = "seeing_wind"
VERBS = ("observe", "recover", "recover-trajectories", "sample", "resimulate", "export", "join", "identify", "doctor")
FILED = ("batch", "bake")
"""Verbs of the Blender side, which are functions of `batch`."""
SAVES = ("recover", "recover-trajectories", "resimulate")

USAGE = f"""usage: blender --command {NAME} VERB ...

verbs: {", ".join(VERBS)}
Each takes the options of `python -m seeing_wind.engine VERB`; see `blender --command {NAME} VERB --help`.
{", ".join(SAVES)} also take --save FILE.blend.
batch JOBS.toml [--again] does many clips and edits; what is done already is not done again. With --ray ADDRESS it makes their takes on a
Ray cluster, with --openjd FOLDER it writes a bundle for a farm, with --check it only checks the file; see docs/guide/batch-and-farm.md.
bake TAKE [--edit-take DIR] [--clip CLIP] [--composite] --save FILE.blend makes a file of takes that are there."""


def main(argv: list[str]) -> int:
    """Run one verb; returns the exit code."""
    if not argv or argv[0] in ("-h", "--help"):
        print(USAGE)
        return 0 if argv else 2
    out = console.Console()
    try:
        if argv[0] in FILED:
            return getattr(batch, argv[0])(argv[1:], out)
        verb, options, save = _split(argv)
        python = engine_python()
        if "-h" in options or "--help" in options:
            return subprocess.run(command(python, verb, *options), env=environment(), check=False).returncode
        code = batch.run_verb(python, verb, options, out.show)
        if code in (0, DONE_WITH_WARNINGS) and save:
            code = _save(python, verb, options, save, out) or code
        return code
    except SeeingWindError as error:
        out.show({"type": "error", "message": error.message, "hint": error.hint})
        return error.exit_code


def _split(argv: list[str]) -> tuple[str, list[str], str]:
    """Verb, the worker's options, and the file to save ("" for none).

    Raises:
        UsageError: for an unknown verb, or an invalid --save.
    """
    verb, options, save = argv[0], [], ""
    if verb not in VERBS:
        raise UsageError(f"There is no verb '{verb}'.", f"Verbs: {', '.join((*VERBS, *FILED))}.")
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


def _save(python: str, verb: str, options: list[str], save: str, out: console.Console) -> int:
    """Save a new file with the results: the field, the recovered object, and for a re-simulation its bodies with their motion. Returns the
    exit code."""
    take = Path(value_of(options, "--take")).resolve()
    # for `resimulate`, --take names the re-simulation, and the verb's argument the recovered field
    source = Path(options[0]).resolve() if verb == "resimulate" else take
    clip = str(Path(options[0]).resolve()) if verb == "recover" else ""
    code = batch.build(python, source, clip, take if verb == "resimulate" else None, out.show)
    if code == 0:
        batch.save_file(save)
    return code


def value_of(options: list[str], name: str) -> str:
    """The value of an option that the worker has accepted already. Raises UsageError when it is missing."""
    for index, word in enumerate(options):
        if word == name:
            return options[index + 1]
        if word.startswith(f"{name}="):
            return word.partition("=")[2]
    raise UsageError(f"{name} is missing.", f"See `blender --command {NAME} --help`.")


_handle: object | None = None


def register() -> None:
    """Register the command with Blender."""
    global _handle
    unregister()
    _handle = bpy.utils.register_cli_command(NAME, main)


def unregister() -> None:
    """Unregister the command."""
    global _handle
    if _handle is not None:
        bpy.utils.unregister_cli_command(_handle)
        _handle = None
