"""The engine's options in Blender: properties made from the options' definitions, and the values of these properties.

No postponed annotations here: Blender reads annotations as property definitions.
"""

import inspect
import math
import os
from collections.abc import Callable, Collection, Sequence
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, IntVectorProperty, StringProperty

from ..engine.errors import UsageError
from ..engine.settings import Option, options_of
from .property_kinds import KEPT, PATH, PRESET, changed
from .user_paths import absolute

NUMBERS = {(float, False): FloatProperty, (float, True): FloatVectorProperty, (int, False): IntProperty, (int, True): IntVectorProperty}
"""Blender's property functions for numbers, by kind and by whether the option has several numbers."""

ROUNDED = 1e-5
"""Difference relative to a preset below which a number is the same: single precision, or another unit of length."""


def panel_options(*classes: type, part: str = "") -> list[Option]:
    """The options of settings dataclasses that have a property; with `part`, only those of that part of the panel.

    An option that several classes share is listed with the last of them.
    """
    found: dict[str, Option] = {}
    for one in (one for cls in classes for one in options_of(cls).values() if one.panel and part in ("", one.panel)):
        found.pop(one.name, None)
        found[one.name] = one
    return list(found.values())


def with_options(
    cls: type, *, only: Collection[str] = (), but: Collection[str] = (), ticks: bool = True, **common: Any
) -> Callable[[type], type]:
    """A class decorator that adds to a property group or operator a property for each option of `cls` that the panel has.

    The class's own annotations take precedence.

    Args:
        only: names of the options to include, if not all; but: names of those to leave out.
        ticks: whether optional numbers get a tick `use_NAME` before them.
        common: arguments of `bpy.props` for all properties, which override the default ones.
    """

    def give(group: type) -> type:
        """Add the properties to the group."""
        made = {}
        for one in panel_options(cls):
            if one.name in (only or {one.name}) and one.name not in but:
                made[one.identifier] = property_of(one, **common)
                if ticks and _has_tick(one):
                    said = f"Tick to give it. Otherwise: {one.otherwise}"
                    made[f"use_{one.identifier}"] = BoolProperty(name=one.label, description=said, options=KEPT, update=changed)
        group.__annotations__ = made | inspect.get_annotations(group)  # from Python 3.14 on a class's __dict__ does not have them
        return group

    return give


def property_of(one: Option, **common: Any) -> object:
    """The Blender property of an option: name from its label and unit, tooltip from its help, limits from its range."""
    said = _capital(one.tooltip or one.help) + (f". 0: {one.otherwise}" if one.unset is not None else "")
    about = {"name": f"{one.label} ({one.unit})" if one.unit else one.label, "description": said, "options": KEPT, "update": changed}
    if one.choices:
        titles = {name: name.replace("_", " ").title() for name in one.choices} | one.titles
        items = [(name.upper(), titles[name], _capital(text)) for name, text in one.choices.items()]
        # the text after a colon is too long for a menu in the sidebar
        preset = (PRESET, _capital(f"as {one.otherwise.partition(':')[0]}"), f"As {one.otherwise}")
        items = [preset, *items] if one.optional else items
        return EnumProperty(items=items, default=items[0][0] if one.optional else one.default.upper(), **about | common)
    if one.kind is bool:
        return BoolProperty(default=one.default, **about | common)
    if one.kind is str:
        path = {"subtype": "DIR_PATH" if one.folder else "FILE_PATH", "options": PATH} if one.file or one.folder else {}
        return StringProperty(**about | path | common)
    return NUMBERS[one.kind, one.count is not None](**about | _limits(one) | common)


def _limits(one: Option) -> dict[str, Any]:
    finest = 10.0**-one.digits
    first = one.unset if one.unset is not None else one.start if one.default is None else one.default
    low = one.minimum if one.above is None else one.above + finest
    limits = {
        "default": first, "min": low if one.unset is None or low is None else min(low, one.unset),
        "max": one.maximum if one.below is None else one.below - finest, "soft_min": one.typical[0], "soft_max": one.typical[1],
    }  # fmt: skip
    if one.kind is float:
        size = abs(first if one.count is None else max(first))
        # dragging changes the second significant digit; Blender's step is in hundredths
        limits |= {"precision": one.digits, "step": 100.0 * max(10.0 ** (math.floor(math.log10(size)) - 1) if size else 0.1, finest)}
    if one.count is not None:
        limits["size"] = one.count
    return {name: value for name, value in limits.items() if value is not None}


def _has_tick(one: Option) -> bool:
    return one.optional and one.kind in (float, int) and one.unset is None and not one.one_of


def _capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


def values_of(group: bpy.types.bpy_struct, *classes: type) -> dict[str, Any]:
    """The values of all options that a property group has, by name; files as absolute paths, whether they exist or not."""
    return {one.name: value_of(group, one) for one in panel_options(*classes)}


def part_of(values: dict[str, Any], cls: type, **instead: Any) -> dict[str, Any]:
    """The values of the options of `cls` among those of several classes, without mutually exclusive options; `instead` overrides them."""
    return {name: values[name] for name, one in options_of(cls).items() if name in values and not one.one_of} | instead


def value_of(group: bpy.types.bpy_struct, one: Option) -> Any:
    """The value of one option; None if it is not ticked, has its `unset` value or the choice PRESET, or is an empty path."""
    value = getattr(group, one.identifier)
    if (_has_tick(one) and not getattr(group, f"use_{one.identifier}")) or (one.unset is not None and value == one.unset):
        return None
    if one.kind is str and value == PRESET:
        return None
    if one.choices:
        return value.lower()
    if one.file or one.folder:
        return absolute(value) if value else None
    if one.kind is float:
        return single(value) if one.count is None else tuple(single(each) for each in value)
    return value if one.count is None else tuple(value)


def give(group: bpy.types.bpy_struct, one: Option, value: Any) -> None:
    """Set the property of an option to a value as stored in files, and its tick. Raises TypeError or ValueError for an unsuitable value."""
    setattr(group, one.identifier, tuple(value) if isinstance(value, list) else str(value).upper() if one.choices else value)
    if _has_tick(one):
        setattr(group, f"use_{one.identifier}", True)


def choice_of(value: Sequence[float], presets: dict[str, Sequence[float]]) -> str:
    """The name of the preset that equals a vector (the first one, if several do), else CUSTOM."""
    for name, preset in presets.items():
        if math.dist(value, preset) <= ROUNDED * max(1.0, math.hypot(*preset)):
            return name
    return "CUSTOM"


def check_files(values: dict[str, Any], cls: type) -> None:
    """Raise UsageError when a file among the values of options does not exist."""
    for name, one in options_of(cls).items():
        if one.file and values.get(name) is not None:
            existing_file(values[name], one.label.lower())


def existing_file(path: str, what: str) -> str:
    """The absolute path of a file that the user has named. Raises UsageError when it does not exist; `what` names it in the message."""
    found = absolute(path)
    if not os.path.isfile(found):
        raise UsageError(f"There is no {what} {found}.", "Choose it again; it may have been moved.")
    return found


def single(value: float) -> float:
    """A value rounded to seven digits, all that Blender's single precision holds, so that 30.19 stays 30.19."""
    return float(f"{value:.7g}")
