"""The legend of the arrows: a bar of their colours with the strength at its ends, standing beside the field."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .arrows import COLOUR, arrow_material, ramp_colours
from .display import LEGEND_MARK, in_figures
from .node_groups import GroupBuilder, set_up_modifier

CELLS = 48
WIDTH = 0.06
"""Width of the bar, relative to its height."""
SIZE, LETTER = 0.15, 0.52
"""Size of the figures, relative to the height of the bar; and the mean width of a letter, relative to its size."""
DARK, LIGHT = 0.01, 1.0
"""Grey levels of the plate and of the figures on it."""


def create_legend(
    name: str, peak: float, units: str, corner: np.ndarray, height: float, collection: bpy.types.Collection,
    parent: bpy.types.Object,
) -> bpy.types.Object:
    """Make an upright bar that is read from the front.

    Args:
        peak, units: strength at its upper end, and the unit.
        corner: (3,) lower right corner of the bar in the world [scene units].
        height: of the bar [scene units].
        parent: the field object, which the legend follows.
    """
    # its origin is its parent's, as Blender draws a dashed line between the two
    place = np.array(parent.matrix_basis.translation)
    aside = corner - place
    rows = np.linspace(0.0, 1.0, CELLS + 1)
    vertices = np.array([(x * WIDTH * height, 0.0, z * height) for z in rows for x in (-1.0, 0.0)])
    faces = [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(CELLS)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata((vertices + aside).tolist(), [], faces)
    strength = np.repeat(rows, 2)
    for key, values in (("strength", strength), ("confidence", np.ones_like(strength))):
        mesh.attributes.new(key, "FLOAT", "POINT").data.foreach_set("value", values.astype(np.float32))
    colours = np.concatenate([ramp_colours(strength), np.ones((len(strength), 1))], axis=1)
    mesh.attributes.new(COLOUR, "FLOAT_COLOR", "POINT").data.foreach_set("color", colours.astype(np.float32).ravel())
    mesh.color_attributes.active_color_name = COLOUR
    mesh.materials.append(arrow_material())
    obj = bpy.data.objects.new(name, mesh)
    obj[LEGEND_MARK] = True
    obj.location, obj.hide_render, obj.hide_select = place.tolist(), True, True
    collection.objects.link(obj)
    obj.parent, obj.matrix_parent_inverse = parent, parent.matrix_basis.inverted()
    group = GroupBuilder(name)
    written = {f"{in_figures(peak)} {units}": height, in_figures(0.5 * peak): 0.5 * height, "0": 0.0}
    # a dark plate behind the bar and its figures makes them readable on any footage
    wide = 0.2 * height + LETTER * SIZE * height * max(len(text) for text in written)
    size = {"Size X": wide, "Size Y": 1.25 * height, "Vertices X": 2, "Vertices Y": 2}
    plate = group.node("GeometryNodeMeshGrid", size).outputs["Mesh"]
    parts = [_placed(group, plate, aside + [0.5 * wide - 0.13 * height, 0.01 * height, 0.5 * height], DARK)]
    for text, at in written.items():
        letters = group.node("GeometryNodeStringToCurves", {"String": text, "Size": SIZE * height})
        filled = group.node("GeometryNodeFillCurve", {0: group.node("GeometryNodeRealizeInstances", {0: letters.outputs[0]}).outputs[0]})
        parts.append(_placed(group, filled.outputs[0], aside + [0.03 * height, 0.0, at - 0.3 * SIZE * height], LIGHT))
    join = group.node("GeometryNodeJoinGeometry")
    # the bar is linked last and so comes first: Solid view then uses its active colour attribute
    for part in (*parts, group.input.outputs["Geometry"]):
        group.tree.links.new(part, join.inputs[0])
    set_up_modifier(obj, group.finish(join.outputs[0]))
    return obj


def _placed(group: GroupBuilder, geometry: Any, at: np.ndarray, colour: float) -> Any:
    """Geometry of the XY plane, turned upright, in one shade of grey whatever Solid view takes its colours from."""
    upright = {"Geometry": geometry, "Translation": at.tolist(), "Rotation": (np.pi / 2, 0.0, 0.0)}
    turned = group.node("GeometryNodeTransform", upright).outputs[0]
    painted = group.node("GeometryNodeSetMaterial", {"Geometry": turned, "Material": _material(colour)}).outputs[0]
    return group.node(
        "GeometryNodeStoreNamedAttribute", {"Geometry": painted, "Name": COLOUR, "Value": (colour, colour, colour, 1.0)},
        data_type="FLOAT_COLOR", domain="POINT",
    ).outputs["Geometry"]  # fmt: skip


def _material(colour: float) -> bpy.types.Material:
    """A material that emits a shade of grey, created once per file."""
    name = f"Seeing Wind Legend {colour:g}"
    material = bpy.data.materials.get(name)
    if material is None:
        material = bpy.data.materials.new(name)
        material.diffuse_color, material.use_nodes = (colour, colour, colour, 1.0), True
        nodes = material.node_tree.nodes
        nodes.clear()
        emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
        emission.inputs["Color"].default_value = (colour, colour, colour, 1.0)
        material.node_tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material
