"""A job's options, checked, as the words of a command line, and messages about these words in the keys of the job's table."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from ...errors import UsageError
from ...settings import BuildSettings, ObserveSettings, Option, RecoverSettings, ReportSettings, WindSettings, options_of
from ...settings.mapping import shown

SETTINGS = (ObserveSettings, BuildSettings, RecoverSettings, WindSettings, ReportSettings)
OPTIONS = {one.name: one for cls in SETTINGS for one in options_of(cls).values()}
FLAGS = {one.flag for one in OPTIONS.values()}
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


def check_kinds(options: dict[str, Any], name: str) -> None:
    """Check that the options of the job `name` are as many words as their flags take; false leaves an option out.

    Raises:
        UsageError: one is a list in place of a single value or the reverse, has another number of values, is true, or is no whole
            number where one is needed.
    """
    for key, value in options.items():
        one = OPTIONS.get(key)
        if one is not None and value is not False and not _has_its_words(one, value):
            raise UsageError(f"{key} in recover of {name} is {shown(value)}.", _kind(one, value))


def _has_its_words(one: Option, value: Any) -> bool:
    if one.form is not None:
        texts = value if one.form.many and isinstance(value, list) and value else [value]
        return all(isinstance(each, str) for each in texts)
    if one.count is None:
        return isinstance(value, (str, int) if one.kind is int else (str, int, float)) and value is not True
    return isinstance(value, list) and len(value) == (one.count or len(value)) and all(_is_number(each) for each in value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _kind(one: Option, value: Any) -> str:
    """What `_has_its_words` accepts in place of the value, as a sentence."""
    if one.form is not None:
        return f"It must {one.form.must}, as {'texts' if one.form.many else 'a text'} in quotation marks."
    if one.count is None and isinstance(value, float):
        such = f", such as {round(value)}" if math.isfinite(value) else ""
        return f"Write a whole number without a point or exponent{such}."
    if one.count is None:
        return "Write one value, or false to leave it out."
    return f"Write a list of {one.count or ''} numbers in brackets.".replace("  ", " ")


def views_of(value: Any, name: str) -> list[list[str]]:
    """The further views of the job `name`, each as clip, camera and mask; `value` is a list of views or a single view.

    Raises:
        UsageError: it is neither.
    """
    views = value if isinstance(value, list) and value and all(isinstance(view, list) for view in value) else [value]
    for view in views:
        if not isinstance(view, list) or len(view) != 3 or not all(isinstance(word, str) and word for word in view):
            hint = 'Write ["CLIP2", "CAMERA2.json", "MASK2.png"], or a list of several such lists.'
            raise UsageError(f"view in recover of {name} is {shown(value)}.", hint)
    return views


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
