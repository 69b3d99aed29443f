"""The engine's options in Blender: their properties, made of what defines them, and their values as the properties have them.

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
from .property_kinds import KEPT, PATH, changed
from .user_paths import absolute

NUMBERS = {(float, False): FloatProperty, (float, True): FloatVectorProperty, (int, False): IntProperty, (int, True): IntVectorProperty}
"""By kind, and whether there are several."""

PRESET = "PRESET"
"""The choice that stands for None."""

ROUNDED = 1e-5
"""Relative to a preset: what differs less is the same number in single precision, or in another unit of length."""


def panel_options(*classes: type, part: str = "") -> list[Option]:
    """The options of settings dataclasses that have a property, only those of one `part` of the panel, if it is named.

    One that several share stands with the last of them.
    """
    found: dict[str, Option] = {}
    for one in (one for cls in classes for one in options_of(cls).values() if one.panel and part in ("", one.panel)):
        found.pop(one.name, None)
        found[one.name] = one
    return list(found.values())


def with_options(
    cls: type, *, only: Collection[str] = (), but: Collection[str] = (), ticks: bool = True, **common: Any
) -> Callable[[type], type]:
    """A class decorator that gives a property group or operator a property for each option of `cls` that the panel has.

    What the class says itself goes before.

    Args:
        only: names of those that are wanted, if not all; but: names of those that are not.
        ticks: whether optional numbers get a tick `use_NAME` before them.
        common: arguments of `bpy.props` for all of them, in place of ours.
    """

    def give(group: type) -> type:
        """The group with the properties."""
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
    """The Blender property of an option: its label with the unit is the name, its help the tooltip, its range the limits."""
    said = _capital(one.tooltip or one.help) + (f". 0: {one.otherwise}" if one.unset is not None else "")
    about = {"name": f"{one.label} ({one.unit})" if one.unit else one.label, "description": said, "options": KEPT, "update": changed}
    if one.choices:
        titles = {name: name.replace("_", " ").title() for name in one.choices} | one.titles
        items = [(name.upper(), titles[name], _capital(text)) for name, text in one.choices.items()]
        # what follows a colon is too long for a menu in the sidebar
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
        # dragging changes the second digit that counts; Blender wants hundredths
        limits |= {"precision": one.digits, "step": 100.0 * max(10.0 ** (math.floor(math.log10(size)) - 1) if size else 0.1, finest)}
    if one.count is not None:
        limits["size"] = one.count
    return {name: value for name, value in limits.items() if value is not None}


def _has_tick(one: Option) -> bool:
    return one.optional and one.kind in (float, int) and one.unset is None and not one.one_of


def _capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


def values_of(group: bpy.types.bpy_struct, *classes: type) -> dict[str, Any]:
    """The values of all options that a property group has, by name; files as absolute paths, whether they are there or not."""
    return {one.name: value_of(group, one) for one in panel_options(*classes)}


def part_of(values: dict[str, Any], cls: type, **instead: Any) -> dict[str, Any]:
    """Those of `cls` among the values of several classes, without those that only one of can be given; `instead` goes before them."""
    return {name: values[name] for name, one in options_of(cls).items() if name in values and not one.one_of} | instead


def value_of(group: bpy.types.bpy_struct, one: Option) -> Any:
    """The value of one option, None where the property says that there is none."""
    value = getattr(group, one.identifier)
    if (_has_tick(one) and not getattr(group, f"use_{one.identifier}")) or (one.unset is not None and value == one.unset):
        return None
    if one.choices:
        return None if value == PRESET else value.lower()
    if one.file or one.folder:
        return absolute(value) if value else None
    if one.kind is float:
        return single(value) if one.count is None else tuple(single(each) for each in value)
    return value if one.count is None else tuple(value)


def give(group: bpy.types.bpy_struct, one: Option, value: Any) -> None:
    """Set the property of an option, and its tick, to a value as files have it. Raises TypeError or ValueError where it has no place."""
    setattr(group, one.identifier, tuple(value) if isinstance(value, list) else str(value).upper() if one.choices else value)
    if _has_tick(one):
        setattr(group, f"use_{one.identifier}", True)


def choice_of(value: Sequence[float], presets: dict[str, Sequence[float]]) -> str:
    """Which of `presets` a vector is, as a menu that has them and CUSTOM says it; the first one, where several are the same."""
    for name, preset in presets.items():
        if math.dist(value, preset) <= ROUNDED * max(1.0, math.hypot(*preset)):
            return name
    return "CUSTOM"


def check_files(values: dict[str, Any], cls: type) -> None:
    """Raises UsageError when a file among the values of options is not there."""
    for name, one in options_of(cls).items():
        if one.file and values.get(name) is not None:
            existing_file(values[name], one.label.lower())


def existing_file(path: str, what: str) -> str:
    """The absolute path of a file that the user has named. Raises UsageError when it is not there; `what` says what it should be."""
    found = absolute(path)
    if not os.path.isfile(found):
        raise UsageError(f"There is no {what} {found}.", "Choose it again; it may have been moved.")
    return found


def single(value: float) -> float:
    """Blender keeps single precision: seven digits say all of it, and 30.19 stays 30.19."""
    return float(f"{value:.7g}")
