"""Plain mappings as TOML, which the standard library can read but not write."""

from __future__ import annotations

import json
import re
from typing import Any


def toml_text(values: dict[str, Any]) -> str:
    """Plain values, lists, nested tables and lists of tables as TOML text.

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
            lines.append(f"{inner[-1]} = {toml_value(value)}")
    # a table without its own values needs no header, unless it is empty or an item of a list
    if header and (lines or not nested or header.startswith("[[")):
        lines.insert(0, header)
    return (["\n".join(lines)] if lines else []) + nested


def toml_value(value: Any) -> str:
    """A plain value as it is written in TOML, a table inline. Raises TypeError as `toml_text`."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    raise TypeError(f"no TOML for {type(value).__name__}")
