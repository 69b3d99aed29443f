"""What a panel draws, without a window."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any


class Drawn:
    """A layout that remembers what was put into it: operators, labels, menus, properties, and items of one to choose from."""

    def __init__(self) -> None:
        self.operators: list[SimpleNamespace] = []
        self.labels: list[str] = []
        self.menus: list[str] = []
        self.items: list[str] = []
        self.props: list[str] = []

    def label(self, text: str = "", **_: object) -> None:
        self.labels.append(text)

    def operator(self, name: str, **_: object) -> SimpleNamespace:
        self.operators.append(SimpleNamespace(name=name))
        return self.operators[-1]

    def menu(self, name: str, **_: object) -> None:
        self.menus.append(name)

    def prop(self, _: object, name: str, **__: object) -> None:
        self.props.append(name)

    def prop_enum(self, _: object, __: str, value: str) -> None:
        self.items.append(value)

    def panel(self, *_: object, **__: object) -> tuple[Drawn, Drawn]:
        return self, self

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments, **options: self
