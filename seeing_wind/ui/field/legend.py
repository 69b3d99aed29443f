"""The legend of the arrows: a bar of their colours with the strength at its ends, standing beside the field."""

from __future__ import annotations

import bpy
import numpy as np

from .arrows import COLOUR, arrow_material, ramp_colours
from .display import LEGEND_MARK, in_figures
from .node_groups import GroupBuilder, set_up_modifier

CELLS = 48
WIDTH = 0.06
"""Of the bar, relative to its height."""


def create_legend(
    name: str, peak: float, corner: np.ndarray, height: float, collection: bpy.types.Collection, parent: bpy.types.Object | None = None
) -> bpy.types.Object:
    """A bar that stands upright and is read from the front.

    Args:
        peak: strength at its upper end [N/m³].
        corner: (3,) its lower right corner in the world [scene units].
        height: [scene units].
        parent: what it follows, such as the field object.
    """
    rows = np.linspace(0.0, 1.0, CELLS + 1)
    vertices = np.array([(x * WIDTH * height, 0.0, z * height) for z in rows for x in (-1.0, 0.0)])
    faces = [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(CELLS)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces)
    strength = np.repeat(rows, 2)
    for key, values in (("strength", strength), ("confidence", np.ones_like(strength))):
        mesh.attributes.new(key, "FLOAT", "POINT").data.foreach_set("value", values.astype(np.float32))
    colours = np.concatenate([ramp_colours(strength), np.ones((len(strength), 1))], axis=1)
    mesh.attributes.new(COLOUR, "FLOAT_COLOR", "POINT").data.foreach_set("color", colours.astype(np.float32).ravel())
    mesh.color_attributes.active_color_name = COLOUR
    mesh.materials.append(arrow_material())
    obj = bpy.data.objects.new(name, mesh)
    obj[LEGEND_MARK] = True
    obj.location, obj.hide_render, obj.hide_select = corner.tolist(), True, True
    collection.objects.link(obj)
    if parent is not None:
        obj.parent, obj.matrix_parent_inverse = parent, parent.matrix_basis.inverted()
    group, parts = GroupBuilder(name), []
    for text, at in ((f"{in_figures(peak)} N/m³", height), ("0", 0.0)):
        letters = group.node("GeometryNodeStringToCurves", {"String": text, "Size": 0.09 * height})
        filled = group.node("GeometryNodeFillCurve", {0: group.node("GeometryNodeRealizeInstances", {0: letters.outputs[0]}).outputs[0]})
        place = {"Geometry": filled.outputs[0], "Translation": (0.03 * height, 0.0, at - 0.03 * height), "Rotation": (np.pi / 2, 0.0, 0.0)}
        parts.append(group.node("GeometryNodeTransform", place).outputs[0])
    join = group.node("GeometryNodeJoinGeometry")
    # the bar last, which puts it in front: its active colours then count for Solid view
    for part in (*parts, group.input.outputs["Geometry"]):
        group.tree.links.new(part, join.inputs[0])
    set_up_modifier(obj, group.finish(join.outputs[0]))
    return obj
