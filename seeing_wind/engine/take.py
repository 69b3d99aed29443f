"""A take: the folder on disk that holds all that is known about one clip.

Every file is written under a temporary name, synced and renamed, so a crash or a full disk never leaves half a file; a stage's stamp (the
hash of its inputs and settings) is written last, so a stage is done only if its stamp matches. Nothing in a take can execute code: NPZ
without pickle, safetensors, TOML, JSON, PLY, PNG, MP4.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import hashlib
import io
import json
import os
import re
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from . import systems
from .conventions import in_the_way
from .errors import NO_PATH, TakeError, UsageError, WrongTake
from .progress import Progress
from .reading import LARGEST_TAKE, read_arrays, read_json, read_toml
from .settings import toml_text

R = TypeVar("R")

BLOCK = 2**24
"""Bytes of a file that are read and hashed at a time."""

FORMAT = 1
"""Version of the take's layout."""

VERSION = 40
"""Part of every stamp: raise it when a stage's results change, so that old takes are redone."""

LEVEL = 3
"""Compression level of arrays: frames take 0.4 of the time of zlib's default level, 6, and a ninth more space."""

RESULTS = re.compile(
    r"take\.(toml|lock)|(observation|view\d+|particles|lifted|trajectory|solve)\.npz|(field|fitted|wind|checkpoint\..*)\.safetensors"
    r"|(wind|report|preview|resimulation)\.json|gaussians\.ply|(report|preview|held)\.png|(overlay|preview|resimulated)\.mp4"
)
"""Names of the files that the stages write into a take."""

LONGEST_NAME = 80
"""Characters of a path that are kept free, after the take's folder, for the names of its files, temporary ones included."""


class Take:
    """The folder `path`, made when first written to."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def file(self, name: str) -> Path:
        """Path of a file in the take."""
        return self.path / name

    def prepare(self) -> None:
        """Make the folder and check that it can be written to, before hours of work depend on it.

        Raises:
            TakeError: it cannot be written to. WrongTake: the path is invalid. UsageError: as `refuse_file`.
        """
        if systems.too_long(self.path, LONGEST_NAME):
            raise TakeError(
                f"The path of the take is too long for this Windows: {self.path.absolute()}.",
                "Choose a folder with a shorter path, or switch long paths on in Windows.",
            )
        self.refuse_file()
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.path):
                pass
        except OSError as error:
            kind = WrongTake if error.errno in NO_PATH else TakeError
            raise kind(f"{self.path} cannot be written: {error.strerror or error}.", "Choose another folder with --take.") from error

    def refuse_file(self) -> None:
        """Raise UsageError if there is a file, or anything else but a folder, in the folder's place or on the way to it."""
        other = in_the_way(self.path)
        if other is not None:
            where = "" if other == self.path else f", so {self.path} cannot be made"
            raise UsageError(f"{other} is there already and is not a folder{where}.", "Choose another folder with --take.")

    def clear_leftovers(self) -> None:
        """Remove unfinished files of processes that no longer run."""
        for path in [*self.path.glob(".*.part*"), *self.path.glob("*/.*.part*")]:
            found = re.fullmatch(r"\..*\.(\d+)\.part(\..*)?", path.name)
            if found and path.is_file() and (int(found[1]) == os.getpid() or not systems.alive(int(found[1]))):
                with contextlib.suppress(OSError):
                    path.unlink()

    @contextlib.contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """Path of a temporary file in the same folder, which replaces the take's file only when the block ends without an error.

        The temporary file keeps the suffix (writers such as FFmpeg choose the format by it). A link to a file is itself replaced.

        Raises:
            TakeError: the folder cannot be written to, or the disk is full. WrongTake: the path is invalid, or is taken by something other
                than a file (a folder, a device, a pipe), which is left untouched.
        """
        target = self.file(name)
        aside = target.with_name(f".{target.stem}.{os.getpid()}.part{target.suffix}")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            if target.exists() and not target.is_file():
                # a rename would put a file in the place of /dev/null
                raise WrongTake(f"Cannot write {target}: it is there already and is not a regular file.", "Choose another path.")
            yield aside
            with open(aside, "rb+") as handle:
                os.fsync(handle.fileno())
            systems.replace(aside, target)
        except OSError as error:
            reason = error.strerror or str(error)
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            hint = "Free some space or choose another folder" if full else "Choose another folder"
            if systems.windows() and isinstance(error, PermissionError):
                hint = "Close the programs that have it open, or choose another folder"
            kind = WrongTake if error.errno in NO_PATH else TakeError
            raise kind(f"Cannot write {target}: {reason}.", f"{hint}; the last good files are kept.") from error
        finally:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)

    def write_json(self, name: str, values: dict[str, Any]) -> None:
        """Write a JSON file. Numbers that are not finite are refused (ValueError), as other programs could not read them."""
        with self.writing(name) as path:
            path.write_text(json_text(values), encoding="utf-8")

    def read_json(self, name: str) -> dict[str, Any]:
        """Read a JSON file of the take. Raises WrongTake when it is missing, unreadable, or not a mapping."""
        try:
            values = read_json(self.file(name))
            if not isinstance(values, dict):
                raise ValueError("it is not a mapping")
        except (OSError, ValueError) as error:
            hint = f"Run `recover` for this take {'again' if self.file(name).exists() else 'first'}."
            raise WrongTake(f"{self.file(name)} cannot be read: {_reason(error)}.", hint) from error
        return values

    def write_arrays(self, name: str, arrays: dict[str, np.ndarray]) -> None:
        """Write a compressed NPZ; object arrays are refused (they would need pickle)."""
        content = npz(name, arrays)
        with self.writing(name) as path:
            path.write_bytes(content)

    def read_arrays(self, name: str) -> dict[str, np.ndarray]:
        """Read an NPZ of the take without pickle. Raises WrongTake when it is missing or damaged."""
        try:
            return read_arrays(self.file(name), limit=LARGEST_TAKE)
        except (OSError, ValueError) as error:
            hint = f"Run `recover` for this take {'again' if self.file(name).exists() else 'first'}."
            raise WrongTake(f"{self.file(name)} cannot be read: {_reason(error)}.", hint) from error

    # -- stamps ---------------------------------------------------------------------------------------------------------------

    def description(self) -> dict[str, Any]:
        """take.toml as a mapping; empty for a take that does not exist yet.

        Raises:
            WrongTake: it cannot be read, has another format, or its stages are not tables.
        """
        path = self.file("take.toml")
        if not path.exists():
            return {}
        try:
            values = read_toml(path)
            found = values.get("format", FORMAT)
            if type(found) is int and found > FORMAT:
                raise WrongTake(
                    f"{path} cannot be read: its format is {found}, of a newer version of Seeing Wind, and this one reads format {FORMAT}.",
                    "Update Seeing Wind, or choose another folder.",
                )
            if type(found) is not int or found != FORMAT:
                raise ValueError(f"its format is {found!r}, and there is only {FORMAT}")
            stages = values.get("stages", {})
            if not isinstance(stages, dict) or not all(isinstance(stage, dict) for stage in stages.values()):
                raise ValueError("its stages are not tables")
            if not all(isinstance(stage.get("settings", {}), dict) for stage in stages.values()):
                raise ValueError("its stages' settings are not tables")
        except (OSError, ValueError) as error:
            hint = "Remove it to start the take afresh; the other files are kept."
            raise WrongTake(f"{path} cannot be read: {_reason(error)}.", hint) from error
        return values

    def source_of(self, stage: str, key: str) -> str:
        """The file that a finished stage was given as `key`, such as the clip of *observe*; "" where the take does not name one.

        It is "" also for a take that cannot be read: the stage that reads the take reports that.
        """
        try:
            named = self.description().get("stages", {}).get(stage, {}).get("settings", {}).get(key)
        except TakeError:
            return ""
        return named if isinstance(named, str) and "\0" not in named else ""

    def is_done(self, stage: str, stamp: str) -> bool:
        """Whether `stage` was finished with exactly these inputs and settings."""
        return self.description().get("stages", {}).get(stage, {}).get("stamp") == stamp

    def kept(self, stage: str, stamp: str, read: Callable[[], R], progress: Progress, told: str = "") -> R | None:
        """What `read` returns of a `stage` done earlier; None if it was not finished, its inputs have changed, or its files are damaged.

        `told`: the stage's name in `progress`, if it differs.
        """
        if not self.is_done(stage, stamp):
            return None
        progress.begin(told or stage, "already done")
        try:
            return read()
        except TakeError as error:
            progress.warn(f"The stage {stage} is done again: {error.message}")
            return None

    def finish(self, stage: str, stamp: str, settings: dict[str, Any]) -> None:
        """Write the stamp and settings of a finished stage, after all its files. Stamps of later stages stay: they hash their inputs."""
        with self.finishing(stage, stamp, settings):
            pass

    @contextlib.contextmanager
    def finishing(self, stage: str, stamp: str, settings: dict[str, Any]) -> Iterator[None]:
        """`finish` when the block ends without an error; the text is written aside before the block begins, so a full disk shows first."""
        description = self.description()
        description["format"] = FORMAT
        description.setdefault("stages", {})[stage] = {"stamp": stamp, "settings": settings}
        with self.writing("take.toml") as path:
            path.write_text(toml_text(description), encoding="utf-8")
            yield

    def withdraw(self, stage: str) -> None:
        """Clear a stage's stamp before its files are replaced, so that a job that ends in between does not leave a stamp on mixed files."""
        description = self.description()
        if stage in description.get("stages", {}):
            description["stages"][stage]["stamp"] = ""
            with self.writing("take.toml") as path:
                path.write_text(toml_text(description), encoding="utf-8")


def _reason(error: OSError | ValueError) -> str:
    """The text of an error of a file, without the path."""
    return str(getattr(error, "strerror", None) or error)


def json_text(values: dict[str, Any]) -> str:
    """Indented JSON. Raises ValueError for numbers that are not finite."""
    return json.dumps(values, indent=2, allow_nan=False) + "\n"


def npz(name: str, arrays: dict[str, np.ndarray]) -> bytes:
    """A compressed NPZ in memory (one written to a full disk fails again when it is closed). TypeError for object arrays names `name`."""
    for key, array in arrays.items():
        if np.asarray(array).dtype == object:
            raise TypeError(f"{name}: {key} is an object array")
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as archive:
        for key, array in arrays.items():
            with archive.open(f"{key}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asarray(array), allow_pickle=False)
    return content.getvalue()


def stamp_of(*parts: Any) -> str:
    """Hash of settings, strings, other stamps and files (of an existing file at a `Path`, its content): 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, Path):
            if part.is_file():
                with open(part, "rb") as handle:
                    while block := handle.read(BLOCK):
                        digest.update(block)
            else:
                digest.update(str(part).encode(errors="surrogateescape"))
        elif isinstance(part, np.ndarray):
            digest.update(str((part.shape, part.dtype)).encode() + np.ascontiguousarray(part).tobytes())
        elif dataclasses.is_dataclass(part) and not isinstance(part, type):
            digest.update(stamp_of(*(getattr(part, field.name) for field in dataclasses.fields(part))).encode())
        else:
            digest.update(repr(part).encode())
        digest.update(b"\0")
    return digest.hexdigest()[:16]
