"""What a user gives, kept from being overwritten: inputs that lie where a take's own files go, and folders that hold somebody's files."""

from __future__ import annotations

import argparse
import filecmp
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from ..conventions import image_files, is_sequence
from ..errors import UsageError
from ..settings import BuildSettings, Edit, ObserveSettings, RecoverSettings, options_of
from ..settings.tables import names_in
from ..take import RESULTS, Take

MADE = rf"{RESULTS.pattern}|bodies/[^/.][^/]*\.npz"
"""Pattern of what the stages of a take write, from its folder on."""
SIGNS = ("take.toml", "take.lock", "field.safetensors")
"""A folder with one of them is a take: a job that is killed before it stamps its first stage leaves the lock."""
TRUTH = ("trajectories", "truth")
"""Where a take says which file of trajectories it was recovered from: as a stage and what that was given."""
PROPOSED = "held.png"
"""What `observe` proposes as held, to be given back as --pin; no stage writes it then."""


def inputs_of(arguments: argparse.Namespace) -> Iterator[tuple[str, Path]]:
    """The files that the options of a verb name, and what a message calls each."""
    for name in ("clip", "truth"):
        if hasattr(arguments, name):
            yield from ((str(file), file) for file in _files(getattr(arguments, name)))
    files = [one for cls in (ObserveSettings, BuildSettings, RecoverSettings) for one in options_of(cls).values() if one.file]
    for one in files:
        given = getattr(arguments, one.name, None)
        if given and not (one.name == "pin" and Path(given).name == PROPOSED):
            yield f"{one.flag} {given}", Path(given)
    for view in getattr(arguments, "view", ()):
        yield from ((f"--view {name}", file) for name in view for file in _files(name))


def inputs_of_edit(edit: Path) -> Iterator[tuple[str, Path]]:
    """An edit's file and those that it names, and what a message calls each."""
    yield str(edit), edit
    yield from ((f"{name} of {edit}", edit.parent / name) for name in names_in(edit))


def refuse_overwriting(take: Take, inputs: Iterable[tuple[str, Path]], made: str = MADE) -> None:
    """See that no file that is read would be replaced by one that the job writes into the take.

    Args:
        inputs: what a message calls each, and its path.
        made: pattern of the names that it writes, from the take's folder on, with '/' between folders.

    Raises:
        UsageError: one would.
    """
    home = Path(os.path.realpath(take.path))
    for called, path in inputs:
        if not os.path.isfile(path):  # told by the stage that reads it
            continue
        # A link in the take is replaced as well, wherever it leads.
        for place in (Path(os.path.realpath(path)), Path(os.path.realpath(path.parent), path.name)):
            if place.is_relative_to(home) and _is_made(home, place, made):
                raise UsageError(
                    f"{called} lies in the take {take.path} under the name of a file that is written there.",
                    "Move or rename it, or choose another folder with --take.",
                )


def made_of(edit: Edit) -> str:
    """Pattern of what a re-simulation of this edit may write, from its folder on; bodies of other edits are left as they are."""
    return "|".join([RESULTS.pattern, *(re.escape(f"bodies/{body.name}.npz") for body in edit.body)])


def refuse_foreign(take: Take) -> None:
    """See that a folder that is no take yet holds no files that one would replace.

    Raises:
        UsageError: it does.
    """
    if not take.path.is_dir() or any(take.file(name).exists() for name in SIGNS):
        return
    for path in sorted([*take.path.iterdir(), *take.path.glob("bodies/*")]):
        if path.is_file() and _is_made(take.path, path, MADE):
            name = path.relative_to(take.path).as_posix()
            raise UsageError(f"{take.path} is not a take and holds {name}.", "Choose another folder with --take.")


def refuse_result(path: Path, folder: bool = False) -> None:
    """See that what a user asked for with --out replaces no file of some take, one that stages have stamped or with a field, and nothing
    that is no file.

    Args:
        path: to be written; folder: it is one, and may be there already.

    Raises:
        UsageError: it does.
    """
    if any((path.parent / name).is_file() for name in ("take.toml", "field.safetensors")) and RESULTS.fullmatch(path.name):
        raise UsageError(f"{path} is a file of the take {path.parent}.", "Give --out another name.")
    if path.exists() and not path.is_file() and not (folder and path.is_dir()):
        raise UsageError(f"{path} is there already and is no regular file.", "Give --out another name.")


def refuse_of_another(take: Take, file: str) -> None:
    """See that what a take holds of one clip, or of one file of trajectories, is not replaced by another's. One that was copied or moved
    is no other.

    Raises:
        UsageError: it would be.
    """
    for kind, of in (("clip", take.source_of("observe", "clip")), ("file of trajectories", take.source_of(*TRUTH))):
        if _another(file, of):
            raise UsageError(
                f"{take.path} is the take of another {kind}, {of}, and not of {file}.",
                "Choose another folder with --take, or move that one away.",
            )


def note_truth(take: Take, upstream: str, truth: str) -> None:
    """Keep in a take which file of trajectories, `truth`, it was recovered from; `upstream`: the stamp of what was read of it."""
    take.finish(TRUTH[0], upstream, {TRUTH[1]: truth})


def refuse_of_another_edit(take: Take, edit: Path) -> None:
    """The same of a re-simulation. An edit that lies in the folder itself, as the panel's do, is that folder's own.

    Raises:
        UsageError: it is another edit's.
    """
    of = take.source_of("resimulate", "edit")
    if not edit.resolve().is_relative_to(take.path.resolve()) and _another(str(edit), of):
        raise UsageError(
            f"{take.path} holds the re-simulation of another edit, {of}, and not of {edit}.",
            "Choose another folder with --take, or move that one away.",
        )


def _another(file: str, than: str) -> bool:
    """Whether a file is another one than a take names, if it names any: neither the same, nor a copy, nor one that was moved."""
    if not than or os.path.realpath(file) == os.path.realpath(than):
        return False
    if os.path.isfile(file) and os.path.isfile(than):
        return not filecmp.cmp(file, than, shallow=False)
    return os.path.basename(file) != os.path.basename(than)


def _files(clip: str) -> list[Path]:
    """The files of a clip that may be no more than a file's name."""
    return image_files(clip) if is_sequence(clip) else [Path(clip)]


def _is_made(home: Path, path: Path, made: str) -> bool:
    """Whether `path`, in `home`, is one of these files, also where the file system does not tell capitals."""
    name = path.relative_to(home).as_posix()
    if re.fullmatch(made, name):
        return True
    small = home / name.lower()
    return re.fullmatch(made, name.lower()) is not None and small.exists() and os.path.samefile(small, path)
