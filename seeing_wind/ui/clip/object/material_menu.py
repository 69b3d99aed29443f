"""The menu of materials, with a submenu for each kind: near the right edge of its window, Blender would show the whole list as a single
column, longer than the screen."""

from __future__ import annotations

import bpy

from ...property_kinds import MATERIAL_ITEMS, PART_ITEMS, PRESET

CHOSEN_FOR = "seeing_wind_chosen_for"
"""Context member that holds the settings whose material the menu sets."""

CHOICES = {"material": "Material", "head_material": "Head Material", "leaf_material": "Leaf Material"}
"""Properties that a menu sets, and their names. A menu cannot be told which one, so each has its own."""


def _kinds() -> dict[str, list[str]]:
    """Names of the materials under each heading."""
    kinds: dict[str, list[str]] = {}
    for name, title, *_ in MATERIAL_ITEMS:
        if not name:
            below = kinds.setdefault(title, [])
        else:
            below.append(name)
    return kinds


KINDS = _kinds()
TITLES = {name: title for name, title, *_ in PART_ITEMS if name}


def draw_material(column, settings, chosen: str = "material") -> None:
    """Draw the property `chosen`, one of `CHOICES`, of `settings` in a row that looks like a property's."""
    split = column.split(factor=0.4, align=True)
    label = split.row()
    label.alignment = "RIGHT"
    label.label(text=CHOICES[chosen])
    split.context_pointer_set(CHOSEN_FOR, settings)
    split.menu(f"SEEING_WIND_MT_{chosen}", text=TITLES[getattr(settings, chosen)])


def _menu_of(chosen: str) -> type:
    """The menu of a property: a submenu for each kind of material, after "as the stem" for a part."""

    def draw(self, context):
        settings = getattr(context, CHOSEN_FOR, None)
        if settings is not None and chosen != "material":
            self.layout.prop_enum(settings, chosen, PRESET)
        for number, (title, names) in enumerate(KINDS.items()):
            column = self.layout.column()
            if settings is not None:
                column.context_pointer_set(CHOSEN_FOR, settings)
                column.active_default = getattr(settings, chosen) in names
            column.menu(f"SEEING_WIND_MT_{chosen}_{number}", text=title)

    name = f"SEEING_WIND_MT_{chosen}"
    body = {"bl_idname": name, "bl_label": CHOICES[chosen], "__doc__": "What it is made of: kinds of materials", "draw": draw}
    return type(name, (bpy.types.Menu,), body)


def _kind_menu_of(chosen: str, number: int, title: str, names: list[str]) -> type:
    """A menu for the materials of one kind."""

    def draw(self, context):
        settings = getattr(context, CHOSEN_FOR, None)
        for name in names if settings is not None else ():
            self.layout.prop_enum(settings, chosen, name)

    name = f"SEEING_WIND_MT_{chosen}_{number}"
    body = {"bl_idname": name, "bl_label": title, "__doc__": f"Materials of the kind {title}", "draw": draw}
    return type(name, (bpy.types.Menu,), body)


CLASSES = tuple(
    menu for chosen in CHOICES for menu in (
        _menu_of(chosen), *(_kind_menu_of(chosen, number, title, names) for number, (title, names) in enumerate(KINDS.items())),
    )
)  # fmt: skip
