"""An option: the one place that defines a setting's name, its meaning, and the values that it may have.

A field of a settings dataclass becomes an option by `name: type = option(default, help=..., ...)`. From this are derived the flag of the
command line (`command.arguments`), the property of the panel (`ui.option_properties`), the words that the panel passes to the worker
(`words_of`), the reference (`scripts/cli_reference.py`), and error texts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, get_args, get_origin, get_type_hints

from ..errors import UsageError

KEY = "option"
"""Key of the `Option` in a dataclass field's metadata."""


@dataclass(frozen=True)
class Form:
    """How a value is written as words of a command line, if it is not simply one word per number."""

    read: Callable[[str], Any]
    """One word -> its part of the value. Raises ValueError for an invalid word."""
    write: Callable[[Any], list[str]]
    """A value -> its words."""
    must: str
    """The words after "must" in the error text."""
    many: bool = False
    """Whether there may be several words, whose parts together are the value; otherwise there is one word."""


@dataclass(frozen=True)
class Option:
    """The definition of an option. `options_of` fills in what follows from the field itself: name, default, kind, count, optional."""

    help: str
    """What the option is, without capital and full stop: the command line's help, and with a capital the panel's tooltip."""
    tooltip: str = ""
    """Replaces the help in the panel, where the help mentions other flags."""
    label: str = ""
    """Name in the panel; by default from the field's name."""
    flag: str = ""
    """Flag of the command line; by default from the field's name."""
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    """Excluded lower bound."""
    below: float | None = None
    """Excluded upper bound."""
    choices: Mapping[str, str] = field(default_factory=dict)
    """Value -> its meaning."""
    titles: Mapping[str, str] = field(default_factory=dict)
    """Value -> its name in the panel, where that differs from the value."""
    metavar: str | tuple[str, ...] | None = None
    form: Form | None = None
    group: str = ""
    """Title of its group on the command line."""
    one_of: str = ""
    """At most one of the options that share this word may be given. The panel has a mode to choose among them."""
    file: bool = False
    """Whether the value is the path of a file."""
    folder: bool = False
    """Whether the value is the path of a folder."""
    otherwise: str = ""
    """What applies when the value is None."""
    panel: str = "more"
    """Where the panel shows the property: "more", the closed part that is drawn from the options; "main", drawn by hand; "" for nowhere."""
    identifier: str = ""
    """Identifier of the property; by default the field's name."""
    start: Any = None
    """The property's first value, if the default is None."""
    unset: float | None = None
    """The property's value that stands for None; without it, an optional number has a check box before it."""
    typical: tuple[float | None, float | None] = (None, None)
    """Limits for dragging the property."""
    digits: int = 2
    """Decimals that the property shows."""
    name: str = ""
    default: Any = None
    kind: type = str
    count: int | None = None
    """Length of a tuple, 0 for any length; None for a single value."""
    optional: bool = False

    def check(self, value: Any, called: str) -> None:
        """Refuse a value, or one item of a tuple, that is out of range or not among the choices; `called` is its name in the message.

        Raises:
            UsageError: saying what the value must be.
        """
        if (self.choices and value not in self.choices) or (isinstance(value, (int, float)) and not self._within(value)):
            raise self._wrong(called, self.must(), value)

    def read(self, text: str) -> Any:
        """The value, or part of one, from a word of the command line.

        Raises:
            UsageError: for an invalid word.
        """
        called = f"`{self.flag}`"
        try:
            value = self.form.read(text) if self.form else self.kind(text)
        except ValueError:
            raise self._wrong(called, self.form.must if self.form else f"be {KINDS[self.kind]}", text) from None
        if (self.file or self.folder) and not text.strip():
            raise UsageError(f"{called}: '{text}' is not a path.", self.sentence())
        if self.kind is str and not text.strip():
            raise self._wrong(called, self.must() if self.choices else "not be empty", text)
        if self.form is None:
            self.check(value, called)
        return value

    def words(self, value: Any) -> list[str]:
        """The words from which `read` makes this value."""
        if self.form is not None:
            return self.form.write(value)
        return [number_text(each) if self.kind is float else str(each) for each in (value if self.count is not None else [value])]

    def must(self) -> str:
        """The words after "must" in an error text: the choices, or the range with its unit."""
        if self.choices:
            return f"be {' or '.join(self.choices)}"
        bounds = self._bounds()
        unit = self.unit.replace("1/s", "per second")
        return f"be {bounds or 'finite'}{f' {unit}' if bounds and unit else ''}"

    def summary(self, default: Any, said: str = "") -> str:
        """Help, unit, choices, range and default in one line; `said` replaces the text of the default."""
        said = said or (self.otherwise if default is None else "" if default == 0 else " ".join(self.words(default)))
        choices = "".join(f"; {name}: {meaning}" for name, meaning in self.choices.items())
        bounded = self.maximum is not None or self.below is not None
        more = "; ".join(filter(None, [self._bounds() if bounded else "", f"default: {said}" if said else ""]))
        return f"{self.help}{f' [{self.unit}]' if self.unit else ''}{choices}{f' ({more})' if more else ''}"

    def sentence(self) -> str:
        """The help as a sentence; "" if there is none."""
        return f"{self.help[:1].upper()}{self.help[1:]}." if self.help else ""

    def _bounds(self) -> str:
        parts = [("above", self.above), ("at least", self.minimum), ("below", self.below), ("at most", self.maximum)]
        return " and ".join(f"{word} {number_text(value)}" for word, value in parts if value is not None)

    def _within(self, value: float) -> bool:
        low = (self.above is None or value > self.above) and (self.minimum is None or value >= self.minimum)
        high = (self.below is None or value < self.below) and (self.maximum is None or value <= self.maximum)
        return (isinstance(value, int) or math.isfinite(value)) and low and high

    def _wrong(self, called: str, must: str, value: Any) -> UsageError:
        shown = number_text(value) if isinstance(value, (int, float)) else repr(value)
        return UsageError(f"{called} must {must}; this is {shown}.", self.sentence())


LONGEST_NUMBER = 40
"""Characters of a number that are shown, at most."""
KINDS = {float: "a finite number", int: "a whole number", bool: "true or false", str: "a text in quotes"}
"""The type that a value must have, in words."""


def option(default: Any = dataclasses.MISSING, **definition: Any) -> Any:
    """A dataclass field with an `Option`; `definition` has the fields of that, `help` among them. Without a default it is required."""
    return dataclasses.field(default=default, metadata={KEY: definition})


_known: dict[type, dict[str, Option]] = {}


def options_of(cls: type) -> dict[str, Option]:
    """The options of a settings dataclass by name, in the order of its fields. Fields that are not options are set by the engine itself."""
    if cls not in _known:
        _known[cls] = _read(cls)
    return _known[cls]


def _read(cls: type) -> dict[str, Option]:
    hints, found = get_type_hints(cls), {}
    for each in dataclasses.fields(cls):
        if KEY in each.metadata:
            definition, (kind, count, optional) = each.metadata[KEY], _shape(hints[each.name])
            plain = each.name.replace("_", " ")
            found[each.name] = Option(**{
                "label": plain.title(), "flag": f"--{plain.replace(' ', '-')}", "identifier": each.name, "name": each.name,
                "default": None if each.default is dataclasses.MISSING else each.default,
                "kind": kind, "count": count, "optional": optional, **definition,
            })  # fmt: skip
    return found


def _shape(hint: Any) -> tuple[type, int | None, bool]:
    """`kind`, `count` and `optional` of an `Option`, from its field's type."""
    kinds = [kind for kind in get_args(hint) if kind is not type(None)]
    if get_origin(hint) is tuple:
        return kinds[0], (0 if kinds[-1] is Ellipsis else len(kinds)), False
    if not kinds:
        return hint, None, False
    kind, count, _ = _shape(kinds[0])
    return kind, count, type(None) in get_args(hint)


def words_of(*settings: Any) -> list[str]:
    """The words of a command line for these settings: what is not at its default. A flag that several settings share is given once."""
    words: dict[str, list[str]] = {}
    for each in settings:
        for name, one in options_of(type(each)).items():
            if getattr(each, name) != one.default:
                words.setdefault(one.flag, one.words(getattr(each, name)))
    return [word for flag, values in words.items() for word in (flag, *values)]


def number_text(value: float) -> str:
    """A number as a person would type it: 20, not 20.0, with all its digits, unless these would fill a line."""
    text = repr(value).removesuffix(".0")
    return text if len(text) <= LONGEST_NUMBER else f"a number of {len(text)} digits"


def frame_range(text: str) -> tuple[int, int]:
    """'A:B' -> (A, B), both inclusive. Raises ValueError if these are not two frames in order."""
    first, last = (int(part) for part in text.split(":"))
    if first < 0 or last <= first:
        raise ValueError(text)
    return first, last


def pixel(text: str) -> tuple[float, float]:
    """'X,Y' -> (X, Y) [px]. Raises ValueError."""
    x, y = (float(part) for part in text.split(","))
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(text)
    return x, y


def mark(text: str) -> tuple[float, float, float, float]:
    """'N+X,Y' -> (N, X, Y, 1), a point [px] on the object in frame N; 'N-X,Y' -> (N, X, Y, 0), one beside it. Raises ValueError."""
    sign = "+" if "+" in text else "-"
    number, at = text.split(sign, 1)
    return float(int(number)), *pixel(at), float(sign == "+")


def _marks(values: Sequence[float]) -> list[str]:
    rows = zip(values[::4], values[1::4], values[2::4], values[3::4])
    return [f"{int(number)}{'+' if on else '-'}{number_text(x)},{number_text(y)}" for number, x, y, on in rows]


def _pairs(values: Sequence[float]) -> list[str]:
    return [f"{number_text(x)},{number_text(y)}" for x, y in zip(values[::2], values[1::2])]


RANGE = Form(frame_range, lambda value: [f"{value[0]}:{value[1]}"], "be a first frame and a later last one, such as 12:27")
PIXELS = Form(pixel, _pairs, "be points such as 120,80", many=True)
MARKS = Form(mark, _marks, "be points such as 40+120,80, or 40-120,80 beside the object", many=True)
