"""What inserted cloth looks like that has no material of its own: matt, a little fuzzy, and bright where the light is behind it."""

from __future__ import annotations

import math

import bpy

from ...engine.materials import SHEETS

SUNK = 0.2
"""Weight [kg/m²] of white cloth that lets an e-th of `THIN` through; with this, shirting of 120 g/m² lets a third of the light through,
denim of 400 a twelfth. Chosen."""
THIN = 0.6
"""Of the light that the thinnest cloth does not take, what goes through it."""
WHITE = (0.80, 0.79, 0.76, 1.0)
"""Washed cotton, linear."""
CREASES, DEEP = 7.0, 0.35
"""Creases along the cloth, and how strongly they are seen."""


def dress(obj: bpy.types.Object, preset: str) -> bool:
    """Give a mesh without any material that of a cloth of the library, and smooth shading. Returns whether it got one."""
    sheet = SHEETS.get(preset)
    if sheet is None or not sheet.woven or obj.data.library is not None or any(obj.material_slots):
        return False
    obj.data.materials.append(cloth_material(preset))
    obj.data.shade_smooth()
    return True


def cloth_material(preset: str) -> bpy.types.Material:
    """The material of a cloth of the library, made once per file."""
    name = f"Seeing Wind {preset.replace('_', ' ').title()}"
    material = bpy.data.materials.get(name)
    if material is None:
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        _build(material.node_tree, THIN * math.exp(-SHEETS[preset].areal_density / SUNK))
        material.diffuse_color = WHITE
    return material


def _build(tree: bpy.types.NodeTree, through: float) -> None:
    """A surface that scatters a share of the light forwards instead of back."""
    tree.nodes.clear()
    place, creases, bump, front, behind, both, output = (
        tree.nodes.new(f"ShaderNode{kind}")
        for kind in ("TexCoord", "TexNoise", "Bump", "BsdfPrincipled", "BsdfTranslucent", "MixShader", "OutputMaterial")
    )
    creases.inputs["Scale"].default_value, creases.inputs["Detail"].default_value = CREASES, 5.0
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = DEEP, 0.006
    for name, value in (("Base Color", WHITE), ("Roughness", 0.9), ("Specular IOR Level", 0.15), ("Sheen Weight", 0.25)):
        front.inputs[name].default_value = value
    behind.inputs["Color"].default_value, both.inputs[0].default_value = WHITE, through
    for source, target in (
        # where it was at rest: creases move along
        (place.outputs["Generated"], creases.inputs["Vector"]), (creases.outputs[0], bump.inputs["Height"]),
        (bump.outputs[0], front.inputs["Normal"]), (bump.outputs[0], behind.inputs["Normal"]), (front.outputs[0], both.inputs[1]),
        (behind.outputs[0], both.inputs[2]), (both.outputs[0], output.inputs["Surface"]),
    ):  # fmt: skip
        tree.links.new(source, target)
    for column, node in enumerate((place, creases, bump, front, behind, both, output)):
        node.location = (240 * column, -200 * (column % 2))
