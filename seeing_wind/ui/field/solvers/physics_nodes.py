"""The recovered wind for Blender 5.2's physics nodes (Cloth Dynamics, Hair Dynamics and other groups with effectors).

They read effectors from a collection: objects whose geometry carries a force. So the field gets a companion object without vertices,
whose modifier chains *Sample Wind* -> Blender's own *Custom Force* -> *Set Effector*. Forces are in newtons per point, so the companion
multiplies f / density by the points' mass, as Blender's own gravity does; there is one companion per density.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy

from ....engine.errors import UsageError
from ..display import home_of
from ..node_groups import GroupBuilder, get_input, modifier_input, set_input, set_up_modifier
from ..samples import sample_wind_group, samples_of

ASSETS = "assets/nodes/geometry_nodes_dynamics_assets.blend"
PARTS = ("Custom Force", "Set Effector")
EFFECTORS = "Effectors Collection"
"""Name of the effectors input of Blender's simulation groups."""
COMPANION = "seeing_wind_effector_density"
"""Custom property of a companion: its density [kg/m³]."""
WEAK_SUBSTEPS = 5
"""Number of substeps at which Blender 5.2's solver scales gravity and forces by 0.6; 1, 2, 10 and 20 give 0.99 to 1.00 (measured)."""


def feed(scene: bpy.types.Scene, obj: bpy.types.Object, field: bpy.types.Object, density: float) -> Iterator[str]:
    """Make every physics group among an object's Geometry Nodes modifiers feel the field; yields a line for each.

    Raises:
        UsageError: when the field's values are gone, or this Blender lacks the assets.
    """
    for modifier in obj.modifiers:
        if modifier.type != "NODES" or modifier.node_group is None:
            continue
        direct = modifier_input(modifier, EFFECTORS)
        nodes = [node for node in modifier.node_group.nodes if node.type == "GROUP" and EFFECTORS in node.inputs]
        if direct is None and not nodes:
            continue
        companion = effector(scene, field, density)
        if direct is not None:
            set_input(modifier, EFFECTORS, _with(get_input(modifier, EFFECTORS), companion, field))
            yield _said(modifier.node_group.name, density, get_input(modifier, "Substeps"), get_input(modifier, "Linear Damping"))
        for node in nodes:
            socket = node.inputs[EFFECTORS]
            socket.default_value = _with(socket.default_value, companion, field)
            values = [node.inputs[name].default_value if name in node.inputs else None for name in ("Substeps", "Linear Damping")]
            yield _said(node.node_tree.name, density, *values)


def takes_effectors(group: bpy.types.NodeTree) -> bool:
    """Whether a node group, or a group inside it, has an input for effectors."""
    direct = any(item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name == EFFECTORS for item in group.interface.items_tree)
    return direct or any(node.type == "GROUP" and EFFECTORS in node.inputs for node in group.nodes)


def effector(scene: bpy.types.Scene, field: bpy.types.Object, density: float) -> bpy.types.Object:
    """The companion of a field object for matter of a density [kg/m³]; made if there is none.

    Raises:
        UsageError: when the field's values are gone, or this Blender lacks the assets.
    """
    samples = samples_of(field)
    if samples is None:
        raise UsageError(f"The values under {field.name} are gone.", "Load the results again (Reload in the Recover panel).")
    for child in field.children:
        if abs(child.get(COMPANION, 0.0) - density) <= 1e-6 * density:
            return child
    force_group, set_group = (_asset(name) for name in PARTS)
    name = f"{field.name} Effector {density:g}"
    group = GroupBuilder(name)
    mass = group.node("GeometryNodeInputNamedAttribute", {"Name": "mass"}, data_type="FLOAT").outputs
    given = group.node("GeometryNodeSwitch", {"Switch": mass["Exists"], "False": 1.0, "True": mass["Attribute"]}, input_type="FLOAT")
    wind = group.tree.nodes.new("GeometryNodeGroup")
    wind.node_tree = sample_wind_group(samples, density)
    wind.inputs["Wind"].default_value, wind.inputs["Density"].default_value = samples, density
    force, attach = group.tree.nodes.new("GeometryNodeGroup"), group.tree.nodes.new("GeometryNodeGroup")
    force.node_tree, attach.node_tree = force_group, set_group
    link = group.tree.links.new
    link(given.outputs[0], wind.inputs["Mass"])
    link(wind.outputs["Force"], force.inputs["Force"])
    link(force.outputs[0], attach.inputs["Effector"])
    link(group.input.outputs["Geometry"], attach.inputs["Geometry"])
    obj = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    obj[COMPANION] = density
    obj.hide_render = True
    home_of(field, scene).objects.link(obj)
    # parented only for the outliner and for deletion: the force follows the field object through Sample Wind
    obj.parent, obj.matrix_parent_inverse = field, field.matrix_world.inverted()
    for channel in ("LOCATION", "ROTATION"):
        _stay(obj, channel)
    set_up_modifier(obj, group.finish(attach.outputs["Geometry"]))
    return obj


def companions(field: bpy.types.Object | None) -> list[bpy.types.Object]:
    """All companions of a field object."""
    return [] if field is None else [child for child in field.children if COMPANION in child]


def follow(objects: list[bpy.types.Object], field: bpy.types.Object) -> None:
    """Let companions of a former field object use this one, so that calibrated objects stay calibrated."""
    samples = samples_of(field)
    for obj in objects:
        obj.parent, obj.matrix_parent_inverse = field, field.matrix_world.inverted()
        for modifier in obj.modifiers:
            for node in modifier.node_group.nodes:
                if node.type == "GROUP" and "Wind" in node.inputs:
                    node.inputs["Wind"].default_value = samples


def _stay(obj: bpy.types.Object, channel: str) -> None:
    """Keep an object at the origin whatever its parent does."""
    constraint = obj.constraints.new(f"LIMIT_{channel}")
    for axis in "xyz":
        if channel == "LOCATION":
            setattr(constraint, f"use_min_{axis}", True)
            setattr(constraint, f"use_max_{axis}", True)
        else:
            setattr(constraint, f"use_limit_{axis}", True)


def _asset(name: str) -> bpy.types.NodeTree:
    found = bpy.data.node_groups.get(name)
    if found is not None:
        return found
    path = Path(bpy.utils.system_resource("DATAFILES") or "") / ASSETS
    if not path.is_file():
        raise UsageError("This Blender has no physics nodes.", "Use Blender 5.2 or newer, or Blender's own cloth and hair.")
    with bpy.data.libraries.load(str(path)) as (source, wanted):
        wanted.node_groups = [each for each in source.node_groups if each == name]
    if not wanted.node_groups:
        raise UsageError(f"This Blender has no node group {name}.", "Its physics nodes have changed; use Blender 5.2.")
    return wanted.node_groups[0]


def _with(collection: bpy.types.Collection | None, companion: bpy.types.Object, field: bpy.types.Object) -> bpy.types.Collection:
    """The user's collection of effectors, or one made for this companion, with this as the field's only companion in it."""
    if collection is None:
        collection = bpy.data.collections.get(companion.name) or bpy.data.collections.new(companion.name)
    for other in [each for each in collection.objects if each.parent == field and COMPANION in each and each != companion]:
        collection.objects.unlink(other)
    if companion.name not in collection.objects:
        collection.objects.link(companion)
    return collection


def _said(name: str, density: float, substeps: float | None, damping: float | None) -> str:
    line = f"{name}: matter of {density:g} kg/m³"
    if substeps == WEAK_SUBSTEPS:
        line += f"; at {WEAK_SUBSTEPS} substeps Blender lets gravity and forces act at 0.6: use 1, 2, 10 or 20"
    if damping:
        line += f"; its linear damping of {damping:g} slows it down, the recovered force has the air's drag in it already"
    return line
