"""The TOML files that a user writes: tables in lists, such as the bodies of an edit and the jobs of a batch."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ..errors import UsageError
from ..reading import EmptyFile, read_toml
from .edit import MESHES, BodyEdit, ColliderEdit, Edit, FieldEdit
from .mapping import from_mapping, shown
from .option import options_of

LONGEST_NAME = 200
"""Bytes of a body's name, at most: most file systems allow 255, and the file has an ending, and a longer name while it is written."""

RESERVED = frozenset(["CON", "PRN", "AUX", "NUL", *(f"{port}{number}" for port in ("COM", "LPT") for number in range(10))])
"""Names that Windows reserves for devices."""


def read_users_toml(path: str | os.PathLike[str], what: str) -> dict[str, Any]:
    """The values of a TOML file; `what` names it in messages.

    Raises:
        UsageError: the file does not exist, or is not TOML.
    """
    try:
        return read_toml(path)
    except OSError as error:
        raise UsageError(f"{what} {path} cannot be read: {error.strerror or error}.", "Give the path of a TOML file.") from error
    except EmptyFile as error:
        raise UsageError(f"{what} {path} cannot be read: {error}.", "Write it, or give the path of another TOML file.") from error
    except ValueError as error:
        raise UsageError(f"{what} {path} is not valid TOML: {error}.", "Correct that line.") from error


def tables_of(values: dict[str, Any], key: str, where: str, hint: str, least: int = 1) -> list[dict[str, Any]]:
    """Take the list of tables `[[key]]` out of the values of a file. Raises UsageError if there is none, or something else in its place."""
    tables = values.pop(key, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise UsageError(f"{where}: {key} is {shown(tables)}, not a list of [[{key}]].", hint)
    if len(tables) < least:
        only = f", only {', '.join(values)}" if values else ""
        raise UsageError(f"{where} has no [[{key}]]{only}.", hint)
    return tables


def read_edit(path: str | os.PathLike[str]) -> Edit:
    """Read EDIT.toml.

    Raises:
        UsageError: a file that does not exist or is not TOML, an unknown or missing key, a value out of its range, two bodies with the
            same name, no body, or a mesh of another format than `MESHES`.
    """
    values, where = read_users_toml(path, "The edit"), f"The edit {path}"
    tables = tables_of(values, "body", where, "Add [[body]] with a name and a mesh.")
    bodies = tuple(from_mapping(BodyEdit, table, f"{path}, body {i + 1}") for i, table in enumerate(tables))
    _check_names([body.name for body in bodies])
    walls = tables_of(values, "collider", where, "Write [[collider]] with a name and a mesh or plane.", least=0)
    colliders = tuple(from_mapping(ColliderEdit, table, f"{path}, collider {i + 1}") for i, table in enumerate(walls))
    _check_meshes([body.mesh for body in bodies if body.mesh != "recovered"] + [wall.mesh for wall in colliders if wall.mesh], path)
    others = tables_of(values, "further_field", where, "Write [[further_field]] with a file.", least=0)
    fields = tuple(from_mapping(FieldEdit, table, f"{path}, further_field {i + 1}") for i, table in enumerate(others))
    names = [one.name for one in fields if one.name is not None]
    if len(set(names)) < len(names):
        raise UsageError(f"Two further fields of {path} are named {max(names, key=names.count)}.", "Give each its own name.")
    return from_mapping(Edit, {**values, "body": bodies, "collider": colliders, "further_field": fields}, str(path))


def names_in(edit: Path | None) -> list[str]:
    """The paths of files in an edit, as written there; none if the edit cannot be read, which the engine reports when it reads it.

    A body whose mesh is "recovered" has no file of that name.
    """
    try:
        tables = read_toml(edit) if edit is not None else {}
    except (OSError, ValueError):
        return []
    files = {one.name for cls in (BodyEdit, ColliderEdit, FieldEdit, Edit) for one in options_of(cls).values() if one.file}
    rows = [tables, *(row for key in ("body", "collider", "further_field") for row in tables.get(key, ()) if isinstance(row, dict))]
    named = [(key, value) for row in rows for key, value in row.items() if key in files and isinstance(value, str)]
    return [value for key, value in named if (key, value) != ("mesh", "recovered")]


def _check_meshes(files: list[str], path: str | os.PathLike[str]) -> None:
    """UsageError for the first file of a mesh in the edit `path` whose ending is not one of a mesh."""
    for file in files:
        ending = Path(file).suffix
        if ending.lower() not in MESHES:
            has = f"the ending {ending}" if ending else "no ending"
            raise UsageError(f"{file} of {path} has {has}, and a mesh is read from {', '.join(MESHES)}.", "Export it in one of these.")


def _check_names(names: list[str]) -> None:
    """UsageError unless each body's name can be that of its own file, on every system; checked before any body is simulated."""
    for name in names:
        if not name.isprintable() or any(c in name for c in '/\\:*?"<>|') or name[:1] in ("", ".") or name[-1] in " .":
            raise UsageError(f"{name!r} cannot be a file's name.", "Use letters, digits, spaces, '-' and '_'.")
        if len(name.encode()) > LONGEST_NAME or name.split(".")[0].upper() in RESERVED:
            raise UsageError(f"{name[:40]!r} is too long for a file's name, or reserved.", "Choose another name for the body.")
        if [one.casefold() for one in names].count(name.casefold()) > 1:
            raise UsageError(f"Two bodies are named {name}.", "Give each its own name; upper and lower case count as the same.")
