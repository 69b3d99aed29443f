"""Settings from plain mappings, such as a table of TOML, and back. Unknown keys are refused, so that a misspelt one is noticed."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from ..errors import UsageError
from .option import KINDS, options_of
from .toml import toml_value

T = TypeVar("T")

LONGEST = 60
"""Characters of a value that are shown, at most."""


def from_mapping(cls: type[T], values: dict[str, Any], where: str) -> T:
    """Build the dataclass `cls` from a plain mapping (TOML, JSON, argparse), lists turned into tuples.

    Raises:
        UsageError: for a key that `cls` does not have, a required key that is missing, or a value that has another type, is out of range
            or not among the choices; `where` names the source in the message.
    """
    fields = {field.name: field for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    unknown = sorted(set(values) - set(fields))
    if unknown:
        raise UsageError(f"{where}: unknown setting {', '.join(unknown)}.", f"Known settings: {', '.join(fields)}.")
    required = [
        name for name, field in fields.items() if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    missing = [name for name in required if name not in values]
    if missing:
        raise UsageError(f"{where}: {', '.join(missing)} is missing.", f"Required: {', '.join(required)}.")
    hints, options = get_type_hints(cls), options_of(cls)
    for name, value in values.items():
        if not _fits(value, hints[name]):
            raise UsageError(f"{where}: {name} is {shown(value)}.", f"It must be {_kind(hints[name])}.")
        if name in options and value is not None:
            for each in value if isinstance(value, (list, tuple)) else [value]:
                options[name].check(each, f"{where}: {name}")
    return cls(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


def _fits(value: Any, hint: Any) -> bool:
    """Whether a plain value fits the type `hint` of the dataclass; a list fits a tuple, a whole number a float."""
    if get_origin(hint) is tuple:
        kinds = get_args(hint)
        if not isinstance(value, (list, tuple)):
            return False
        if kinds[-1] is Ellipsis:
            return all(_fits(item, kinds[0]) for item in value)
        return len(value) == len(kinds) and all(_fits(item, kind) for item, kind in zip(value, kinds))
    if get_args(hint):  # a union
        return any(_fits(value, kind) for kind in get_args(hint))
    if hint in (float, int) and isinstance(value, bool):
        return False
    if hint is float:
        return isinstance(value, (int, float)) and math.isfinite(value)
    return isinstance(value, hint)


def shown(value: Any) -> str:
    """A value for a message, as in a TOML file; of a long list, its beginning and its length."""
    try:
        text = toml_value(value)
    except TypeError:  # a date, or null in JSON
        text = str(value)
    if len(text) <= LONGEST or not isinstance(value, (list, tuple)):
        return text
    return f"{text[:LONGEST].rpartition(',')[0]}, ... ({len(value)} values)"


def _kind(hint: Any) -> str:
    """The values that `_fits` accepts, in words."""
    if get_origin(hint) is tuple:
        kinds = get_args(hint)
        count = "a list" if kinds[-1] is Ellipsis else f"a list of {len(kinds)}"
        return f"{count}, each {_kind(kinds[0])}"
    if get_args(hint):
        return " or ".join(_kind(kind) for kind in get_args(hint) if kind is not type(None))
    return KINDS.get(hint, f"a table of {hint.__name__}")


def to_mapping(settings: Any) -> dict[str, Any]:
    """The settings as plain values, without those that are None (TOML has no null)."""
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in dataclasses.asdict(settings).items()
        if value is not None
    }
