"""A job's options as the words of a command line, and messages about these words in the keys of the job's table."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from ...settings import BuildSettings, ObserveSettings, RecoverSettings, ReportSettings, WindSettings, options_of

SETTINGS = (ObserveSettings, BuildSettings, RecoverSettings, WindSettings, ReportSettings)
FLAGS = {one.flag for cls in SETTINGS for one in options_of(cls).values()}
MORE = {"--take", "--edit", "--view", "--objects", "--no-gravity", "--material-endpoint", "--material-model"}
"""Flags of the verbs of a job that are not those of a setting."""


def words_of(options: dict[str, Any]) -> list[str]:
    """A table of options as words of a command line."""
    words = []
    for key, value in options.items():
        if value is False:
            continue
        flag = f"--{key.replace('_', '-')}"
        if key == "view":
            words += [word for view in value for word in (flag, *view)]
            continue
        words.append(flag)
        if value is not True:
            words += [str(each) for each in (value if isinstance(value, list) else [value])]
    return words


def in_keys(texts: Sequence[str], keys: Collection[str], edit_take: Path | None) -> list[str]:
    """The texts of an error of a verb, in which every flag of a command line is replaced by the key that it has in a file of jobs.

    Args:
        keys: those of the job's own options, which may be unknown ones.
        edit_take: the folder of the job's re-simulation. If a text names it, --take stands for `edit_take`.
    """
    known = FLAGS | MORE | {f"--{key.replace('_', '-')}" for key in keys}
    named = None if edit_take is None else re.compile(rf"{re.escape(str(edit_take))}(?![\w-]|\.\w)")
    take = "edit_take" if named is not None and any(map(named.search, texts)) else "take"

    def key_of(found: re.Match[str]) -> str:
        tick, flag = found.groups()
        if flag not in known:
            return found[0]
        key = take if flag == "--take" else flag[2:].replace("-", "_")
        return f"`{key}" if tick else f"`{key}`"

    return [re.sub(r"(`?)(?<![\w-])(--[a-z][\w-]*)", key_of, text) for text in texts]
