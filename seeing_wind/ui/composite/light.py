"""The light of a clip: a sun from the shading of its object, and sky and ground by elevation from the object's surroundings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from ..clip.clip_scene import FRAME_COLOUR
from ..clip.match import is_factory
from .hdri import set_hdri, unset_hdri
from .own import is_called

EXPLAINED = 0.3
"""Least share of the brightness's variance that the normals must explain. Below it, the object's texture dominates, not shading."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
HAZY = 1.9
"""Ratio of sunlight to skylight if the shading does not determine it: a sunny day with some haze."""
RATIOS = (0.3, 4.0)
"""Least and largest plausible ratio of the two."""
BANDS = 12
"""Number of horizontal bands of the frame, of one colour each."""
TINT = (0.5, 1.5)
"""Least and largest ratio of a channel of the sun's colour to the mean of the channels."""
SUN, SKY = "Seeing Wind Sun", "Seeing Wind Sky"
SKY_MAP = 64
"""Width in pixels of the map by which Cycles samples the sky, which has no small bright spots that a ray could miss."""
SUN_ANGLES = (math.radians(48.0), math.radians(-12.0), math.radians(-38.0))
"""Default direction: high, over the camera's left shoulder; the user turns it to match the clip's light."""
MADE = "seeing_wind_made"
"""Custom property of sun and sky: their values as created. Unless the user changes these, both are updated for each take."""


@dataclass(frozen=True)
class Light:
    """The light of a clip. Colours are linear; a matt white card lit only by a uniform sky has the sky's colour in the frame."""

    heights: np.ndarray
    """(B,) sines of elevations, ascending."""
    around: np.ndarray
    """(B, 3) colour of the light from these elevations; constant above the highest and below the lowest."""
    energy: float
    """Of the sun [W/m²], in Blender's definition."""
    colour: np.ndarray
    """(3,) of the sun, with a mean of 1."""


def light_of(surroundings: np.ndarray, heights: np.ndarray, ratio: float) -> Light:
    """Estimate the light of a scene from a frame of its surroundings (H, W, 3) uint8 sRGB.

    The frame's colour at an elevation is taken for all azimuths, also outside the view, and the colours at its upper and lower edge for
    everything above and below. The sun's colour follows from the camera's white balance: sun, sky and ground together make an upright white
    card that faces the sun look white.

    Args:
        heights: of `bands_of`, one for each band of the frame from top to bottom.
        ratio: light of the sun over that of sky and ground, on a surface that faces the sun.
    """
    order = np.argsort(heights, kind="stable")
    around = np.stack([linear(part).mean(axis=(0, 1)) for part in np.array_split(surroundings, len(heights))])[order]
    card = _on_a_card(heights[order], around)
    ambient = max(float(card @ LUMINANCE), 1e-3)
    colour = (1.0 + ratio - card / ambient) / ratio
    colour = np.clip(colour / colour.mean(), *TINT)
    return Light(heights[order], around, math.pi * ambient * ratio, colour / colour.mean())


def bands_of(scene: bpy.types.Scene, count: int) -> np.ndarray:
    """Sines (B,) of the elevations at the middles of `count` horizontal bands of the camera's frame, from top to bottom."""
    corners = [np.array(corner) for corner in scene.camera.data.view_frame(scene=scene)]
    high, low = (0.5 * sum(sorted(corners, key=lambda corner: sign * corner[1])[:2]) for sign in (-1.0, 1.0))
    share = (np.arange(count) + 0.5)[:, None] / count
    rays = (high + share * (low - high)) @ np.array(scene.camera.matrix_world.normalized().to_3x3()).T
    return rays[:, 2] / np.linalg.norm(rays, axis=1)


def _on_a_card(heights: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Light (3,) on an upright surface from `around` (B, 3) at `heights` (B,); equal steps in height are equal solid angles."""
    z = np.linspace(-1.0, 1.0, 513)
    facing = np.sqrt(1.0 - z**2)
    return np.array([facing @ np.interp(z, heights, channel) for channel in around.T]) / facing.sum()


def sun_of(obj: bpy.types.Object | None) -> tuple[Vector, float] | None:
    """World direction towards the sun, and the ratio of its light to the sky's; None if the shading does not determine them.

    A matt surface's brightness is linear in the cosine between its normal and the light, so the gradient of a linear fit of the brightness
    over the normals points to the light (Lambert's law, with the sky as the constant).
    """
    colours = obj.data.attributes.get(FRAME_COLOUR) if obj is not None and obj.type == "MESH" else None
    if colours is None or len(obj.data.vertices) < 12:
        return None
    count = len(obj.data.vertices)
    flat, normals = np.empty(4 * count, dtype=np.float32), np.empty(3 * count, dtype=np.float32)
    colours.data.foreach_get("color", flat)
    obj.data.vertex_normals.foreach_get("vector", normals)
    bright, normals = flat.reshape(-1, 4)[:, :3] @ LUMINANCE, normals.reshape(-1, 3)
    table = np.concatenate([normals, np.ones((count, 1))], axis=1)
    spread = float(((bright - bright.mean()) ** 2).sum())
    # the ridge damps directions in which the normals hardly vary
    ridge = 0.02 * count * np.diag([1.0, 1.0, 1.0, 0.0])
    found = np.linalg.solve(table.T @ table + ridge, table.T @ bright)
    rest = float(((bright - table @ found) ** 2).sum())
    way = Vector(found[:3].tolist())
    if spread <= 1e-9 or 1.0 - rest / spread < EXPLAINED or way.length < 1e-6:
        return None
    way.normalize()
    ratio = _ratio(bright, np.maximum(normals @ np.array(way), 0.0))
    way = obj.matrix_world.to_3x3() @ way
    # light from below comes from a bright floor, not the sun
    return (way.normalized(), ratio) if way.z > 0.0 else None


def light_scene(scene: bpy.types.Scene, surroundings: np.ndarray | None) -> str:
    """Light the scene with the user's panorama or, unless the user added lights, the clip's sun and sky. Returns the light in words.

    Args:
        surroundings: as in `set_light`.
    """
    lights = [obj for obj in scene.objects if obj.type == "LIGHT"]
    default, ours = [obj for obj in lights if is_factory(obj)], [obj for obj in lights if is_called(obj, SUN)]
    if scene.seeing_wind.hdri:
        path = set_hdri(scene)
        for obj in (*default, *ours):
            obj.hide_render = True
        return f"the light of {path.name}"
    for obj in ours if unset_hdri(scene) else ():
        obj.hide_render = False
    if len(lights) > len(default) and not ours:
        return ""
    for obj in default:
        obj.hide_render = True
    said = "Blender's default light is off; " if default else ""
    seen = sun_of(scene.seeing_wind.recovered_object)
    if not set_light(scene, surroundings, seen):
        return said + "the sun as you have set it (delete it for that of the clip)"
    said += "a sun from where the clip's object is brightest" if seen else "a sun: turn it to the clip's light"
    return said + (", a sky of the clip's colours" if surroundings is not None else "")


def set_light(scene: bpy.types.Scene, surroundings: np.ndarray | None, seen: tuple[Vector, float] | None) -> bool:
    """Set the sun, and a sky in place of a new file's world, whose near-black would make shadows black. The scene must have a camera.

    An earlier sun or sky of ours is updated, unless the user has changed it.

    Args:
        surroundings: image (H, W, 3) uint8 sRGB of the object's surroundings; None if unknown.
        seen: result of `sun_of`.

    Returns:
        Whether the sun was set; False if the user has changed or hidden it.
    """
    if surroundings is None:
        surroundings = np.broadcast_to(np.array([[[170, 184, 206]]], dtype=np.uint8), (BANDS, 1, 3))
    light = light_of(surroundings, bands_of(scene, min(BANDS, len(surroundings))), HAZY if seen is None else seen[1])
    former = scene.world
    if former is None or _is_factory_world(former) or _is_as_made(former):
        scene.world = _sky(light, former if former is not None and MADE in former and former.users == 1 else None)
    sun = next((obj for obj in scene.objects if obj.type == "LIGHT" and is_called(obj, SUN)), None)
    if sun is None:
        sun = bpy.data.objects.new(SUN, bpy.data.lights.new(SUN, "SUN"))
        scene.collection.objects.link(sun)
    elif sun.hide_render or not _is_as_made(sun):
        return False
    sun.data.energy, sun.data.color, sun.data.angle = light.energy, light.colour, math.radians(2.0)
    sun.rotation_euler = SUN_ANGLES if seen is None else seen[0].to_track_quat("Z", "Y").to_euler()
    sun[MADE] = _numbers(sun)
    return True


def _numbers(made: bpy.types.Object | bpy.types.World) -> list[float]:
    """All values that `set_light` sets on a sun or a sky."""
    if isinstance(made, bpy.types.World):
        nodes = made.node_tree.nodes
        stops = next((node.color_ramp.elements for node in nodes if node.type == "VALTORGB"), ())
        lit = next((node.inputs["Strength"].default_value for node in nodes if node.type == "BACKGROUND"), 0.0)
        parts = [float(len(nodes)), float(len(made.node_tree.links)), lit]
        return [*parts, *(value for stop in stops for value in (stop.position, *stop.color))]
    tied = float(bool(made.animation_data or made.data.animation_data or made.constraints or made.parent))
    turned = made.rotation_euler if made.rotation_mode == "XYZ" else made.matrix_basis.to_euler()
    return [tied, *turned, made.data.energy, *made.data.color, made.data.angle]


def _is_as_made(made: bpy.types.Object | bpy.types.World) -> bool:
    """Whether a sun or a sky of ours still has the values that it was created with."""
    noted = list(made.get(MADE, ()))
    return len(noted) > 0 and len(now := _numbers(made)) == len(noted) and np.allclose(now, noted, rtol=1e-5, atol=1e-5)


def _ratio(bright: np.ndarray, facing: np.ndarray) -> float:
    """Ratio of slope to constant in a linear fit of brightness over the cosine between normal and light."""
    slope, constant = np.polyfit(facing, bright, 1)
    return float(np.clip(slope / max(float(constant), 1e-6), *RATIOS))


def linear(image: np.ndarray) -> np.ndarray:
    """Linear values in 0..1 of a frame (...) uint8 sRGB."""
    values = image / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _sky(light: Light, made: bpy.types.World | None) -> bpy.types.World:
    """A world with the surroundings' colours by elevation: `made`, an earlier one of ours, or a new one."""
    world = made or _new_sky()
    stops = next(node for node in world.node_tree.nodes if node.type == "VALTORGB").color_ramp.elements
    while len(stops) < len(light.heights):
        stops.new(1.0)
    while len(stops) > max(len(light.heights), 1):
        stops.remove(stops[-1])
    for element, height, colour in zip(stops, light.heights, light.around, strict=True):
        element.position, element.color = 0.5 * (height + 1.0), (*colour, 1.0)
    world[MADE] = _numbers(world)
    return world


def _new_sky() -> bpy.types.World:
    """A new world whose nodes give colours by elevation."""
    world = bpy.data.worlds.new(SKY)
    world.use_nodes = True
    nodes, link = world.node_tree.nodes, world.node_tree.links.new
    background = nodes.get("Background")
    way, parts, share, ramp = (nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "SeparateXYZ", "MapRange", "ValToRGB"))
    link(way.outputs["Generated"], parts.inputs[0])
    share.inputs["From Min"].default_value = -1.0
    link(parts.outputs["Z"], share.inputs["Value"])
    link(share.outputs[0], ramp.inputs[0])
    link(ramp.outputs[0], background.inputs["Color"])
    background.inputs["Strength"].default_value = 1.0
    # So smooth a sky needs no fine importance map, which Cycles builds anew for every frame and which may take a second.
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", SKY_MAP
    for column, node in enumerate((way, parts, share, ramp)):
        node.location = (220 * (column - 5), 300)
    return world


def _is_factory_world(world: bpy.types.World) -> bool:
    """Whether a world is the unchanged dark grey one of a new file."""
    background = world.node_tree.nodes.get("Background") if world.node_tree is not None else None
    if background is None or len(world.node_tree.nodes) > 2 or background.inputs["Color"].is_linked:
        return False
    grey, strength = tuple(background.inputs["Color"].default_value)[:3], background.inputs["Strength"].default_value
    return world.animation_data is None and strength == 1.0 and all(abs(value - 0.05087609) < 1e-4 for value in grey)
