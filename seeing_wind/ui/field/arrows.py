"""Arrows that show a force field, purple where it is weak and red where it is strong, as in the paper's figures.

All frames lie in one mesh of points (see `node_groups`); a Geometry Nodes modifier puts an arrow on every point of the current frame.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...engine.errors import UsageError
from ..scene_units import metres_per_unit
from .display import ARROWS_MATERIAL, SURE
from .node_groups import GroupBuilder, points_of_current_frame, set_up_modifier
from .texture.reach import left_near, reach_of

WEAK_TO_STRONG = (
    (0.00, (0.5, 0.0, 1.0)),
    (0.25, (0.0, 0.707, 0.924)),
    (0.50, (0.5, 1.0, 0.707)),
    (0.75, (1.0, 0.707, 0.383)),
    (1.00, (1.0, 0.0, 0.0)),
)
"""Strength in 0..1 and its colour (sRGB): Matplotlib's `rainbow`, whose ends 8000FF and FF0000 the paper's first figure names."""

PEAK_QUANTILE = 0.99
"""Arrows are drawn relative to this quantile of the strength, so that one outlier does not make all others small."""

CONFIDENCE_SHOWN = 0.05
"""Default of the modifier's setting: arrows of lower confidence are hidden."""

FAINTEST = 0.15
"""Opacity of an arrow of confidence 0, if such arrows are shown at all."""

COLOUR = "wind_colour"
"""Colour attribute, for Solid view (Viewport Shading > Color > Attribute)."""

STRENGTH_SHOWN = 0.01
"""Arrows below this fraction of the peak are hidden, as their direction is meaningless."""

AWAY = "distance"
"""Attribute of the arrows' mesh: distance of each arrow from the filmed object [scene units]. Absent if the field is known everywhere."""


def create_arrows(
    scene: bpy.types.Scene,
    name: str,
    points: np.ndarray,
    vectors: np.ndarray,
    confidence: np.ndarray | None = None,
    frame_start: int = 1,
    *,
    distance: np.ndarray | None = None,
    units: str = "N/m³",
    parent: bpy.types.Object | None = None,
    collection: bpy.types.Collection | None = None,
) -> bpy.types.Object:
    """Make the animated arrows of a sampled field and link them to the scene. The longest, in red, stand for nearly the largest strength;
    their length is chosen so that neighbours do not overlap.

    Args:
        scene: its length unit is respected.
        points: (M, 3) where the arrows start [m, world], or (T, M, 3) for arrows that ride on something.
        vectors: (T, M, 3) the field there; row t is shown from the scene frame of clip frame t on.
        confidence: (T, M) in 0..1; weakly known arrows are more transparent, hardly known ones hidden. None: all are sure.
        frame_start: scene frame of clip frame 0.
        distance: (T, M) of the arrows from the filmed object [m], by which the reach of the field object weakens them.
        units: the unit of the strength, for panel and legend.
        parent: the field object that the arrows follow when it is moved, turned or made stronger.
        collection: where to link them, by default the scene's own collection.

    Raises:
        UsageError: when the arrays do not agree or are not finite.
    """
    vectors = np.asarray(vectors, dtype=np.float64)
    if vectors.ndim != 3 or vectors.shape[2] != 3 or 0 in vectors.shape or np.shape(points) not in (vectors.shape, vectors.shape[1:]):
        raise UsageError(
            f"Arrows of the shape {vectors.shape} do not fit points of the shape {np.shape(points)}.", "Expected (T, M, 3) for (M, 3)."
        )
    if confidence is not None and np.shape(confidence) != vectors.shape[:2]:
        raise UsageError(f"The confidence has the shape {np.shape(confidence)}.", f"Expected {vectors.shape[:2]}.")
    if not (np.isfinite(vectors).all() and np.isfinite(points).all()):
        raise UsageError("The sampled field is not finite everywhere.", "Recover it again.")
    unit = metres_per_unit(scene)
    positions = np.broadcast_to(np.asarray(points, dtype=np.float64) / unit, vectors.shape)
    size = np.linalg.norm(vectors, axis=-1)
    peak = float(np.quantile(size, PEAK_QUANTILE)) or 1.0
    # at the field's own place: Blender draws a dashed line from every child to its parent
    place = np.zeros(3) if parent is None else np.array(parent.matrix_basis.translation)
    sure = np.ones_like(size) if confidence is None else np.asarray(confidence)
    away = None if distance is None else np.asarray(distance) / unit
    obj = bpy.data.objects.new(name, _mesh(name, positions - place, vectors, sure, away))
    set_up_modifier(obj, _arrow_group(name, positions.shape[1], len(vectors), frame_start, _free_length(positions[0]), parent))
    obj["seeing_wind_peak"], obj["seeing_wind_units"] = peak, units
    _show(obj, size, sure)
    (collection or scene.collection).objects.link(obj)
    if parent is not None:
        obj.parent, obj.matrix_parent_inverse, obj.location = parent, parent.matrix_basis.inverted(), place.tolist()
        show_reach(obj, parent)
    return obj


def show_reach(arrows: bpy.types.Object, field: bpy.types.Object) -> None:
    """Redraw arrows with the strength that solvers feel there: a field that fades is weak away from the filmed object."""
    mesh = arrows.data
    if AWAY not in mesh.attributes or mesh.library is not None:
        return
    shape = (len(arrows[SURE]), -1)
    size, sure, away = (_read(mesh, name).reshape(shape) for name in ("force", "confidence", AWAY))
    box = np.array([vertex.co[:] for vertex in field.data.vertices])
    _show(arrows, size * left_near(reach_of(field["seeing_wind_reach"], box), away), sure)


def _read(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """The values of an attribute; for vectors, their lengths."""
    attribute = mesh.attributes[name]
    vectors = attribute.data_type == "FLOAT_VECTOR"
    flat = np.empty(len(mesh.vertices) * (3 if vectors else 1), dtype=np.float32)
    attribute.data.foreach_get("vector" if vectors else "value", flat)
    return np.linalg.norm(flat.reshape(-1, 3), axis=-1) if vectors else flat


def _show(arrows: bpy.types.Object, size: np.ndarray, sure: np.ndarray) -> None:
    """Set length and colour of all arrows from the field's strength (T, M) [its own unit] and confidence (T, M)."""
    mesh, strength = arrows.data, np.minimum(size / arrows["seeing_wind_peak"], 1.0)
    colours = np.concatenate([ramp_colours(strength), (FAINTEST + (1.0 - FAINTEST) * sure)[..., None]], axis=-1)
    mesh.attributes["strength"].data.foreach_set("value", strength.astype(np.float32).ravel())
    mesh.attributes[COLOUR].data.foreach_set("color", colours.astype(np.float32).ravel())
    mesh.update_tag()
    arrows[SURE] = np.where(strength > STRENGTH_SHOWN, sure, 0.0).max(axis=1).tolist()


def _free_length(points: np.ndarray) -> float:
    """Nine tenths of the median distance to the nearest neighbour, at least 3 % of the set's diagonal (points of a surface lie denser)."""
    some = points[:: max(1, len(points) // 256)]
    distance = np.linalg.norm(some[:, None] - points[None], axis=-1)
    nearest = float(np.median(np.sort(distance, axis=1)[:, 1])) if len(points) > 1 else 0.0
    return max(0.9 * nearest, 0.03 * float(np.linalg.norm(np.ptp(points, axis=0)))) or 0.1


def _mesh(name: str, positions: np.ndarray, vectors: np.ndarray, sure: np.ndarray, away: np.ndarray | None) -> bpy.types.Mesh:
    """All frames (T, M, ...) as T * M vertices with the attributes force [unit of the field] and confidence (0..1); strength (0..1) and
    colour are left to `_show`."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(sure.size)
    mesh.vertices.foreach_set("co", positions.astype(np.float32).ravel())
    mesh.attributes.new("force", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", vectors.astype(np.float32).ravel())
    for key, values in {"confidence": sure, **({} if away is None else {AWAY: away})}.items():
        mesh.attributes.new(key, "FLOAT", "POINT").data.foreach_set("value", values.astype(np.float32).ravel())
    mesh.attributes.new("strength", "FLOAT", "POINT")
    mesh.attributes.new(COLOUR, "FLOAT_COLOR", "POINT")
    mesh.color_attributes.active_color_name = COLOUR
    mesh.materials.append(arrow_material())
    mesh.update()
    return mesh


def ramp_colours(strength: np.ndarray) -> np.ndarray:
    """Strength (...) in 0..1 -> colour (..., 3) in linear light."""
    at = [position for position, _ in WEAK_TO_STRONG]
    channels = zip(*(_linear(colour) for _, colour in WEAK_TO_STRONG), strict=True)
    return np.stack([np.interp(strength, at, channel) for channel in channels], axis=-1)


def _arrow_group(
    name: str, points: int, frames: int, frame_start: int, length: float, field: bpy.types.Object | None
) -> bpy.types.NodeTree:
    """The modifier's node group: it takes the current frame's points, selects those worth showing, and puts an arrow on each."""
    group = GroupBuilder(f"{name} Arrows")
    current = points_of_current_frame(group, points, frames, frame_start, delay=0, field=field)
    scale = group.parameter("Length", "Float", length, "Length of the longest arrows", minimum=0.0, unit="DISTANCE")
    least = group.parameter("Confidence Shown", "Float", CONFIDENCE_SHOWN, "Arrows that the clip says less about are hidden", minimum=0.0)
    strength = group.attribute("strength")
    shown = group.math(
        "MULTIPLY", group.math("GREATER_THAN", strength, STRENGTH_SHOWN), group.math("GREATER_THAN", group.attribute("confidence"), least)
    )
    shown = group.math("MULTIPLY", shown, _thinned(group, points))
    shown = group.math("MULTIPLY", shown, _in_slice(group, current))
    if field is not None:
        scale = group.math("MULTIPLY", scale, group.strength(field))
    rotation = group.node("FunctionNodeAlignRotationToVector", {"Vector": group.attribute("force", "FLOAT_VECTOR")}, axis="Z").outputs[
        "Rotation"
    ]
    # weak arrows lose less of their width than of their length, so that they stay visible
    width = group.math("MULTIPLY", scale, group.math("POWER", strength, 0.6))
    size = group.node("ShaderNodeCombineXYZ", {"X": width, "Y": width, "Z": group.math("MULTIPLY", scale, strength)}).outputs[0]
    instances = group.node(
        "GeometryNodeInstanceOnPoints",
        {"Points": current, "Selection": shown, "Instance": _unit_arrow(group), "Rotation": rotation, "Scale": size},
    ).outputs[0]
    realised = group.node("GeometryNodeRealizeInstances", {"Geometry": instances}).outputs[0]
    painted = group.node("GeometryNodeSetMaterial", {"Geometry": realised, "Material": arrow_material()}).outputs[0]
    # Solid view takes its colours from a mesh's active attribute, which only the input mesh defines: one bare vertex of it is joined
    # in front (what is linked last comes first)
    first = group.math("LESS_THAN", group.node("GeometryNodeInputIndex").outputs[0], 0.5)
    named = group.node(
        "GeometryNodeSeparateGeometry", {"Geometry": group.input.outputs["Geometry"], "Selection": first}, domain="POINT"
    ).outputs["Selection"]
    join = group.node("GeometryNodeJoinGeometry")
    for part in (painted, named):
        group.tree.links.new(part, join.inputs[0])
    return group.finish(join.outputs[0])


def _thinned(group: GroupBuilder, points: int) -> Any:
    """1 for the arrows that the setting Density keeps, the same ones in every frame."""
    density = group.parameter("Density", "Float", 1.0, "Share of the arrows that is drawn (0 to 1)", minimum=0.0)
    number = group.math("MODULO", group.node("GeometryNodeInputIndex").outputs[0], float(points))
    dice = group.node("FunctionNodeRandomValue", {"ID": number}, data_type="FLOAT")
    value = next(socket for socket in dice.outputs if socket.type == "VALUE" and socket.enabled)
    return group.math("LESS_THAN", value, density)


def _in_slice(group: GroupBuilder, current: Any) -> Any:
    """1 for the arrows inside the slice that the settings ask for; without a slice, 1 for all."""
    axis = group.parameter("Slice Axis", "Int", 0, "0: all arrows, 1 to 3: a slice across X, Y or Z", minimum=0)
    at = group.parameter("Slice Position", "Float", 0.5, "Where in the field's box: 0 at its lower, 1 at its upper end", minimum=0.0)
    thickness = group.parameter("Slice Thickness", "Float", 0.2, "Share of the box that the slice is thick", minimum=0.0)
    box = group.node("GeometryNodeBoundBox", {"Geometry": current})
    low, high = box.outputs["Min"], box.outputs["Max"]
    place = group.node("GeometryNodeInputPosition").outputs[0]
    share = group.split(group.vector("DIVIDE", group.vector("SUBTRACT", place, low), group.vector("SUBTRACT", high, low)))
    inside: Any = group.math("COMPARE", axis, 0.0, 0.5)
    for number, value in enumerate(share, start=1):
        near = group.math("LESS_THAN", group.math("ABSOLUTE", group.math("SUBTRACT", value, at)), group.math("MULTIPLY", thickness, 0.5))
        inside = group.math("MAXIMUM", inside, group.math("MULTIPLY", group.math("COMPARE", axis, float(number), 0.5), near))
    return inside


def _unit_arrow(group: GroupBuilder) -> bpy.types.NodeSocket:
    """An arrow from the origin to (0, 0, 1)."""
    shaft = group.node("GeometryNodeMeshCylinder", {"Vertices": 8, "Radius": 0.035, "Depth": 0.7}, fill_type="NONE").outputs["Mesh"]
    shaft = group.node("GeometryNodeTransform", {"Geometry": shaft, "Translation": (0.0, 0.0, 0.35)}).outputs[0]
    head = group.node("GeometryNodeMeshCone", {"Vertices": 12, "Radius Top": 0.0, "Radius Bottom": 0.11, "Depth": 0.35}).outputs["Mesh"]
    head = group.node("GeometryNodeTransform", {"Geometry": head, "Translation": (0.0, 0.0, 0.65)}).outputs[0]
    join = group.node("GeometryNodeJoinGeometry")
    for part in (shaft, head):
        group.tree.links.new(part, join.inputs[0])
    return join.outputs[0]


def arrow_material() -> bpy.types.Material:
    """The material shared by all arrows: it emits the colour of the strength and is more transparent where the confidence is low."""
    material = bpy.data.materials.get(ARROWS_MATERIAL)
    if material is not None:
        return material
    material = bpy.data.materials.new(ARROWS_MATERIAL)
    material.use_nodes = True
    material.surface_render_method = "BLENDED"
    material.diffuse_color = (*_linear((0.5, 0.0, 1.0)), 1.0)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    strength, sure = nodes.new("ShaderNodeAttribute"), nodes.new("ShaderNodeAttribute")
    strength.attribute_name, sure.attribute_name = "strength", "confidence"
    ramp, opacity, emission, clear, mix, output = (
        nodes.new(f"ShaderNode{kind}")
        for kind in ("ValToRGB", "MapRange", "Emission", "BsdfTransparent", "MixShader", "OutputMaterial")
    )
    _fill_ramp(ramp.color_ramp)
    opacity.inputs["To Min"].default_value = FAINTEST
    links.new(strength.outputs["Fac"], ramp.inputs[0])
    links.new(sure.outputs["Fac"], opacity.inputs["Value"])
    links.new(ramp.outputs[0], emission.inputs["Color"])
    links.new(opacity.outputs[0], mix.inputs[0])
    links.new(clear.outputs[0], mix.inputs[1])
    links.new(emission.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    for column, node in enumerate((strength, sure, ramp, opacity, emission, clear, mix, output)):
        node.location = (240 * (column // 2), -320 * (column % 2))
    return material


def _fill_ramp(ramp: bpy.types.ColorRamp) -> None:
    while len(ramp.elements) < len(WEAK_TO_STRONG):
        ramp.elements.new(0.5)
    for element, (position, colour) in zip(ramp.elements, WEAK_TO_STRONG, strict=True):
        element.position, element.color = position, (*_linear(colour), 1.0)


def _linear(colour: tuple[float, float, float]) -> tuple[float, ...]:
    """sRGB -> linear light, as Blender's sockets take it."""
    return tuple(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour)
