"""A take: the folder on disk that holds all that is known about one clip.

Every file is written aside, synced and renamed, so a crash or a full disk never leaves half a file; a stage's stamp (the hash of its
inputs and settings) is written last, so a stage is done only if its stamp matches. Nothing in a take can execute code: NPZ without
pickle, safetensors, TOML, JSON, PLY, PNG, MP4.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import hashlib
import json
import os
import re
import tempfile
import tomllib
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from .errors import TakeError

R = TypeVar("R")

DAMAGED = (OSError, ValueError, TypeError, AttributeError, EOFError, NotImplementedError, zipfile.BadZipFile, zlib.error)
"""What `np.load` without pickle and the use of its result as an archive raise for a file that is empty, cut, garbled or something else."""

FORMAT = 1
"""Version of the take's layout."""


class Take:
    """The folder `path`, made when first written to."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def file(self, name: str) -> Path:
        """Path of a file in the take."""
        return self.path / name

    def prepare(self) -> None:
        """Make the folder and see that it can be written, before hours of work are to be kept in it.

        Raises:
            TakeError: when it cannot.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.path):
                pass
        except OSError as error:
            raise TakeError(f"{self.path} cannot be written: {error.strerror or error}.", "Choose another folder with --take.") from error

    @contextlib.contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """Write a file of the take through a neighbour that takes its place only when the block ends without an error.

        The neighbour keeps the file's suffix (writers such as FFmpeg choose the format by it).

        Raises:
            TakeError: when the folder cannot be written or the disk is full; the former file is untouched.
        """
        target = self.file(name)
        aside = target.with_name(f".{target.stem}.{os.getpid()}.part{target.suffix}")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            yield aside
            with open(aside, "rb+") as handle:
                os.fsync(handle.fileno())
            os.replace(aside, target)
        except OSError as error:
            reason = error.strerror or str(error)
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            hint = "Free some space or choose another folder" if full else "Choose another folder"
            raise TakeError(f"Cannot write {target}: {reason}.", f"{hint}; the last good files are kept.") from error
        finally:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)

    def write_json(self, name: str, values: dict[str, Any]) -> None:
        """Write a JSON file; non-finite numbers are refused, as other readers would be."""
        with self.writing(name) as path:
            path.write_text(json.dumps(values, indent=2, allow_nan=False) + "\n", encoding="utf-8")

    def read_json(self, name: str) -> dict[str, Any]:
        """Read a JSON file of the take. Raises TakeError when it is missing or unreadable."""
        try:
            return json.loads(self.file(name).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise TakeError(f"{self.file(name)} cannot be read: {error}.", "Run `recover` for this take first.") from error

    def write_arrays(self, name: str, arrays: dict[str, np.ndarray]) -> None:
        """Write a compressed NPZ; object arrays are refused (they would need pickle)."""
        for key, array in arrays.items():
            if np.asarray(array).dtype == object:
                raise TypeError(f"{name}: {key} is an object array")
        with self.writing(name) as path, open(path, "wb") as handle:
            np.savez_compressed(handle, **arrays)  # type: ignore[arg-type]

    def read_arrays(self, name: str) -> dict[str, np.ndarray]:
        """Read an NPZ of the take without pickle. Raises TakeError when it is missing or damaged."""
        try:
            with np.load(self.file(name), allow_pickle=False) as data:
                return {key: data[key] for key in data.files}
        except DAMAGED as error:
            raise TakeError(f"{self.file(name)} cannot be read: {error}.", "Run `recover` for this take first.") from error

    # -- stamps ---------------------------------------------------------------------------------------------------------------

    def description(self) -> dict[str, Any]:
        """take.toml as a mapping; empty for a take that is not there yet."""
        path = self.file("take.toml")
        if not path.exists():
            return {}
        try:
            return tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise TakeError(f"{path} cannot be read: {error}.", "Remove it to start the take afresh; the other files are kept.") from error

    def is_done(self, stage: str, stamp: str) -> bool:
        """Whether `stage` was finished with exactly these inputs and settings."""
        return self.description().get("stages", {}).get(stage, {}).get("stamp") == stamp

    def finish(self, stage: str, stamp: str, settings: dict[str, Any]) -> None:
        """Write the stamp of a finished stage and its settings, last of all. Stamps of later stages stay: their inputs are in them."""
        description = self.description()
        description["format"] = FORMAT
        description.setdefault("stages", {})[stage] = {"stamp": stamp, "settings": settings}
        with self.writing("take.toml") as path:
            path.write_text(toml_text(description), encoding="utf-8")


def stamp_of(*parts: Any) -> str:
    """Hash of settings, strings, other stamps and files (a `Path` counts with its content): 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, Path):
            digest.update(part.read_bytes() if part.is_file() else str(part).encode())
        elif isinstance(part, np.ndarray):
            digest.update(str((part.shape, part.dtype)).encode() + np.ascontiguousarray(part).tobytes())
        elif dataclasses.is_dataclass(part) and not isinstance(part, type):
            digest.update(stamp_of(*(getattr(part, field.name) for field in dataclasses.fields(part))).encode())
        else:
            digest.update(repr(part).encode())
        digest.update(b"\0")
    return digest.hexdigest()[:16]


# -- records as arrays --------------------------------------------------------------------------------------------------------


def to_arrays(record: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """A record (see `records`) as flat named arrays, nested records joined with dots, None and lists of strings as JSON."""
    arrays: dict[str, np.ndarray] = {}
    for field in dataclasses.fields(record):
        value, key = getattr(record, field.name), prefix + field.name
        if dataclasses.is_dataclass(value):
            arrays.update(to_arrays(value, key + "."))
        elif isinstance(value, np.ndarray):
            arrays[key] = value
        else:
            arrays[key] = np.array(json.dumps(value))
    return arrays


def from_arrays(cls: type[R], arrays: dict[str, np.ndarray], prefix: str = "") -> R:
    """The inverse of `to_arrays`.

    Raises:
        TakeError: when a field is missing (a take of another version).
    """
    hints: dict[str, Any] = get_type_hints(cls)
    values: dict[str, Any] = {}
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]
        key, kind = prefix + field.name, hints[field.name]
        if dataclasses.is_dataclass(kind):
            values[field.name] = from_arrays(kind, arrays, key + ".")  # type: ignore[arg-type]
        elif key not in arrays and field.default is not dataclasses.MISSING:
            continue  # a take from before the field was there
        elif key not in arrays:
            raise TakeError(f"The take lacks {key}.", "It was written by another version: run `recover` again.")
        elif kind is np.ndarray or (np.ndarray in get_args(kind) and arrays[key].dtype.kind != "U"):  # None is JSON
            values[field.name] = arrays[key]
        else:
            value = json.loads(str(arrays[key]))
            value = tuple(value) if get_origin(kind) is tuple else value
            values[field.name] = kind(value) if isinstance(kind, type) and issubclass(kind, str) else value
    return cls(**values)


def toml_text(values: dict[str, Any]) -> str:
    """Plain values, lists, nested tables and lists of tables as TOML text (the standard library reads TOML but does not write it).

    Raises:
        TypeError: for a value that TOML does not have.
    """
    return "\n\n".join(_toml_blocks(values, "", ())) + "\n"


def _toml_blocks(values: dict[str, Any], header: str, path: tuple[str, ...]) -> list[str]:
    """One block of text per table, the table's own values first (TOML allows them nowhere else)."""
    lines, nested = [], []
    for key, value in values.items():
        inner = (*path, key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key))
        if isinstance(value, dict):
            nested += _toml_blocks(value, f"[{'.'.join(inner)}]", inner)
        elif isinstance(value, (list, tuple)) and value and all(isinstance(item, dict) for item in value):
            for item in value:
                nested += _toml_blocks(item, f"[[{'.'.join(inner)}]]", inner)
        else:
            lines.append(f"{inner[-1]} = {_toml_value(value)}")
    # a table without values of its own needs no header, unless it is empty or one of a list
    if header and (lines or not nested or header.startswith("[[")):
        lines.insert(0, header)
    return (["\n".join(lines)] if lines else []) + nested


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    raise TypeError(f"no TOML for {type(value).__name__}")
