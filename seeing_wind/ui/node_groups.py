"""Building Geometry Nodes groups in few words, and the part that the field object and its arrows share: frames kept in one mesh.

All frames of an animated point set lie in one mesh, frame after frame; the modifier keeps the points of the current frame. So an
object carries its whole animation in itself: no handlers, no keyframes, no second object, nothing to lose in a save or an append.
"""

from __future__ import annotations

from typing import Any

import bpy


class GroupBuilder:
    """A new geometry node group with a geometry input and output. `node` adds a node, `link` its inputs."""

    def __init__(self, name: str) -> None:
        self.tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
        self.tree.is_modifier = True
        self.tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        self.tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
        self.input = self.tree.nodes.new("NodeGroupInput")
        self.output = self.tree.nodes.new("NodeGroupOutput")

    def parameter(self, name: str, kind: str, default: float | int | bool, description: str, minimum: float | None = None) -> Any:
        """A setting shown in the modifier; returns its socket. `kind` is Float or Int."""
        socket = self.tree.interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        socket.default_value, socket.description = default, description
        if minimum is not None:
            socket.min_value = minimum
        return self.input.outputs[name]

    def node(self, kind: str, inputs: dict[int | str, Any] | None = None, **properties: Any) -> Any:
        """A node of type `kind` with its properties; `inputs` maps sockets to a value or to the output socket to link."""
        node = self.tree.nodes.new(kind)
        for key, value in properties.items():
            setattr(node, key, value)
        for key, value in (inputs or {}).items():
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, node.inputs[key])
            else:
                node.inputs[key].default_value = value
        return node

    def math(self, operation: str, *values: Any) -> Any:
        """Output socket of a math node."""
        return self.node("ShaderNodeMath", dict(enumerate(values)), operation=operation).outputs[0]

    def attribute(self, name: str, kind: str = "FLOAT") -> Any:
        """Output socket of a named attribute; `kind` is FLOAT or FLOAT_VECTOR."""
        return self.node("GeometryNodeInputNamedAttribute", {"Name": name}, data_type=kind).outputs["Attribute"]

    def finish(self, geometry: Any) -> bpy.types.NodeTree:
        """Link the result, lay the nodes out from left to right, and return the group."""
        self.tree.links.new(geometry, self.output.inputs[0])
        for column, node in enumerate([self.input, *(n for n in self.tree.nodes if n not in (self.input, self.output)), self.output]):
            node.location = (180 * (column // 2), -220 * (column % 2))
        return self.tree


def points_of_current_frame(group: GroupBuilder, points: int, frames: int, frame_start: int, delay: int) -> Any:
    """The part of the input mesh that belongs to the current frame, as a geometry socket.

    Args:
        points: points of one frame.
        frames: how many frames the mesh holds; before the first and after the last these two stay.
        frame_start: scene frame of the first.
        delay: scene frames by which they are late.
    """
    first = group.parameter("First Frame", "Int", frame_start, "Scene frame of the clip's first picture")
    now = group.node("GeometryNodeInputSceneTime").outputs["Frame"]
    frame = group.math("FLOOR", group.math("SUBTRACT", now, group.math("ADD", first, float(delay))))
    frame = group.math("MINIMUM", group.math("MAXIMUM", frame, 0.0), float(frames - 1))
    # half a point keeps the division away from whole numbers, where rounding could go either way
    index = group.math("ADD", group.node("GeometryNodeInputIndex").outputs[0], 0.5)
    owner = group.math("FLOOR", group.math("DIVIDE", index, float(points)))
    same = group.math("COMPARE", owner, frame, 0.5)
    return group.node(
        "GeometryNodeSeparateGeometry", {"Geometry": group.input.outputs["Geometry"], "Selection": same}, domain="POINT"
    ).outputs["Selection"]


def set_up_modifier(obj: bpy.types.Object, tree: bpy.types.NodeTree) -> bpy.types.Modifier:
    """Put a group on an object as its modifier."""
    modifier = obj.modifiers.new(tree.name, "NODES")
    modifier.node_group = tree
    return modifier
