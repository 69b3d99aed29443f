"""The kinds of properties of which the settings are made, and the items of their menus.

No postponed annotations here, as in the files that use it.
"""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ..engine.conventions import in_units
from ..engine.materials import MATERIALS
from .job import status

KEPT = {"SKIP_SAVE"}
"""Options of most properties: an operator starts from the scene's settings, not from its last call. Scenes save them nevertheless."""

PATH = KEPT | {"PATH_SUPPORTS_BLEND_RELATIVE"}

HEADINGS = {
    "leaf": "Foliage", "fruit": "Fruit", "wood": "Wood", "jelly": "Food", "paper": "Paper", "cotton": "Cloth", "feather": "Animal",
    "rubber": "Rubber and Foam", "beeswax": "Wax and Clay", "plastic": "Plastic", "steel": "Metal", "glass": "Glass and Stone",
    "flower_head": "Flowers",
}  # fmt: skip
"""Headings in the menu of materials, by the first material below each, in the order of the library."""
SHORT_FOR = {"eva", "hdpe", "pet", "pvc", "ptfe"}


def _material_items() -> list[tuple[str, str, str, int]]:
    """Menu items of the materials below their headings. Their numbers, which are saved in files, do not depend on the headings."""
    items = []
    for number, (name, m) in enumerate(MATERIALS.items()):
        if name in HEADINGS:
            items.append(("", HEADINGS[name], "", 0))
        title = name.upper() if name in SHORT_FOR else name.replace("_", " ").title()
        said = f"{m.law.replace('_', ' ')}, {m.density:g} kg/m³, Young's modulus {in_units(m.youngs_modulus, 'Pa')}. {m.source}"
        items.append((name, title, said, number))
    return items


MATERIAL_ITEMS = _material_items()

PRESET = "PRESET"
"""Identifier of the choice that stands for None."""
PART_ITEMS = [(PRESET, "As the Stem", "The material of the rest of the object", 10_000), *MATERIAL_ITEMS]
"""Menu items of a part's material; the first one has a number that no material will get."""

WAYS = [
    ("AUTO", "Automatic", "Location and rotation for bodies that stay rigid, a point cache for very large ones, else shape keys"),
    ("SHAPE_KEYS", "Shape Keys", "One absolute shape key per frame, and keys of the evaluation time"),
    ("TRANSFORM", "Location and Rotation", "Keys of the object's place; only for bodies that stay rigid"),
    ("POINT_CACHE", "Point Cache (PC2)", "A file beside the take that the Mesh Cache modifier plays; for large meshes"),
    ("ALEMBIC", "Alembic", "A file that other programs read too, where this Blender has Alembic"),
    ("USD", "USD", "A file that other programs read too, where this Blender has USD"),
]


def changed(self, context) -> None:
    """Update function of every setting that the status depends on."""
    scene = self.id_data
    if isinstance(scene, bpy.types.Scene):  # None while the properties are those of an operator
        status.refresh(scene)


def is_mesh(self, candidate) -> bool:
    """Poll function of a pointer to a mesh object."""
    return candidate.type == "MESH"


def file_path(name: str, description: str) -> object:
    """A property for the path of a file, where `//` stands for the folder of the .blend file."""
    return StringProperty(name=name, description=description, subtype="FILE_PATH", options=PATH, update=changed)


def number(name: str, default: float, description: str, **limits: float) -> object:
    """A property for a number; `limits` are further arguments of Blender's FloatProperty. The unit is part of the name."""
    return FloatProperty(name=name, default=default, description=description, options=KEPT, update=changed, **limits)


def toggle(name: str, description: str, default: bool = False) -> object:
    """A property that is on or off."""
    return BoolProperty(name=name, default=default, description=description, options=KEPT, update=changed)


def choice(name: str, description: str, items: list, default: str | None = None) -> object:
    """A property for one of `items`, by default the first."""
    return EnumProperty(name=name, description=description, items=items, default=default or items[0][0], options=KEPT, update=changed)
