"""The look of inserted cloth that has no material of its own: matt, slightly fuzzy, and bright when lit from behind."""

from __future__ import annotations

import math

import bpy

from ...engine.materials import SHEETS

SUNK = 0.2
"""Areal density [kg/m²] at which the transmitted share of the light falls to `THIN` / e. With this value, shirting of 120 g/m² transmits
a third of the light and denim of 400 g/m² a twelfth. Chosen."""
THIN = 0.6
"""Share of the unabsorbed light that the thinnest cloth transmits."""
WHITE = (0.80, 0.79, 0.76, 1.0)
"""Colour of washed cotton (linear RGBA)."""
CREASES, DEEP = 7.0, 0.35
"""Number of creases along the cloth, and the strength of their bump."""


def dress(obj: bpy.types.Object, preset: str) -> bool:
    """Give a mesh without any material the material of a library cloth, and smooth shading. Returns whether it did so."""
    sheet = SHEETS.get(preset)
    if sheet is None or not sheet.woven or obj.data.library is not None or any(obj.material_slots):
        return False
    obj.data.materials.append(cloth_material(preset))
    obj.data.shade_smooth()
    return True


def cloth_material(preset: str) -> bpy.types.Material:
    """The material of a library cloth, created once per file."""
    name = f"Seeing Wind {preset.replace('_', ' ').title()}"
    material = bpy.data.materials.get(name)
    if material is None:
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        _build(material.node_tree, THIN * math.exp(-SHEETS[preset].areal_density / SUNK))
        material.diffuse_color = WHITE
    return material


def _build(tree: bpy.types.NodeTree, through: float) -> None:
    """Build the nodes of a surface that scatters the share `through` of the light forwards instead of back."""
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
        # rest coordinates, so that the creases move with the cloth
        (place.outputs["Generated"], creases.inputs["Vector"]), (creases.outputs[0], bump.inputs["Height"]),
        (bump.outputs[0], front.inputs["Normal"]), (bump.outputs[0], behind.inputs["Normal"]), (front.outputs[0], both.inputs[1]),
        (behind.outputs[0], both.inputs[2]), (both.outputs[0], output.inputs["Surface"]),
    ):  # fmt: skip
        tree.links.new(source, target)
    for column, node in enumerate((place, creases, bump, front, behind, both, output)):
        node.location = (240 * column, -200 * (column % 2))
