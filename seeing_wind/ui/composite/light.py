"""The light of a clip: a sun from the shading of its object, a sky and a ground from what is around it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from ..clip.clip_scene import PICTURE_COLOUR

EXPLAINED = 0.3
"""Share of the brightness that must follow the surface's direction. Below it is the object's own pattern that is seen, no shading."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
HAZY = 1.9
"""Light of the sun over that of the sky where the shading does not tell: a sunny day with some haze."""
RATIOS = (0.3, 4.0)
"""Of the two, as far as they are believed."""
EDGE = 0.33
"""Of the frame's height: what stands in its upper part lights from above, what stands in its lower part from below."""
TINT = (0.5, 1.5)
"""Channels of the sun's colour over their mean, at most."""
SUN, SKY = "Seeing Wind Sun", "Seeing Wind Sky"
SKY_MAP = 64
"""Pixels across the map by which Cycles samples the sky: it has no detail finer than its soft edge of some 20 degrees."""
SUN_ANGLES = (math.radians(48.0), math.radians(-12.0), math.radians(-38.0))
"""High, over the camera's left shoulder: a guess to be turned to the clip's own light."""


@dataclass(frozen=True)
class Light:
    """What lights a clip. Colours are linear; a white matt card lit by a sky of one colour alone has that colour in the frame."""

    above: np.ndarray
    """(3,) of the sky."""
    below: np.ndarray
    """(3,) of the ground."""
    energy: float
    """Of the sun [W/m²], as Blender counts it."""
    colour: np.ndarray
    """(3,) of the sun, its mean is 1."""


def light_of(picture: np.ndarray, ratio: float) -> Light:
    """What lights a scene whose surroundings are seen in a frame (H, W, 3) uint8 sRGB.

    The frame's upper and lower parts stand for the sky and ground that the camera does not see. The sun's colour is what the camera's
    white balance leaves for it: both together light a white card white.

    Args:
        ratio: light of the sun over that of sky and ground, on a surface that faces it.
    """
    rows = max(1, round(EDGE * len(picture)))
    above, below = (linear(part).mean(axis=(0, 1)) for part in (picture[:rows], picture[-rows:]))
    around = 0.5 * (above + below)
    ambient = max(float(around @ LUMINANCE), 1e-3)
    colour = (1.0 + ratio - around / ambient) / ratio
    colour = np.clip(colour / colour.mean(), *TINT)
    return Light(above, below, math.pi * ambient * ratio, colour / colour.mean())


def sun_of(obj: bpy.types.Object | None) -> tuple[Vector, float] | None:
    """The direction towards the light, in the world, and its light over that of the sky; None where the shading does not tell.

    A matt surface's brightness is linear in the cosine between its normal and the light, so the gradient of a straight line fitted through
    the brightness over the normals points to the light (Lambert's law, with the sky as the constant).
    """
    colours = obj.data.attributes.get(PICTURE_COLOUR) if obj is not None and obj.type == "MESH" else None
    if colours is None or len(obj.data.vertices) < 12:
        return None
    count = len(obj.data.vertices)
    flat, normals = np.empty(4 * count, dtype=np.float32), np.empty(3 * count, dtype=np.float32)
    colours.data.foreach_get("color", flat)
    obj.data.vertex_normals.foreach_get("vector", normals)
    bright, normals = flat.reshape(-1, 4)[:, :3] @ LUMINANCE, normals.reshape(-1, 3)
    table = np.concatenate([normals, np.ones((count, 1))], axis=1)
    spread = float(((bright - bright.mean()) ** 2).sum())
    # a ridge keeps directions in which the normals hardly vary from deciding
    ridge = 0.02 * count * np.diag([1.0, 1.0, 1.0, 0.0])
    found = np.linalg.solve(table.T @ table + ridge, table.T @ bright)
    rest = float(((bright - table @ found) ** 2).sum())
    way = Vector(found[:3].tolist())
    if spread <= 1e-9 or 1.0 - rest / spread < EXPLAINED or way.length < 1e-6:
        return None
    way.normalize()
    ratio = _ratio(bright, np.maximum(normals @ np.array(way), 0.0))
    way = obj.matrix_world.to_3x3() @ way
    # a light from below is a bright floor, not the sun
    return (way.normalized(), ratio) if way.z > 0.0 else None


def set_light(scene: bpy.types.Scene, picture: np.ndarray | None, seen: tuple[Vector, float] | None) -> None:
    """Make the sun, and a sky in place of a new file's own, which is nearly black: shadows would be, too.

    Args:
        picture: what is around the object (H, W, 3) uint8 sRGB; None: it is not known.
        seen: as `sun_of` gives it.
    """
    if picture is None:
        picture = np.broadcast_to(np.array([[[170, 184, 206]]], dtype=np.uint8), (3, 1, 3))
    light = light_of(picture, HAZY if seen is None else seen[1])
    lamp = bpy.data.lights.new(SUN, "SUN")
    lamp.energy, lamp.color, lamp.angle = light.energy, light.colour, math.radians(2.0)
    sun = bpy.data.objects.new(SUN, lamp)
    sun.rotation_euler = SUN_ANGLES if seen is None else seen[0].to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(sun)
    if scene.world is None or _is_factory_world(scene.world):
        scene.world = _sky(light)


def _ratio(bright: np.ndarray, facing: np.ndarray) -> float:
    """Slope over constant of the brightness over how far a surface faces the light."""
    slope, constant = np.polyfit(facing, bright, 1)
    return float(np.clip(slope / max(float(constant), 1e-6), *RATIOS))


def linear(picture: np.ndarray) -> np.ndarray:
    """Linear values of a frame (...) uint8 sRGB."""
    values = picture / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _sky(light: Light) -> bpy.types.World:
    """A sky of one colour above the horizon and another one below, with a soft edge."""
    world = bpy.data.worlds.new(SKY)
    world.use_nodes = True
    nodes, link = world.node_tree.nodes, world.node_tree.links.new
    background = nodes.get("Background")
    way, parts, ramp = (nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "SeparateXYZ", "ValToRGB"))
    for element, at, colour in zip(ramp.color_ramp.elements, (0.0, 0.3), (light.below, light.above), strict=True):
        element.position, element.color = at, (*colour, 1.0)
    link(way.outputs["Generated"], parts.inputs[0])
    link(parts.outputs["Z"], ramp.inputs[0])
    link(ramp.outputs[0], background.inputs["Color"])
    background.inputs["Strength"].default_value = 1.0
    # As smooth as it is, it needs no fine map of where it is bright; Cycles makes one anew for every frame, which may take a second.
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", SKY_MAP
    for column, node in enumerate((way, parts, ramp)):
        node.location = (220 * (column - 4), 300)
    return world


def _is_factory_world(world: bpy.types.World) -> bool:
    """Whether a world is the dark grey of a new file."""
    background = world.node_tree.nodes.get("Background") if world.node_tree is not None else None
    if background is None or len(world.node_tree.nodes) > 2 or background.inputs["Color"].is_linked:
        return False
    grey, strength = tuple(background.inputs["Color"].default_value)[:3], background.inputs["Strength"].default_value
    return world.animation_data is None and strength == 1.0 and all(abs(value - 0.05087609) < 1e-4 for value in grey)
