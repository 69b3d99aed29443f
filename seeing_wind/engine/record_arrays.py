"""Records (see `records`) as named arrays for the NPZ files of a take, and back."""

from __future__ import annotations

import dataclasses
import json
import zipfile
from enum import StrEnum
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from .conventions import DRAFT, as_in_file, distrusted
from .errors import UsageError, WrongTake, clause
from .reading import check_record, parse_json
from .records import Body, Recovery
from .take import Take

R = TypeVar("R")

OBSERVATION, TRAJECTORY = "observation.npz", "trajectory.npz"
"""Files of a take with what was observed in its clip, and with its recovery: the simulated motion and the forces."""


def to_arrays(record: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """A record (see `records`) as a flat mapping of named arrays: names in nested records are joined with dots, other values are JSON."""
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
        WrongTake: when a field is missing (a take of another version), or is not as `to_arrays` writes it, or does not fit the others (a
            damaged take).
    """
    hints: dict[str, Any] = get_type_hints(cls)
    values: dict[str, Any] = {}
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]
        key, kind = prefix + field.name, hints[field.name]
        inner = next((one for one in (kind, *get_args(kind)) if dataclasses.is_dataclass(one)), None)
        if inner is not None and (inner is kind or any(name.startswith(f"{key}.") for name in arrays)):
            values[field.name] = from_arrays(inner, arrays, key + ".")  # type: ignore[arg-type]
        elif key not in arrays and field.default is not dataclasses.MISSING:
            continue  # a take from before the field existed
        elif key not in arrays:
            raise WrongTake(f"The take lacks {key}.", "It was written by another version: run `recover` again.")
        elif np.ndarray in (kind, *get_args(kind)) and arrays[key].dtype.kind != "U":  # None is JSON
            values[field.name] = arrays[key]
        else:
            try:
                values[field.name] = _plain(str(arrays[key]), kind)
            except ValueError as error:
                raise WrongTake(f"The take's {key} cannot be read: {error}.", "It is damaged: run `recover` again.") from error
    record = cls(**values)
    try:
        check_record(record)
    except ValueError as error:
        raise WrongTake(f"The take's {error}.", "It is damaged: run `recover` again.") from error
    return record


def _plain(text: str, kind: Any) -> Any:
    """A value of the type `kind` from JSON text. Raises ValueError for one of another type."""
    value = parse_json(text)
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return kind(value)
    if not _fits(value, kind):
        raise ValueError(f"{text[:40]} is not of the type {getattr(kind, '__name__', kind)}")
    return tuple(value) if get_origin(kind) is tuple else value


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value from JSON is of the type `kind`: a plain type, None, a list or tuple of one of these, or a union."""
    if isinstance(kind, UnionType):
        return any(_fits(value, one) for one in get_args(kind))
    if get_origin(kind) in (list, tuple):
        return isinstance(value, list) and all(_fits(item, get_args(kind)[0]) for item in value)
    if kind in (int, float):
        return isinstance(value, (int, kind)) and not isinstance(value, bool)
    return isinstance(value, kind)


def require_take(path: str) -> Take:
    """A take that has a recovered field.

    Raises:
        UsageError: there is none at `path`, with what is there instead.
        WrongTake: its take.toml cannot be read, or is of a newer format. A missing take.toml is no error.
    """
    take = Take(path)
    if not take.path.exists():
        raise UsageError(f"There is no folder {path}.", "Correct the path, or run `recover` with --take for this folder first.")
    if not take.path.is_dir():
        raise UsageError(f"{path} is a file, not the folder of a take.", "Give the folder that `recover` was given with --take.")
    if not take.file("field.safetensors").is_file():
        if take.file("resimulation.json").is_file():
            source = take.source_of("resimulate", "source")
            hint = f"Give the take that it was simulated in{f', {source}' if source else ''}."
            raise UsageError(f"{path} holds a re-simulation, not a recovered field.", hint)
        raise UsageError(f"{path} holds no recovered field.", "Run `recover` with --take for this folder first.")
    take.description()
    return take


def read_body(take: Take) -> Body:
    """The body of a take. Raises WrongTake if the take has none (one recovered from trajectories)."""
    return from_arrays(Body, take.read_arrays("particles.npz"))


def read_recovery(take: Take) -> Recovery:
    """The recovery of a take."""
    return recovery_of(take.read_arrays(TRAJECTORY))


def useless_notes(trajectory: Path) -> list[str]:
    """The notes of a recovery's file that call its field useless, without reading the rest of it; or that they cannot be read.

    Their frames are counted as in the clip's file, if the field is from a clip.
    """
    try:
        notes = distrusted(_notes_in(trajectory))
        first = _first_frame(trajectory.with_name(OBSERVATION)) if notes else None
    except WrongTake as error:
        return [str(error)]
    return notes if first is None else [as_in_file(note, first) for note in notes]


def _first_frame(observation: Path) -> int | None:
    """The first frame of its clip that an observation's file covers; None if there is no such file. Raises WrongTake if it is damaged."""
    if not observation.is_file():
        return None
    try:
        with np.load(observation, allow_pickle=False) as arrays:
            return int(arrays["first_frame"])
    except (KeyError, OSError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise WrongTake(f"The first frame in {observation} cannot be read ({clause(error)}).", "Run `recover` again.") from error


def is_draft(trajectory: Path) -> bool:
    """Whether the notes of a recovery's file call its field a draft. Raises WrongTake if they cannot be read."""
    return any(note.startswith(DRAFT) for note in _notes_in(trajectory))


def _notes_in(trajectory: Path) -> list[str]:
    try:
        with np.load(trajectory, allow_pickle=False) as arrays:
            if "notes" not in arrays:
                raise ValueError("it lacks them")
            return [str(note) for note in json.loads(str(arrays["notes"]))]
    except (OSError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise WrongTake(f"The notes in {trajectory} cannot be read ({clause(error)}).", "Run `recover` again.") from error


def recovery_of(arrays: dict[str, np.ndarray]) -> Recovery:
    """The recovery from the arrays of a trajectory file. Raises as `from_arrays`."""
    if "deviation" in arrays and arrays["deviation"].ndim == 2:  # a take from before each component had its own deviation
        arrays["deviation"] = np.repeat(arrays["deviation"][..., None], 3, axis=-1)
    return from_arrays(Recovery, arrays)
