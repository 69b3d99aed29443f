"""Where the takes of a scene are: beside the .blend file, moved with it, or in the temporary folder until the file is saved.

A scene stores the absolute path of the take that it shows, and the stamp of its field. With the path, the take is found again after the
project's folder has been moved or copied; the stamp reveals that another scene, another file or the command line has run Recover again into
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
from ...engine.conventions import EDIT, OF_SCENE
from ...engine.errors import TakeError
from ..clip.inputs.clip_files import is_another_film
from ..user_paths import absolute

NO_FIELD = "There is no recovered field."

NOT_RECOVERED = ""
"""In place of the digest of a recovery's settings, if there was no recovery: see `edit.resimulate.lone_wind`."""


def take_folder(settings: bpy.types.PropertyGroup) -> Path:
    """Where the results of Recover go: the user's choice, else CLIP.take beside the .blend file, or in the temporary folder while that is
    unsaved. By default, two scenes of a file never share a folder, nor do two clips of the same name."""
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
    """Refuse to write the recovery of a clip into the take of another clip, which would be lost.

    Raises:
        TakeError: when the folder is the take of another clip.
    """
    named = _of_another(folder, clip)
    if named:
        raise TakeError(
            f"{folder} is the take of another clip, {named}, not of {clip}.",
            "Choose another Take, or move that folder away if it is not needed.",
        )


def _of_another(folder: Path, clip: str) -> str:
    """The path of a take's clip if it is another one than `clip`; "" if it is the same, or the take does not say."""
    from ...engine.take import Take  # needs NumPy

    named = Take(folder).source_of("observe", "clip")
    return named if named and is_another_film(clip, named) else ""


def home_of(scene: bpy.types.Scene, name: str) -> Path:
    """Where the take goes for a wind of this name that has none: beside the .blend file, or in the temporary folder."""
    home = Path(bpy.data.filepath).parent if bpy.data.filepath else temporary() / _short(scene.name)
    return home / f"{_plain(name)}.{_plain(scene.name)}.take"


def edit_folder(settings: bpy.types.PropertyGroup, take: Path, preview: bool = False) -> Path:
    """Where the re-simulation of the scene's present edit, or its preview, goes: beside the take, and never into another scene's folder."""
    stem, edit, scene = take.name.removesuffix(".take"), (settings.edit_folder or "edit") + "_preview" * preview, settings.id_data
    others = [other.seeing_wind for other in bpy.data.scenes if other != scene]
    taken = {Path(name).name for other in others for each in (other, *other.edits) for name in (each.simulated_take, each.coarse_take)}
    name = f"{stem}.{edit}.take"
    folder = take.with_name(name if name not in taken else f"{stem}.{edit}.{_plain(scene.name)}.take")
    if _has_left(settings, take):
        settings.owner = ""
    # results of another file, a batch or the command line (which stores its edit elsewhere) are not overwritten
    every = (folder, *(folder.with_name(f"{folder.stem}.{k}.take") for k in range(2, 1000)))
    free = (each for each in every if each.name not in taken)
    mine = (each for each in free if _owner(each) == settings.owner or not any((each / name).is_file() for name in ("take.toml", EDIT)))
    return next(mine, folder)


def refuse_in_use(folder: Path) -> None:
    """Refuse to write to a take that a job of another Blender, with the same file open, is writing to: the engine would notice too late.

    Raises:
        TakeError: when another process is writing to it.
    """
    from ...engine.reading import read_json  # needs NumPy

    try:
        holder = read_json(folder / "take.lock")
        busy = holder["host"] == socket.gethostname() and int(holder["pid"]) != os.getpid() and systems.alive(int(holder["pid"]))
    except (OSError, ValueError, TypeError, KeyError):  # no lock, or none with a holder
        return
    if busy:
        raise TakeError(
            f"{folder.name} is in use: `{holder['verb']}` (process {holder['pid']}) has been writing to it since {holder['since']}.",
            "Wait until it has finished, or save this file under another name and duplicate the edit.",
        )


def refuse_read_only(folder: Path, hint: str) -> None:
    """Raise TakeError, with `hint`, if a folder cannot be written; called before anything is made for a job that writes there."""
    there = next(each for each in (folder, *folder.absolute().parents) if each.is_dir())
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise TakeError(f"{there} cannot be written: {error.strerror or error}.", hint) from error


def own(settings: bpy.types.PropertyGroup) -> str:
    """The line in an edit's file that identifies its scene, even if the .blend file is renamed or moved later."""
    settings.owner, settings.owner_file = settings.owner or uuid.uuid4().hex, bpy.data.filepath
    return f"{OF_SCENE}{settings.owner}"


def _has_left(settings: bpy.types.PropertyGroup, take: Path) -> bool:
    """Whether the scene's file was saved under another name after it wrote an edit beside this take, and the former file, which owns that
    edit, still exists. (A copied project has a take of its own.)"""
    former = settings.owner_file
    stays = bool(former) and os.path.isfile(former) and Path(settings.recovered_take) == take
    return stays and os.path.realpath(former) != os.path.realpath(bpy.data.filepath)


def _owner(folder: Path) -> str | None:
    """Identifier of the scene to which the edit in a folder belongs; None if there is no edit, or another program wrote it."""
    try:
        with open(folder / EDIT, encoding="utf-8", errors="replace") as file:
            first = file.readline()
    except OSError:
        return None
    return first.removeprefix(OF_SCENE).strip() if first.startswith(OF_SCENE) else None


def stamp_of(folder: Path, stage: str = "recover") -> str:
    """The stamp of the run of a stage that made a take's field ("recover") or motion ("resimulate"); "" if the take does not say.

    Raises:
        TakeError: when its description is damaged.
    """
    from ...engine.take import Take
    return str(Take(folder).description().get("stages", {}).get(stage, {}).get("stamp", ""))


def show(settings: bpy.types.PropertyGroup, folder: Path, digest: str) -> None:
    """Store that the scene shows the field of `folder`, which was made with the settings of `digest`."""
    settings.recovered_take, settings.recovered_digest, settings.recovered_stamp = str(folder), digest, stamp_of(folder)
    settings.started_take = str(folder)


def is_shown(settings: bpy.types.PropertyGroup, folder: Path) -> bool:
    """Whether the scene shows the field that is in `folder` now."""
    return bool(settings.recovered_take) and shown(settings) == folder and settings.recovered_stamp == stamp_of(folder)


def shown(settings: bpy.types.PropertyGroup) -> Path:
    """The present folder of the take that the scene shows. Whether it exists is not checked.

    Raises:
        TakeError: when the scene shows no take.
    """
    if not settings.recovered_take:
        raise TakeError(NO_FIELD, "Run Recover first, or load the results of a take.")
    return _moved(settings.recovered_take, settings.recovered_stamp)


def gone(folder: Path) -> tuple[str, str]:
    """Message and hint for a take whose folder does not exist, or is a file."""
    if folder.exists():
        return f"{folder} is a file, not a folder.", "Choose the folder of a take."
    return f"There is no folder {folder}.", "Put it beside the .blend file, or run Recover again."


def shows_lone(settings: bpy.types.PropertyGroup) -> bool:
    """Whether the scene shows the wind of an object that came without a take, instead of a recovery of its own. This is stored in the file,
    as the take of such a wind is made anew whenever needed, and may be gone."""
    return bool(settings.recovered_take) and settings.recovered_digest == NOT_RECOVERED


def recovered(settings: bpy.types.PropertyGroup) -> Path:
    """As `shown`, for work that needs exactly the field that the scene shows.

    Raises:
        TakeError: also when the folder is gone, or holds another field now.
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
    """The folder of the last re-simulation, or of the last preview, beside the take.

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
    """Before a recovery into `folder`: if the file was saved since an unfinished recovery, copy what that left in the temporary folder, so
    that it is continued. The take of a lone wind is not copied.

    Raises:
        OSError: when copying fails.
    """
    former = Path(settings.started_take) if settings.started_take else None
    lone = shows_lone(settings) and settings.started_take == settings.recovered_take
    if former is not None and not lone and former != folder and is_temporary(former) and former.is_dir() and not folder.exists():
        copy(former, folder)
    settings.started_take = str(folder)


def _moved(stored: str, stamp: str) -> Path:
    """The present place of a folder that was at `stored`: beside the .blend file, if moved or copied along with it, else `stored`."""
    former = Path(stored)
    if not bpy.data.filepath:
        return former
    home = Path(bpy.data.filepath).parent
    if former.is_dir() and former.is_relative_to(home) and (not stamp or _is_of(former, stamp)):
        return former  # inside the project, so it takes precedence over folders beside the project
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
    """A temporary folder for this user alone, as the system's may be shared by all users."""
    return Path(tempfile.gettempdir()) / (f"seeing_wind-{os.getuid()}" if hasattr(os, "getuid") else "seeing_wind")


def is_temporary(folder: Path) -> bool:
    """Whether a folder is where takes go until their file is saved."""
    return temporary() in folder.parents


def _plain(name: str) -> str:
    """A name made suitable as a part of a folder's name."""
    return re.sub(r"[^\w-]+", "_", name)


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def copy(former: Path, folder: Path) -> None:
    """Copy a take under a temporary name, then rename it; take.toml first, so that no stamp is newer than its files."""
    aside = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        aside.mkdir(parents=True)
        if (former / "take.toml").is_file():
            shutil.copy2(former / "take.toml", aside)
        shutil.copytree(former, aside, dirs_exist_ok=True, ignore=shutil.ignore_patterns("take.toml", ".*.part*"))
        systems.replace(aside, folder)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
