"""Protection of the user's files from being overwritten: inputs that lie where a take's files go, and folders that are not takes."""

from __future__ import annotations

import argparse
import filecmp
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from ..conventions import EDIT, OF_SCENE, PANEL_INPUTS, image_files, is_sequence
from ..errors import UsageError
from ..settings import BuildSettings, Edit, ObserveSettings, RecoverSettings, options_of
from ..settings.tables import names_in
from ..take import RESULTS, Take

MADE = rf"{RESULTS.pattern}|bodies/[^/.][^/]*\.npz"
"""Pattern of the files that stages write into a take, relative to its folder."""
LOCK = "take.lock"
SIGNS = ("take.toml", LOCK, "field.safetensors")
"""A folder with any of these files is a take. A job that is killed before it stamps its first stage leaves only the lock."""
BESIDE = re.compile(rf"\..*|Thumbs\.db|desktop\.ini|{PANEL_INPUTS}|objects|objects(_recovered)?\.json")
"""Names of what may be in a folder that becomes a take: what systems put into any folder, the panel's inputs, and what `identify` found."""
SHOWN = 3
"""Number of files and folders, at most, that a message names."""
TRUTH = ("trajectories", "truth")
"""Stage and key, in take.toml, under which a take keeps the file of trajectories that it was recovered from."""
RECOVERED = ("observation.npz", "solve.npz", "field.safetensors")
"""A folder with any of these files is the take of a recovery."""
ELSEWHERE = "Choose another folder with --take, or move that one away."
PROPOSED = "held.png"
"""The mask that `observe` proposes as held. The user may give it back as --pin; no stage writes it then."""


def inputs_of(arguments: argparse.Namespace) -> Iterator[tuple[str, Path]]:
    """The files that a verb's options name, each as (name in messages, path)."""
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
    """An edit's file and the files that it names, each as (name in messages, path)."""
    yield str(edit), edit
    yield from ((f"{name} of {edit}", edit.parent / name) for name in names_in(edit))


def check_place(take: Take, inputs: Iterable[tuple[str, Path]] = (), made: str = MADE) -> None:
    """Check that a job can write into a take without replacing a file of the user's; arguments as of `refuse_overwriting`.

    Raises:
        UsageError: as `Take.refuse_file`, `refuse_overwriting` and `refuse_foreign`.
    """
    read = list(inputs)
    take.refuse_file()
    refuse_overwriting(take, read, made)
    refuse_foreign(take, read)


def refuse_overwriting(take: Take, inputs: Iterable[tuple[str, Path]], made: str = MADE) -> None:
    """Check that the job does not replace a file that it reads by one that it writes into the take.

    Args:
        inputs: the files that are read, each as (name in messages, path).
        made: pattern of the files that are written, relative to the take's folder, with '/' between folders.

    Raises:
        UsageError: a file that is read would be replaced.
    """
    home = Path(os.path.realpath(take.path))
    for called, path in inputs:
        if not os.path.isfile(path):  # reported by the stage that reads it
            continue
        # A link in the take would be replaced, too, wherever it points.
        for place in (Path(os.path.realpath(path)), Path(os.path.realpath(path.parent), path.name)):
            if place.is_relative_to(home) and _is_made(home, place, made):
                raise UsageError(
                    f"{called} lies in the take {take.path} under the name of a file that is written there.",
                    "Move or rename it, or choose another folder with --take.",
                )


def made_of(edit: Edit) -> str:
    """Pattern of the files that a re-simulation of this edit may write, relative to its folder; bodies of other edits are left alone."""
    return "|".join([RESULTS.pattern, *(re.escape(f"bodies/{body.name}.npz") for body in edit.body)])


def refuse_foreign(take: Take, inputs: Iterable[tuple[str, Path]], of_takes: bool = False) -> None:
    """Check that a folder that is not a take yet may become one: it is not in a take, and new or empty, but for the job's own inputs.

    Args:
        inputs: the files that are read, each as (name in messages, path).
        of_takes: whether takes may be in it, which its objects' takes are.

    Raises:
        UsageError: it is in a take, or something else is in it.
    """
    if _is_take(take.path) or _is_of_panel(take.path):
        return
    home = Path(os.path.realpath(take.path))
    around = next((folder for folder in home.parents if any((folder / name).is_file() for name in SIGNS if name != LOCK)), None)
    if around is not None:
        hint = "Choose a folder beside that with --take: a take is moved, sent and replaced as a whole."
        raise UsageError(f"{take.path} is inside the take {around}.", hint)
    if not take.path.is_dir():
        return
    read = {Path(os.path.realpath(path.parent), path.name) for _, path in inputs} | {Path(os.path.realpath(path)) for _, path in inputs}
    own = read.union(*(path.parents for path in read))
    foreign = sorted(
        path.name
        for path in home.iterdir()
        if not BESIDE.fullmatch(path.name) and path not in own and not (of_takes and _is_take(path))
    )
    if foreign:
        more = f" and {len(foreign) - SHOWN} more" if len(foreign) > SHOWN else ""
        named = ", ".join(foreign[:SHOWN]) + more
        raise UsageError(f"{take.path} is not a take and holds {named}.", "Choose a new or an empty folder with --take.")


def _is_take(folder: Path) -> bool:
    return any((folder / name).exists() for name in SIGNS)


def _is_of_panel(folder: Path) -> bool:
    """Whether the panel has written an edit into a folder, which is then for the re-simulation of that edit."""
    try:
        with open(folder / EDIT, "rb") as file:
            return file.read(len(OF_SCENE)) == OF_SCENE.encode()
    except OSError:
        return False


def refuse_result(path: Path, folder: bool = False) -> None:
    """Check that the result given by --out replaces neither a file of a take (with stamped stages or a field) nor anything but a file.

    Args:
        path: the result to be written.
        folder: whether it is a folder, which may exist already.

    Raises:
        UsageError: it does.
    """
    if any((path.parent / name).is_file() for name in ("take.toml", "field.safetensors")) and RESULTS.fullmatch(path.name):
        raise UsageError(f"{path} is a file of the take {path.parent}.", "Give --out another name.")
    if path.exists() and not path.is_file() and not (folder and path.is_dir()):
        raise UsageError(f"{path} is there already and is not a regular file.", "Give --out another name.")


def refuse_of_another(take: Take, file: str) -> None:
    """Check that what is recovered from a clip or a file of trajectories replaces neither what came from another one nor a re-simulation.

    A copied or moved file counts as the same.

    Raises:
        UsageError: it would be replaced.
    """
    for kind, of in _sources_of(take):
        if _another(file, of):
            raise UsageError(f"{take.path} is the take of another {kind}, {of}, not of {file}.", ELSEWHERE)
    if take.file("resimulation.json").exists() and not _recovered(take):
        raise UsageError(f"{take.path} holds a re-simulation{_of(take.source_of('resimulate', 'edit'))}, not a recovery.", ELSEWHERE)


def note_truth(take: Take, upstream: str, truth: str) -> None:
    """Note in a take that it was recovered from the file of trajectories `truth`; `upstream` is the stamp of what was read from it."""
    take.finish(TRUTH[0], upstream, {TRUTH[1]: truth})


def refuse_of_another_edit(take: Take, edit: Path) -> None:
    """Check that a re-simulation's folder is neither that of another edit nor the take of a recovery, its own source included.

    An edit that lies in the folder itself, as the panel's do, belongs to that folder.

    Raises:
        UsageError: it is.
    """
    if _recovered(take):
        of = next((of for _, of in _sources_of(take) if of), "")
        said = f"{take.path} is the take of a recovery{_of(of)}, not the folder of a re-simulation."
        raise UsageError(said, "Choose another folder with --take: a re-simulation has its own.")
    of = take.source_of("resimulate", "edit")
    if not edit.resolve().is_relative_to(take.path.resolve()) and _another(str(edit), of):
        raise UsageError(f"{take.path} holds the re-simulation of another edit, {of}, not of {edit}.", ELSEWHERE)


def _sources_of(take: Take) -> tuple[tuple[str, str], ...]:
    """What a take was recovered from, as (kind, file); the file is "" for a kind that the take does not name."""
    return (("clip", take.source_of("observe", "clip")), ("file of trajectories", take.source_of(*TRUTH)))


def _recovered(take: Take) -> bool:
    """Whether a folder is the take of a recovery, if only of one that has got no further than the observation."""
    return any(take.file(name).exists() for name in RECOVERED)


def _of(source: str) -> str:
    return f" of {source}" if source else ""


def _another(file: str, than: str) -> bool:
    """Whether `file` is another one than the file `than` that a take names ("" if none), and not a copy of it, nor that file moved."""
    if not than or os.path.realpath(file) == os.path.realpath(than):
        return False
    if os.path.isfile(file) and os.path.isfile(than):
        return not filecmp.cmp(file, than, shallow=False)
    return os.path.basename(file) != os.path.basename(than)


def _files(clip: str) -> list[Path]:
    """The files of a clip, which may be a single file."""
    return image_files(clip) if is_sequence(clip) else [Path(clip)]


def _is_made(home: Path, path: Path, made: str) -> bool:
    """Whether `path`, in the folder `home`, matches the pattern `made`, also on a file system that ignores case."""
    name = path.relative_to(home).as_posix()
    if re.fullmatch(made, name):
        return True
    small = home / name.lower()
    return re.fullmatch(made, name.lower()) is not None and small.exists() and os.path.samefile(small, path)
