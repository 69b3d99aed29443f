"""Concise building of Geometry Nodes groups, and the nodes that field values and arrows share: selecting a frame from a mesh of all.

All frames of an animated point set lie in one mesh, frame after frame; the modifier keeps the points of the current frame. The object thus
holds its whole animation, without handlers, keyframes or a second object, and nothing is lost when it is saved or appended.
"""

from __future__ import annotations

from typing import Any

import bpy

from .display import LOOP


class GroupBuilder:
    """Builder of a new geometry node group. `node` adds a node and links its inputs. A modifier's group has a geometry input and output."""

    def __init__(self, name: str, modifier: bool = True) -> None:
        self.tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
        self.tree.is_modifier = modifier
        if modifier:
            self.tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
            self.tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
        self.input = self.tree.nodes.new("NodeGroupInput")
        self.output = self.tree.nodes.new("NodeGroupOutput")

    def parameter(self, name: str, kind: str, default: Any, description: str, minimum: float | None = None, unit: str = "NONE") -> Any:
        """Add a setting shown in the modifier; returns its socket.

        `kind` is Float, Int, Bool, Vector or Object; a `default` of None keeps Blender's; `unit` is the socket's subtype, such as DISTANCE.
        """
        socket = self.tree.interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        socket.description = description
        if default is not None:
            socket.default_value = default
        if minimum is not None:
            socket.min_value = minimum
        if unit != "NONE":
            socket.subtype = unit
        return self.input.outputs[name]

    def result(self, name: str, kind: str, value: Any, description: str) -> None:
        """Add an output to a group that is not a modifier's."""
        self.tree.interface.new_socket(name, in_out="OUTPUT", socket_type=f"NodeSocket{kind}").description = description
        self.tree.links.new(value, self.output.inputs[name])

    def node(self, kind: str, inputs: dict[int | str, Any] | None = None, **properties: Any) -> Any:
        """Add a node of type `kind` with its properties; `inputs` maps each socket to a value or to the output socket to link."""
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

    def vector(self, operation: str, *values: Any) -> Any:
        """Output socket of a vector math node; for DOT_PRODUCT, LENGTH and DISTANCE, its scalar output."""
        node = self.node("ShaderNodeVectorMath", dict(enumerate(values)), operation=operation)
        return node.outputs["Value" if operation in ("DOT_PRODUCT", "LENGTH", "DISTANCE") else "Vector"]

    def scaled(self, vector: Any, factor: Any) -> Any:
        """Output socket of a vector times a number."""
        return self.node("ShaderNodeVectorMath", {0: vector, "Scale": factor}, operation="SCALE").outputs["Vector"]

    def split(self, vector: Any) -> list[Any]:
        """Output sockets of a vector's components x, y, z."""
        return list(self.node("ShaderNodeSeparateXYZ", {0: vector}).outputs)

    def driven(self, name: str, obj: bpy.types.Object, paths: dict[str, str], expression: str, start: float) -> Any:
        """Output socket of a number driven by properties of an object; `expression` refers to them by the keys of `paths`.

        The expression must be plain arithmetic, which Blender evaluates without permission to run scripts.
        """
        node = self.node("ShaderNodeValue", name=name, label=name)
        node.outputs[0].default_value = start
        driver = node.outputs[0].driver_add("default_value").driver
        for key, path in paths.items():
            variable = driver.variables.new()
            variable.name, variable.targets[0].id, variable.targets[0].data_path = key, obj, path
        driver.expression = expression
        return node.outputs[0]

    def strength(self, field: bpy.types.Object) -> Any:
        """Output socket of a field object's strength relative to the recovered one."""
        paths = {"now": "field.strength", "recovered": '["seeing_wind_strength"]'}
        return self.driven("Strength", field, paths, "now / recovered if recovered else 1.0", 1.0)

    def attribute(self, name: str, kind: str = "FLOAT") -> Any:
        """Output socket of a named attribute; `kind` is FLOAT or FLOAT_VECTOR."""
        return self.node("GeometryNodeInputNamedAttribute", {"Name": name}, data_type=kind).outputs["Attribute"]

    def finish(self, geometry: Any = None) -> bpy.types.NodeTree:
        """Link the resulting geometry, if given; lay the nodes out from left to right, and return the group."""
        if geometry is not None:
            self.tree.links.new(geometry, self.output.inputs[0])
        count = len(self.tree.nodes)
        columns = [0, count - 1, *range(1, count - 1)]  # input and output were made first
        # all at once, as Blender updates the whole group after every single change
        self.tree.nodes.foreach_set("location", [value for n in columns for value in (180.0 * (n // 2), -220.0 * (n % 2))])
        return self.tree


FIRST_FRAME, FRAMES_PER_CLIP_FRAME = "First Frame", "Frames per Clip Frame"
"""Names of the inputs of `points_of_current_frame`."""


def points_of_current_frame(
    group: GroupBuilder, points: int, frames: int, frame_start: int, delay: int, field: bpy.types.Object | None
) -> Any:
    """The part of the input mesh that belongs to the current frame, as a geometry socket.

    Args:
        points: number of points of one frame.
        frames: number of frames in the mesh. Before the first and after the last frame, that frame is shown, unless the field loops.
        frame_start: scene frame of the first one.
        delay: 1 for what solvers feel: they step *to* a frame, so it shows what acts in the middle of the step to it; else 0.
        field: the field object whose property says whether it loops; None: it does not.
    """
    first = group.parameter(FIRST_FRAME, "Int", frame_start, "Scene frame of the clip's first frame")
    now = group.node("GeometryNodeInputSceneTime").outputs["Frame"]
    lasts = group.parameter(FRAMES_PER_CLIP_FRAME, "Float", 1.0, "Scene frames that a clip frame lasts", minimum=1e-3)
    if delay:
        now = group.math("SUBTRACT", group.math("CEIL", now), 0.5 * delay)
    # a ten-thousandth of a frame prevents rounding to the frame before
    frame = group.math("FLOOR", group.math("ADD", group.math("DIVIDE", group.math("SUBTRACT", now, first), lasts), 1e-4))
    if field is not None:
        rounds = group.math("FLOOR", group.math("DIVIDE", group.math("ADD", frame, 0.5), float(frames)))
        loops = group.driven("Loop", field, {"loops": f'["{LOOP}"]'}, "loops", 0.0)
        frame = group.math("SUBTRACT", frame, group.math("MULTIPLY", group.math("MULTIPLY", rounds, float(frames)), loops))
    frame = group.math("MINIMUM", group.math("MAXIMUM", frame, 0.0), float(frames - 1))
    # half a point keeps the quotient away from whole numbers, where rounding could go either way
    index = group.math("ADD", group.node("GeometryNodeInputIndex").outputs[0], 0.5)
    owner = group.math("FLOOR", group.math("DIVIDE", index, float(points)))
    same = group.math("COMPARE", owner, frame, 0.5)
    return group.node(
        "GeometryNodeSeparateGeometry", {"Geometry": group.input.outputs["Geometry"], "Selection": same}, domain="POINT"
    ).outputs["Selection"]


def set_up_modifier(obj: bpy.types.Object, tree: bpy.types.NodeTree) -> None:
    """Add a modifier with a node group to an object."""
    obj.modifiers.new(tree.name, "NODES").node_group = tree


def modifier_input(modifier: bpy.types.Modifier, name: str) -> tuple[Any, str] | None:
    """Where a Geometry Nodes modifier stores the value of an input: owner and path of the property, as `layout.prop` takes them.

    Up to Blender 5.1 that is a custom property of the modifier, from 5.2 a property of its own. None when there is no such input.
    """
    tree = modifier.node_group
    items = tree.interface.items_tree if tree is not None else ()
    found = [item.identifier for item in items if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name == name]
    if not found:
        return None
    # of several inputs with the same name (a switch and its value), the last one is meant
    if hasattr(modifier, "properties"):
        return getattr(modifier.properties.inputs, found[-1]), "value"
    return modifier, f'["{found[-1]}"]'


def get_input(modifier: bpy.types.Modifier, name: str) -> Any:
    """The value of a Geometry Nodes modifier's input; None if there is no such input, or it is empty."""
    place = modifier_input(modifier, name)
    if place is None:
        return None
    owner, path = place
    return owner.get(path[2:-2]) if path.startswith("[") else owner.value


def set_input(modifier: bpy.types.Modifier, name: str, value: Any) -> None:
    """Set a Geometry Nodes modifier's input. Raises KeyError when there is no such input."""
    place = modifier_input(modifier, name)
    if place is None:
        raise KeyError(name)
    owner, path = place
    if path.startswith("["):
        owner[path[2:-2]] = value
    else:
        owner.value = value
    modifier.id_data.update_tag()
