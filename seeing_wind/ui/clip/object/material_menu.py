"""The menu of materials, with a submenu for each kind: near the right edge of its window, Blender would show the whole list as a single
column, longer than the screen."""

from __future__ import annotations

import bpy

from ...property_kinds import MATERIAL_ITEMS

CHOSEN_FOR = "seeing_wind_chosen_for"
"""Context member that holds the settings whose `material` the menu sets."""


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
TITLES = {name: title for name, title, *_ in MATERIAL_ITEMS if name}


def draw_material(column, settings) -> None:
    """Draw the material of `settings` in a row that looks like a property's."""
    split = column.split(factor=0.4, align=True)
    label = split.row()
    label.alignment = "RIGHT"
    label.label(text="Material")
    split.context_pointer_set(CHOSEN_FOR, settings)
    split.menu("SEEING_WIND_MT_material", text=TITLES[settings.material])


class SEEING_WIND_MT_material(bpy.types.Menu):
    """What it is made of: kinds of materials"""

    bl_idname = "SEEING_WIND_MT_material"
    bl_label = "Material"

    def draw(self, context):
        """Draw one submenu for each kind."""
        chosen = getattr(context, CHOSEN_FOR, None)
        for number, (title, names) in enumerate(KINDS.items()):
            column = self.layout.column()
            if chosen is not None:
                column.context_pointer_set(CHOSEN_FOR, chosen)
                column.active_default = chosen.material in names
            column.menu(f"SEEING_WIND_MT_material_{number}", text=title)


def _menu_of(number: int, title: str, names: list[str]) -> type:
    """A menu class for the materials of one kind."""

    def draw(self, context):
        chosen = getattr(context, CHOSEN_FOR, None)
        for name in names if chosen is not None else ():
            self.layout.prop_enum(chosen, "material", name)

    name = f"SEEING_WIND_MT_material_{number}"
    body = {"bl_idname": name, "bl_label": title, "__doc__": f"Materials of the kind {title}", "draw": draw}
    return type(name, (bpy.types.Menu,), body)


CLASSES = (SEEING_WIND_MT_material, *(_menu_of(number, title, names) for number, (title, names) in enumerate(KINDS.items())))
