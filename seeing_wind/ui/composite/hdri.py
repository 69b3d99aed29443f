"""Light the scene with a panorama of the clip's location instead of the sun and sky estimated from the clip."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...engine.errors import UsageError
from ..job.worker import said_by
from ..user_paths import absolute, noted

WORLD = "Seeing Wind HDRI"
NODES = {f"ShaderNode{kind}" for kind in ("Mapping", "TexEnvironment", "Background")}
"""Types of that world's nodes whose values are set."""


def set_hdri(scene: bpy.types.Scene) -> Path:
    """Light the scene with the panorama in its settings, rotated and scaled as these say. Remembers the former world for `unset_hdri`.

    Raises:
        UsageError: when the file does not exist, is no image, or is not high dynamic range.
    """
    settings = scene.seeing_wind
    image = panorama(settings)
    world = scene.world
    if world is None or world.name.split(".")[0] != WORLD:
        settings.former_world = world
        world = scene.world = bpy.data.worlds.new(WORLD)
    nodes = _nodes(world)
    if not NODES <= nodes.keys():  # the world is new, or the user has deleted some of its nodes
        _build(world)
        nodes = _nodes(world)
    nodes["ShaderNodeTexEnvironment"].image = image
    nodes["ShaderNodeMapping"].inputs["Rotation"].default_value = (0.0, 0.0, settings.hdri_turn)
    nodes["ShaderNodeBackground"].inputs["Strength"].default_value = settings.hdri_strength
    return Path(absolute(settings.hdri))


def check_hdri(scene: bpy.types.Scene) -> None:
    """Raise UsageError if the file of our panorama is missing: Blender would light the scene in magenta instead."""
    world = scene.world
    node = _nodes(world).get("ShaderNodeTexEnvironment") if world is not None and world.name.split(".")[0] == WORLD else None
    if node is None or node.image is None or node.image.packed_file is not None:
        return
    path = Path(absolute(node.image.filepath, node.image.library))
    if not path.is_file():
        raise UsageError(f"There is no file {path}, which lights the scene.", "Put it back, or choose or clear HDRI.")


def unset_hdri(scene: bpy.types.Scene) -> bool:
    """Give the scene back the world that it had before `set_hdri`. Returns whether our panorama lit it."""
    world, settings = scene.world, scene.seeing_wind
    if world is None or world.name.split(".")[0] != WORLD:
        return False
    scene.world, settings.former_world = settings.former_world, None
    if world.users == 0:
        bpy.data.worlds.remove(world)
    return True


def panorama(settings: bpy.types.PropertyGroup) -> bpy.types.Image:
    """Load the panorama in the settings. Raises UsageError as `set_hdri`."""
    path = Path(absolute(settings.hdri))
    if not path.is_file():
        raise UsageError(f"There is no file {path}.", "Choose a panorama (.hdr or .exr), or clear HDRI.")
    known = {image.name for image in bpy.data.images}
    try:
        image = bpy.data.images.load(str(path), check_existing=True)
    except RuntimeError as error:
        raise UsageError(f"Blender cannot open {path}: {said_by(error)}.", "Choose a panorama (.hdr or .exr), or clear HDRI.") from error
    size = tuple(image.size)
    if not image.is_float:
        if image.name not in known:
            bpy.data.images.remove(image)
        if not all(size):
            raise UsageError(f"{path} is no image that Blender reads.", "Choose a panorama (.hdr or .exr), or clear HDRI.")
        raise UsageError(
            f"{path} has no more range than a screen shows: its sun would be as dim as its clouds.", "Choose a panorama in .hdr or .exr."
        )
    image.filepath = noted(settings.hdri)
    return image


def _nodes(world: bpy.types.World) -> dict[str, bpy.types.Node]:
    """A world's nodes by type, since their names depend on the user's language."""
    return {node.bl_idname: node for node in world.node_tree.nodes} if world.node_tree is not None else {}


def _build(world: bpy.types.World) -> None:
    world.use_nodes = True
    nodes, link = world.node_tree.nodes, world.node_tree.links.new
    nodes.clear()
    way, turn, panorama, light, output = (
        nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "Mapping", "TexEnvironment", "Background", "OutputWorld")
    )
    link(way.outputs["Generated"], turn.inputs["Vector"])
    link(turn.outputs["Vector"], panorama.inputs["Vector"])
    link(panorama.outputs["Color"], light.inputs["Color"])
    link(light.outputs["Background"], output.inputs["Surface"])
    for column, node in enumerate((way, turn, panorama, light, output)):
        node.location = (260 * column, 0)
