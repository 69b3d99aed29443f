"""The field on a lattice, for Geometry Nodes: a hidden mesh with the field's values, and the node group *Sample Wind* that reads it.

The values are the engine's, on the lattice it sampled. The mesh, a child of the field object, moves, turns and changes strength with it.
*Sample Wind* is marked as an asset: it can be dropped into any node tree, and its only link to a field is the object it is given.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .display import CARRIED, LOOP, SAMPLES_MARK, home_of, stride_of
from .lattice import SampledField
from .node_groups import GroupBuilder, points_of_current_frame, set_up_modifier
from .texture.reach import CONTINUE, FADE, Reach, left_near

SAMPLE_WIND = "Sample Wind"
FORCE, VELOCITY, COUNT, SURE, REACH = "force", "velocity", "lattice_count", "confidence", "reach"
"""Attributes: the force density [N/m³ divided by the length of a scene unit, as in the field object], the wind [scene units/s] if there is
one, the numbers of nodes along each axis, confidence in 0..1, and how the wind ends outside the box (see `set_reach`)."""
DISTANCE, LEFT = "distance", "left"
"""Attributes of a field that is not known everywhere: distance from the filmed object [scene units], and the share left there, 0..1."""

FOR_EVER = 1e6
"""Width of the fade [scene units] for a wind that is not to fade."""


def create_samples(field: bpy.types.Object, sampled: SampledField, frame_start: int, delay: int) -> bpy.types.Object:
    """Make the hidden child of a field object that holds its values.

    Args:
        sampled: in the field object's own coordinates [scene units]; forces in N/m³ divided by the length of a scene unit [m], so that
            force / density is in scene units per square second.
        frame_start: scene frame of clip frame 0.
        delay: scene frames by which the values are delayed: `field_object.SOLVER_DELAY`.
    """
    forces, counts = sampled.force, sampled.counts
    mesh = bpy.data.meshes.new(f"{field.name} Samples")
    mesh.vertices.add(forces.shape[0] * forces.shape[1])
    mesh.vertices.foreach_set("co", np.tile(sampled.points, (len(forces), 1)).astype(np.float32).ravel())
    many = np.broadcast_to(np.asarray(counts, dtype=np.float32), forces.shape)
    wind = {} if sampled.velocity is None else {VELOCITY: sampled.velocity}
    for name, values in {FORCE: forces, COUNT: many, **wind}.items():
        mesh.attributes.new(name, "FLOAT_VECTOR", "POINT").data.foreach_set("vector", values.astype(np.float32).ravel())
    mesh.attributes.new(REACH, "FLOAT_VECTOR", "POINT")
    near = {} if sampled.distance is None else {DISTANCE: sampled.distance, LEFT: np.ones_like(sampled.distance)}
    for name, values in {SURE: sampled.confidence, **near}.items():
        mesh.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", values.astype(np.float32).ravel())
    mesh.update()
    obj = bpy.data.objects.new(f"{field.name} Samples", mesh)
    obj[SAMPLES_MARK] = True
    obj.hide_render = obj.hide_viewport = obj.hide_select = True
    home_of(field, bpy.context.scene).objects.link(obj)
    obj.parent = field
    group = GroupBuilder(f"{field.name} Samples")
    current = points_of_current_frame(group, forces.shape[1], len(forces), frame_start, delay, field)
    # the strength of the field object applies here, too
    strength = group.strength(field)
    if near:
        strength = group.math("MULTIPLY", strength, group.attribute(LEFT))
    for name in (FORCE, *wind):
        current = group.node(
            "GeometryNodeStoreNamedAttribute",
            {"Geometry": current, "Name": name, "Value": group.scaled(group.attribute(name, "FLOAT_VECTOR"), strength)},
            data_type="FLOAT_VECTOR", domain="POINT",
        ).outputs["Geometry"]  # fmt: skip
    set_up_modifier(obj, group.finish(current))
    return obj


def set_reach(samples: bpy.types.Object, reach: Reach) -> None:
    """Store how the field of *Sample Wind* ends away from the filmed object.

    The attribute `LEFT` is the share left in the box; `REACH` holds the width of the fade outside it, and a falloff's power and radius.
    """
    row = (reach.width if reach.kind == FADE else FOR_EVER, reach.power if reach.kind == CONTINUE else 0.0, reach.radius)
    values = np.tile(np.asarray(row, dtype=np.float32), len(samples.data.vertices))
    samples.data.attributes[REACH].data.foreach_set("vector", values)
    if DISTANCE in samples.data.attributes:
        left = left_near(reach, _read(samples.data, DISTANCE))
        samples.data.attributes[LEFT].data.foreach_set("value", left.astype(np.float32))
    samples.data.update_tag()


def read_samples(samples: bpy.types.Object) -> SampledField:
    """The recovered values that a field object carries, in its own coordinates and units, see `create_samples`."""
    mesh = samples.data
    total = len(mesh.vertices)
    flat = {name: np.empty(3 * total, dtype=np.float32) for name in ("co", FORCE, VELOCITY) if name == "co" or name in mesh.attributes}
    mesh.vertices.foreach_get("co", flat["co"])
    for name in flat.keys() - {"co"}:
        mesh.attributes[name].data.foreach_get("vector", flat[name])
    size = int(np.prod([round(count) for count in mesh.attributes[COUNT].data[0].vector]))
    places = flat["co"].reshape(-1, 3)[:size].astype(np.float64)
    vectors = {name: flat[name].reshape(-1, size, 3).astype(np.float64) for name in flat if name != "co"}
    sure, distance = (_read(mesh, name).reshape(-1, size) if name in mesh.attributes else None for name in (SURE, DISTANCE))
    return SampledField(places, vectors[FORCE], sure, vectors.get(VELOCITY), distance)


def scale_samples(samples: bpy.types.Object, factor: float) -> None:
    """Multiply places, forces, velocities and distances of the values of a field object by a factor, as for another unit of length."""
    mesh = samples.data
    for owner, name, count in [
        (mesh.vertices, "co", 3), *((mesh.attributes[name].data, "vector", 3) for name in (FORCE, VELOCITY) if name in mesh.attributes),
        *((mesh.attributes[name].data, "value", 1) for name in (DISTANCE,) if name in mesh.attributes),
    ]:  # fmt: skip
        values = np.empty(count * len(owner), dtype=np.float32)
        owner.foreach_get(name, values)
        owner.foreach_set(name, values * np.float32(factor))
    mesh.update()


def rows_at(field: bpy.types.Object, times: np.ndarray, count: int) -> np.ndarray:
    """Indices (T,) of which of a field object's `count` clip frames act at times (T,) [scene frames], by the solvers' clock."""
    rows = np.floor((times - field["seeing_wind_frame_start"]) / stride_of(field) + 1e-4).astype(np.int64)
    return rows % count if field[LOOP] else np.clip(rows, 0, count - 1)


def _read(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """The values (T L,) of an attribute."""
    values = np.empty(len(mesh.vertices), dtype=np.float32)
    mesh.attributes[name].data.foreach_get("value", values)
    return values


def samples_of(field: bpy.types.Object) -> bpy.types.Object | None:
    """The object with the values of a field object; None if they are gone (if its library is lost, only the object's name remains)."""
    carried = field.get(CARRIED) or next((child for child in field.children if SAMPLES_MARK in child), None)
    return carried if carried is not None and carried.data is not None else None


def sample_wind_group(samples: bpy.types.Object | None = None, density: float = 1000.0) -> bpy.types.NodeTree:
    """The node group *Sample Wind*, made once per file and marked as an asset.

    Args:
        samples: default of its input *Wind*, the values of the field made last.
        density: default of its input *Density* [kg/m³].
    """
    tree = bpy.data.node_groups.get(SAMPLE_WIND)
    if tree is None:
        tree = _build(GroupBuilder(SAMPLE_WIND, modifier=False))
        tree.asset_mark()
        tree.asset_data.description = "The recovered wind at a place and the current frame"
        tree.asset_data.tags.new("Seeing Wind")
    inputs = {item.name: item for item in tree.interface.items_tree if item.item_type == "SOCKET" and item.in_out == "INPUT"}
    if samples is not None:
        inputs["Wind"].default_value = samples
        inputs["Density"].default_value = density
    return tree


def _build(group: GroupBuilder) -> bpy.types.NodeTree:
    """Build the group: look up the eight nodes around a place, in the coordinates of the field object, and interpolate linearly."""
    wind = group.parameter("Wind", "Object", None, "The Samples object under the recovered wind")
    place = group.parameter("Position", "Vector", None, "Where, in the same space as the object")
    interface = next(item for item in group.tree.interface.items_tree if item.item_type == "SOCKET" and item.name == "Position")
    interface.default_input, interface.hide_value = "POSITION", True
    density = group.parameter("Density", "Float", 1000.0, "Of the matter that the wind moves [kg/m³]", minimum=1e-3)
    mass = group.parameter("Mass", "Float", 1.0, "Of each point [kg]; for Force", minimum=0.0)

    info = group.node("GeometryNodeObjectInfo", {"Object": wind}, transform_space="RELATIVE")
    own = group.node("GeometryNodeObjectInfo", {"Object": wind}, transform_space="ORIGINAL").outputs["Geometry"]
    into = group.node("FunctionNodeInvertMatrix", {0: info.outputs["Transform"]}).outputs[0]
    local = group.node("FunctionNodeTransformPoint", {0: place, 1: into}).outputs[0]
    box = group.node("GeometryNodeBoundBox", {"Geometry": own})
    low, high = box.outputs["Min"], box.outputs["Max"]
    count = _sample(group, own, group.attribute(COUNT, "FLOAT_VECTOR"), 0)
    last = group.vector("SUBTRACT", count, (1.0, 1.0, 1.0))
    # outside the box, the value at the nearest place on it is used, weakened by the reach
    share = group.vector("DIVIDE", group.vector("SUBTRACT", local, low), group.vector("SUBTRACT", high, low))
    where = group.vector("MULTIPLY", group.vector("MINIMUM", group.vector("MAXIMUM", share, (0.0,) * 3), (1.0,) * 3), last)
    corner = group.vector("FLOOR", group.vector("MINIMUM", where, group.vector("SUBTRACT", last, (1.0e-3,) * 3)))
    t = group.split(group.vector("SUBTRACT", where, corner))
    indices = _corner_indices(group, corner, count)
    force, wind_there = (
        _mix(group, [_sample(group, own, group.attribute(name, "FLOAT_VECTOR"), index) for index in indices], t, "VECTOR")
        for name in (FORCE, VELOCITY)
    )
    sure = _mix(group, [_sample(group, own, group.attribute(SURE), index, "FLOAT") for index in indices], t, "FLOAT")

    left = _left(group, local, low, high, _sample(group, own, group.attribute(REACH, "FLOAT_VECTOR"), 0))
    sure = group.math("MULTIPLY", sure, left)
    turned, blowing = (
        group.node("FunctionNodeTransformDirection", {0: group.scaled(each, left), 1: info.outputs["Transform"]}).outputs[0]
        for each in (force, wind_there)
    )
    acceleration = group.scaled(turned, group.math("DIVIDE", 1.0, density))
    group.result("Force Density", "Vector", turned, "N/m³ in the object's space")
    group.result("Acceleration", "Vector", acceleration, "Of matter of that density [m/s²]")
    group.result("Force", "Vector", group.scaled(acceleration, mass), "On a point of that mass and density [N]")
    group.result("Wind Velocity", "Vector", blowing, "Of the air, in the object's space [m/s]; zero where the field is a force only")
    group.result("Confidence", "Float", sure, "0: a guess, 1: well determined by the clip")
    return group.finish()


def _left(group: GroupBuilder, place: Any, low: Any, high: Any, reach: Any) -> Any:
    """Share of the wind that is left at a place outside the box, as in `texture.reach.left_of`."""
    nearest = group.vector("MINIMUM", group.vector("MAXIMUM", place, low), high)
    distance = group.vector("LENGTH", group.vector("SUBTRACT", place, nearest))
    width, power, radius = group.split(reach)
    fade = group.node(
        "ShaderNodeMapRange", {"Value": distance, "From Min": 0.0, "From Max": width, "To Min": 1.0, "To Max": 0.0},
        interpolation_type="SMOOTHSTEP", clamp=True,
    ).outputs["Result"]  # fmt: skip
    near = group.math("ADD", radius, 1.0)
    fall = group.math("POWER", group.math("DIVIDE", near, group.math("ADD", near, distance)), power)
    return group.math("MULTIPLY", fade, fall)


def _sample(group: GroupBuilder, geometry: Any, value: Any, index: Any, kind: str = "FLOAT_VECTOR") -> Any:
    return group.node(
        "GeometryNodeSampleIndex", {"Geometry": geometry, "Value": value, "Index": index}, data_type=kind, domain="POINT"
    ).outputs["Value"]


def _corner_indices(group: GroupBuilder, corner: Any, count: Any) -> list[Any]:
    """Indices of the eight nodes of a cell, z fastest."""
    (x, y, z), (_, ny, nz) = group.split(corner), group.split(count)
    plane = group.math("MULTIPLY", ny, nz)
    first = group.math("ADD", group.math("ADD", group.math("MULTIPLY", x, plane), group.math("MULTIPLY", y, nz)), z)
    indices = []
    for dx in (0, 1):
        for dy in (0, 1):
            row = first if not dx else group.math("ADD", first, plane)
            row = row if not dy else group.math("ADD", row, nz)
            # a quarter makes the conversion to an integer robust against rounding
            indices += [group.math("ADD", row, 0.25), group.math("ADD", row, 1.25)]
    return indices


def _mix(group: GroupBuilder, corners: list[Any], t: list[Any], kind: str) -> Any:
    """Trilinear interpolation: combine the corners in pairs along z, then y, then x."""
    for along in (2, 1, 0):
        pairs = zip(corners[::2], corners[1::2], strict=True)
        corners = [_between(group, a, b, t[along], kind) for a, b in pairs]
    return corners[0]


def _between(group: GroupBuilder, a: Any, b: Any, factor: Any, kind: str) -> Any:
    node = group.node("ShaderNodeMix", data_type=kind)
    sockets = {socket.identifier: socket for socket in node.inputs}
    ending = "Vector" if kind == "VECTOR" else "Float"
    for name, value in (("Factor_Float", factor), (f"A_{ending}", a), (f"B_{ending}", b)):
        group.tree.links.new(value, sockets[name])
    return next(socket for socket in node.outputs if socket.identifier == f"Result_{ending}")
