"""Where the takes of a scene are: beside the .blend file, moved with it, or in the temporary folder until the file is saved.

A scene notes the absolute path of the take that it shows, and the stamp of its field. The path finds the take again after the project's
folder has been moved or copied; the stamp tells when somebody else (another scene, another file, the command line) has recovered anew into
the same folder, so that an edit is never simulated in a field that the scene does not show.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import socket
import tempfile
import uuid
from pathlib import Path

import bpy

from ...engine import systems
from ...engine.errors import TakeError
from ..clip.inputs.clip_files import is_another_film
from ..user_paths import absolute

EDIT = "edit.toml"
"""An edit of the panel stands in the folder of its own re-simulation."""

INPUTS = "blender_inputs"
"""Folder in the take of the files that are made from the scene."""

NO_FIELD = "There is no recovered field."

NOT_RECOVERED = ""
"""In place of the digest of a recovery's settings: there was none, see `edit.resimulate.lone_wind`."""


def take_folder(settings: bpy.types.PropertyGroup) -> Path:
    """Where the results of Recover go: the user's choice, else CLIP.take beside the .blend file, or in the temporary folder while it is
    unsaved. By default, two scenes of one file never get the same folder, nor does a clip that of another one of its name."""
    if settings.take:
        return Path(absolute(settings.take))
    stem = re.sub(r"[^\w.-]+", "_", Path(bpy.path.abspath(settings.clip)).stem) or "clip"
    clips = Path(absolute(settings.clip)).parent
    home = Path(bpy.data.filepath).parent if bpy.data.filepath else temporary() / _short(str(clips))
    scene, own = settings.id_data, Path(settings.started_take).name
    taken = {Path(other.seeing_wind.started_take).name for other in bpy.data.scenes if other != scene}
    names = [own] if re.fullmatch(rf"{re.escape(stem)}(\.[^.]+)?\.take", own) else []
    names.append(f"{stem}.{_plain(scene.name)}.take" if f"{stem}.take" in taken else f"{stem}.take")
    free = (home / name for name in (*names, *(f"{stem}.{k}.take" for k in range(2, 1000))) if name not in taken)
    return next((each for each in free if not (settings.clip and _of_another(each, absolute(settings.clip)))), home / names[0])


def refuse_of_another(folder: Path, clip: str) -> None:
    """Refuse to write the recovery of a clip into a take that is another clip's, which would be lost.

    Raises:
        TakeError: then.
    """
    named = _of_another(folder, clip)
    if named:
        raise TakeError(
            f"{folder} is the take of another clip, {named}, and not of {clip}.",
            "Choose another Take, or move that folder away if it is not needed.",
        )


def _of_another(folder: Path, clip: str) -> str:
    """The path of the clip that a take is of, where that is another one; "" where it is not, or the take does not say."""
    from ...engine.take import Take  # needs NumPy

    named = Take(folder).source_of("observe", "clip")
    return named if named and is_another_film(clip, named) else ""


def home_of(scene: bpy.types.Scene, name: str) -> Path:
    """Where the take of a wind of that name goes that came into a scene without one: beside the .blend file, or in the temporary folder."""
    home = Path(bpy.data.filepath).parent if bpy.data.filepath else temporary() / _short(scene.name)
    return home / f"{_plain(name)}.{_plain(scene.name)}.take"


def edit_folder(settings: bpy.types.PropertyGroup, take: Path, preview: bool = False) -> Path:
    """Where the re-simulation of the scene's present edit goes, or its preview: beside the take, and not where another scene's is."""
    stem, edit, scene = take.name.removesuffix(".take"), (settings.edit_folder or "edit") + "_preview" * preview, settings.id_data
    others = [other.seeing_wind for other in bpy.data.scenes if other != scene]
    taken = {Path(name).name for other in others for each in (other, *other.edits) for name in (each.simulated_take, each.coarse_take)}
    name = f"{stem}.{edit}.take"
    folder = take.with_name(name if name not in taken else f"{stem}.{edit}.{_plain(scene.name)}.take")
    if _has_left(settings, take):
        settings.owner = ""
    # what another file, a batch or the command line (which keeps its edit elsewhere) simulates stays as it is
    every = (folder, *(folder.with_name(f"{folder.stem}.{k}.take") for k in range(2, 1000)))
    free = (each for each in every if each.name not in taken)
    mine = (each for each in free if _owner(each) == settings.owner or not any((each / name).is_file() for name in ("take.toml", EDIT)))
    return next(mine, folder)


def refuse_in_use(folder: Path) -> None:
    """Refuse to write to a take that a job of another Blender, with the same file open, is writing to: the engine would come too late.

    Raises:
        TakeError: then.
    """
    from ...engine.reading import read_json  # needs NumPy

    try:
        holder = read_json(folder / "take.lock")
        busy = holder["host"] == socket.gethostname() and int(holder["pid"]) != os.getpid() and systems.alive(int(holder["pid"]))
    except (OSError, ValueError, TypeError, KeyError):  # nobody has signed it
        return
    if busy:
        raise TakeError(
            f"{folder.name} is in use: `{holder['verb']}` (process {holder['pid']}) has been writing to it since {holder['since']}.",
            "Wait until it has finished, or save this file under another name and duplicate the edit.",
        )


def refuse_read_only(folder: Path, hint: str) -> None:
    """Refuse to begin what writes into a folder that cannot be written, before anything is made for it: TakeError, with `hint`."""
    there = next(each for each in (folder, *folder.absolute().parents) if each.is_dir())
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise TakeError(f"{there} cannot be written: {error.strerror or error}.", hint) from error


def own(settings: bpy.types.PropertyGroup) -> str:
    """The line by which an edit's file says of which scene it is, also when its .blend file is renamed or moved later."""
    settings.owner, settings.owner_file = settings.owner or uuid.uuid4().hex, bpy.data.filepath
    return f"# scene {settings.owner}"


def _has_left(settings: bpy.types.PropertyGroup, take: Path) -> bool:
    """Whether the scene's file was saved under another name since it wrote an edit beside this take, and the former file, whose edit that
    is, is there still. A project that was copied has a take of its own."""
    former = settings.owner_file
    stays = bool(former) and os.path.isfile(former) and Path(settings.recovered_take) == take
    return stays and os.path.realpath(former) != os.path.realpath(bpy.data.filepath)


def _owner(folder: Path) -> str | None:
    """Of which scene the edit in a folder is; None where there is none, or it was written by another program."""
    try:
        with open(folder / EDIT, encoding="utf-8", errors="replace") as file:
            first = file.readline()
    except OSError:
        return None
    return first.removeprefix("# scene ").strip() if first.startswith("# scene ") else None


def stamp_of(folder: Path, stage: str = "recover") -> str:
    """Which run of a stage the results in a take come from, its field or its motion ("resimulate"); "" for a take that does not say.

    Raises:
        TakeError: when its description is damaged.
    """
    from ...engine.take import Take
    return str(Take(folder).description().get("stages", {}).get(stage, {}).get("stamp", ""))


def show(settings: bpy.types.PropertyGroup, folder: Path, digest: str) -> None:
    """Note that the scene shows the field of `folder`, which was made with the settings of that digest."""
    settings.recovered_take, settings.recovered_digest, settings.recovered_stamp = str(folder), digest, stamp_of(folder)
    settings.started_take = str(folder)


def is_shown(settings: bpy.types.PropertyGroup, folder: Path) -> bool:
    """Whether the scene shows the field that is in `folder` now."""
    return bool(settings.recovered_take) and shown(settings) == folder and settings.recovered_stamp == stamp_of(folder)


def shown(settings: bpy.types.PropertyGroup) -> Path:
    """The folder of the take that the scene shows, where it is now. Whether it is there at all is not looked at.

    Raises:
        TakeError: when the scene shows none.
    """
    if not settings.recovered_take:
        raise TakeError(NO_FIELD, "Run Recover first, or load the results of a take.")
    return _moved(settings.recovered_take, settings.recovered_stamp)


def gone(folder: Path) -> tuple[str, str]:
    """What to say of a take that is not there, and what to do."""
    return f"There is no folder {folder}.", "Put it beside the .blend file, or run Recover again."


def shows_lone(settings: bpy.types.PropertyGroup) -> bool:
    """Whether what the scene shows is no recovery of its own, but the wind of an object that came without a take. The file itself says so:
    the take of such a wind is made anew whenever it is needed, and may be gone."""
    return bool(settings.recovered_take) and settings.recovered_digest == NOT_RECOVERED


def recovered(settings: bpy.types.PropertyGroup) -> Path:
    """As `shown`, for work that needs the very field that the scene shows.

    Raises:
        TakeError: also when the folder is gone, or holds another field by now.
    """
    folder = shown(settings)
    if not folder.is_dir():
        raise TakeError(*gone(folder))
    if settings.recovered_stamp and stamp_of(folder) != settings.recovered_stamp:
        raise TakeError(
            f"{folder} has been recovered again since this scene loaded it.",
            "Press Reload to load what it holds now, or choose another Take and run Recover again.",
        )
    return folder


def simulated(settings: bpy.types.PropertyGroup, preview: bool = False) -> Path:
    """The folder of the last re-simulation, or of the last preview, which stands beside the take.

    Raises:
        TakeError: when nothing is simulated yet.
    """
    noted = settings.coarse_take if preview else settings.simulated_take
    if not noted:
        raise TakeError("Nothing is simulated yet.", "Run Re-simulate first.")
    former = Path(noted)
    if settings.recovered_take and former.parent == Path(settings.recovered_take).parent:
        return shown(settings).with_name(former.name)
    return _moved(noted, "")


def bring_along(settings: bpy.types.PropertyGroup, folder: Path) -> None:
    """Before a recovery into `folder`: what an unfinished one left in the temporary folder goes on there, when the file was saved since.
    What a lone wind left is none of it.

    Raises:
        OSError: when it cannot be copied.
    """
    former = Path(settings.started_take) if settings.started_take else None
    lone = shows_lone(settings) and settings.started_take == settings.recovered_take
    if former is not None and not lone and former != folder and is_temporary(former) and former.is_dir() and not folder.exists():
        copy(former, folder)
    settings.started_take = str(folder)


def _moved(stored: str, stamp: str) -> Path:
    """A folder that was at `stored`: beside the .blend file, with which it was moved or copied, else still there."""
    former = Path(stored)
    if not bpy.data.filepath:
        return former
    home = Path(bpy.data.filepath).parent
    if former.is_dir() and former.is_relative_to(home) and (not stamp or _is_of(former, stamp)):
        return former  # the project's own, whatever is beside the project
    for count in range(1, min(4, len(former.parts))):
        for start in (home, home.parent):
            candidate = start.joinpath(*former.parts[-count:])
            if candidate != former and candidate.is_dir() and (_is_of(candidate, stamp) if stamp else not former.is_dir()):
                return candidate
    return former


def _is_of(folder: Path, stamp: str) -> bool:
    with contextlib.suppress(TakeError):
        return stamp_of(folder) == stamp
    return False


def temporary() -> Path:
    """A folder of this user's own: the system's temporary folder may be everybody's."""
    return Path(tempfile.gettempdir()) / (f"seeing_wind-{os.getuid()}" if hasattr(os, "getuid") else "seeing_wind")


def is_temporary(folder: Path) -> bool:
    """Whether a folder is where takes go until their file is saved."""
    return temporary() in folder.parents


def _plain(name: str) -> str:
    """A scene's name as a part of a folder's."""
    return re.sub(r"[^\w-]+", "_", name)


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def copy(former: Path, folder: Path) -> None:
    """Copy a take, aside and renamed; take.toml first, so that no stamp is newer than its files."""
    aside = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        aside.mkdir(parents=True)
        if (former / "take.toml").is_file():
            shutil.copy2(former / "take.toml", aside)
        shutil.copytree(former, aside, dirs_exist_ok=True, ignore=shutil.ignore_patterns("take.toml", ".*.part*"))
        systems.replace(aside, folder)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
