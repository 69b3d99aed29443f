"""The texture of a force field: nodes that look a point up in the atlas and interpolate between its eight neighbours.

A texture force field has the value 0.5 minus the color along the world's axes, at a point in the field object's own coordinates. So with
a rotation M and an atlas of h = 0.5 - v / S, the color must be 0.5 - M (0.5 - h). As h and the driven colors must not be negative, it is
computed as

    color = (1 - M 0.5) + (M + 1) h - (the sum of h, plus 0.5)

Image textures interpolate between four pixels, which covers x and y. Along z, two look-ups are mixed.

The cost of a look-up is proportional to the number of nodes, as Blender copies some kilobytes for each. So RGB curves, which take a point
as one color, clamp and scale its three coordinates at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np

from .atlas import SUM, Atlas
from .followers import Followers
from .reach import CONTINUE, FADE, Reach

NOTHING = (0.5, 0.5, 0.5, 1.0)
"""The color of no force."""
FLAT = 1e-4
"""A box counts as no flatter than this share of its longest side."""
LAST = 1e-4
"""Points are clamped this far before the last layer [layers], so that there is always a next layer."""


class TextureBuilder:
    """Concise building of a texture's nodes."""

    def __init__(self, texture: bpy.types.Texture) -> None:
        texture.use_nodes = True
        self.tree = texture.node_tree
        self.tree.nodes.clear()

    def node(self, kind: str, *inputs: Any, **properties: Any) -> Any:
        """Add a node with its properties; `inputs` are in order, each a value or the output socket to link."""
        node = self.tree.nodes.new(f"TextureNode{kind}")
        for key, value in properties.items():
            setattr(node, key, value)
        for k, value in enumerate(inputs):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, node.inputs[k])
            else:
                node.inputs[k].default_value = value
        return node

    def math(self, operation: str, *values: Any) -> Any:
        """Output socket of a math node."""
        return self.node("Math", *values, operation=operation).outputs[0]

    def mixed(self, factor: Any, a: Any, b: Any, way: str = "MIX") -> Any:
        """Output socket of two colors mixed."""
        return self.node("MixRGB", factor, a, b, blend_type=way).outputs[0]

    def shown(self, texture: bpy.types.Texture) -> Any:
        """Output socket of the color of another texture at the same place."""
        return self.node("Texture", texture=texture).outputs[0]

    def joined(self, *values: Any) -> Any:
        """Output socket of numbers as one color, which other nodes take for a place."""
        return self.node("CombineColor", *values).outputs[0]

    def split(self, color: Any) -> list[Any]:
        """Output sockets of red, green and blue."""
        return list(self.node("SeparateColor", color).outputs)[:3]

    def clamped(self, place: Any, box: np.ndarray, to: np.ndarray) -> Any:
        """Output socket of a point as one color, clamped to a box (2, 3) around the origin, whose corners are mapped to `to`."""
        node = self.node("CurveRGB", place)
        node.mapping.use_clip, node.mapping.extend = False, "HORIZONTAL"
        # Blender tabulates a curve over its points and over this range; a corner between two table entries would be cut off
        node.mapping.clip_min_x, node.mapping.clip_max_x = 0.5, 0.5
        # Blender turns a point p into the color 0.5 p + 0.5
        ends = 0.5 + 0.5 * np.asarray(box, dtype=float)
        ends[1] = np.maximum(ends[1], ends[0] + FLAT * np.ptp(ends, axis=0).max())
        # the fourth curve applies to all channels, before the others
        all_over = (ends.min(), ends.max())
        for curve, begin, end in zip(node.mapping.curves, [*ends.T, all_over], [*to.T, all_over], strict=True):
            for point, x, y in zip(curve.points, begin, end, strict=True):
                point.location, point.handle_type = (x, y), "VECTOR"
        node.mapping.update()
        return node.outputs[0]


def make_texture(name: str, atlas: Atlas, box: np.ndarray, followers: Followers, reach: Reach) -> bpy.types.Texture:
    """Make the texture of a field on a lattice.

    Args:
        box: (2, 3) of the lattice, in the field object's own coordinates.
        followers: the textures that follow that object.
        reach: how the field ends outside the box.
    """
    texture = bpy.data.textures.new(name, "NONE")
    build = TextureBuilder(texture)
    place = build.node("Coordinates").outputs[0]
    color = _looked_up(build, place, atlas, box, _turned_colors(build, name, atlas, followers), followers)
    left = _left(build, place, box, reach)
    build.node("Output", color if left is None else build.mixed(left, NOTHING, color))
    for k, node in enumerate(build.tree.nodes):
        node.location = (180 * (k // 4), -200 * (k % 4))
    return texture


def parts_of(texture: bpy.types.Texture | None) -> Iterator[bpy.types.Texture | bpy.types.Image]:
    """Yield a texture and, recursively, the textures and images that it uses."""
    if texture is None:
        return
    yield texture
    for node in texture.node_tree.nodes if texture.use_nodes else ():
        if node.type == "TEXTURE":
            yield from parts_of(node.texture)
    if texture.type == "IMAGE" and texture.image is not None:
        yield texture.image


def remove_texture(texture: bpy.types.Texture | None) -> None:
    """Remove a texture that is no longer used, and the textures and images that only it used."""
    if texture is None or texture.users > 0 or texture.library is not None:
        return
    parts = {node.texture for node in texture.node_tree.nodes if node.type == "TEXTURE"} if texture.use_nodes else set()
    image = texture.image if texture.type == "IMAGE" else None
    bpy.data.textures.remove(texture)
    for part in parts - {None}:
        remove_texture(part)
    if image is not None and image.users == 0:
        bpy.data.images.remove(image)


def _turned_colors(build: TextureBuilder, name: str, atlas: Atlas, followers: Followers) -> Any:
    """Output socket of the atlas's color at a point of the image, rotated like the field object."""
    colors, sums = (_image_texture(f"{name} {part}", atlas.image) for part in ("Colors", "Sums"))
    sums.use_alpha = sums.use_color_ramp = True
    for element, grey in zip(sums.color_ramp.elements, (0.0, SUM), strict=True):
        element.color = (grey, grey, grey, 1.0)
    turned = build.shown(followers.base)
    for part, axis in zip(build.split(build.shown(colors)), followers.axes, strict=True):
        turned = build.mixed(part, turned, build.shown(axis), "ADD")
    return build.mixed(1.0, turned, build.shown(sums), "SUBTRACT")


def _image_texture(name: str, image: bpy.types.Image) -> bpy.types.Texture:
    texture = bpy.data.textures.new(name, "IMAGE")
    texture.image, texture.extension, texture.use_alpha = image, "EXTEND", False
    return texture


def _looked_up(build: TextureBuilder, place: Any, atlas: Atlas, box: np.ndarray, color: Any, followers: Followers) -> Any:
    """Output socket of the color interpolated in the lattice; image coordinates reach from -1 to 1."""
    nx, ny, nz = atlas.counts
    across, along = atlas.pixel
    # a pixel has its own color at its centre
    first = np.array([0.5 * across - 1.0, 0.5 * along - 1.0, 0.0])
    last = np.array([(nx - 0.5) * across - 1.0, (ny - 0.5) * along - 1.0, nz - 1.0 - LAST])
    x, y, z = build.split(build.clamped(place, box, np.stack([first, last])))
    layer = build.math("FLOOR", z)
    up = build.math("ADD", y, build.shown(followers.clock))
    right = build.math("ADD", x, build.math("MULTIPLY", layer, nx * across))
    found = [build.node("At", color, build.joined(at, up)).outputs[0] for at in (right, build.math("ADD", right, nx * across))]
    return build.mixed(build.math("SUBTRACT", z, layer), *found)


def _left(build: TextureBuilder, place: Any, box: np.ndarray, reach: Reach) -> Any:
    """Output socket of the share that is left outside the box; None if the whole field is. See `reach.left_of`."""
    if reach.kind not in (FADE, CONTINUE):
        return None
    distance = build.node("Distance", build.clamped(place, box, box), place).outputs[0]
    if reach.kind == CONTINUE:
        start = 1.0 + reach.radius
        return build.math("POWER", build.math("DIVIDE", start, build.math("ADD", distance, start)), reach.power)
    fade = build.node("ValToRGB", build.math("MULTIPLY", distance, 1.0 / reach.width))
    fade.color_ramp.interpolation = "EASE"
    for element, grey in zip(fade.color_ramp.elements, (1.0, 0.0), strict=True):
        element.color = (grey, grey, grey, 1.0)
    return fade.outputs[0]
