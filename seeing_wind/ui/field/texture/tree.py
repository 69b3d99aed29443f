"""The texture that a force field reads: nodes that find a place in the atlas and mix its eight neighbours.

A texture force field gives 0.5 minus the color along the axes of the world, at a place in the field object's own coordinates. So with a
rotation M and an atlas of h = 0.5 - v / S, the color is to be 0.5 - M (0.5 - h), in which h and the colors that are driven may not be
negative:

    color = (1 - M 0.5) + (M + 1) h - (the sum of h, plus 0.5)

Image textures mix four pixels by themselves; that mixes along x and y. Along z two look-ups are mixed.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .atlas import SUM, Atlas
from .followers import Followers
from .reach import CONTINUE, FADE, Reach

NOTHING = (0.5, 0.5, 0.5, 1.0)
"""The color of no force."""


class TextureBuilder:
    """Builds a texture's nodes in few words."""

    def __init__(self, texture: bpy.types.Texture) -> None:
        texture.use_nodes = True
        self.tree = texture.node_tree
        self.tree.nodes.clear()

    def node(self, kind: str, *inputs: Any, **properties: Any) -> Any:
        """A node with its properties; its inputs in order, each a value or the output socket to link."""
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


def make_texture(name: str, atlas: Atlas, box: np.ndarray, followers: Followers, reach: Reach) -> bpy.types.Texture:
    """The texture of a field on a lattice.

    Args:
        box: (2, 3) of the lattice, in the field object's own coordinates.
        followers: of that object.
        reach: how the field ends beside the box.
    """
    texture = bpy.data.textures.new(name, "NONE")
    build = TextureBuilder(texture)
    # a place becomes a color as half of it plus a half
    place = build.split(build.node("Coordinates").outputs[0])
    low, high = (0.5 + 0.5 * np.asarray(corner, dtype=float) for corner in box)
    near = [build.math("MINIMUM", build.math("MAXIMUM", place[k], low[k]), high[k]) for k in range(3)]
    cells = np.array(atlas.counts) - 1
    x, y, z = (build.math("MULTIPLY", build.math("SUBTRACT", near[k], low[k]), cells[k] / (high[k] - low[k])) for k in range(3))
    color = _looked_up(build, atlas, _turned_colors(build, name, atlas, followers), followers, (x, y, z))
    left = _left(build, reach, place, near)
    build.node("Output", color if left is None else build.mixed(left, NOTHING, color))
    for k, node in enumerate(build.tree.nodes):
        node.location = (180 * (k // 4), -200 * (k % 4))
    return texture


def remove_texture(texture: bpy.types.Texture | None) -> None:
    """Remove a texture that nothing uses any more, with the textures and images that it alone used."""
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
    """The atlas' color at a place of the image, turned as the field object is."""
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


def _looked_up(build: TextureBuilder, atlas: Atlas, color: Any, followers: Followers, where: tuple[Any, Any, Any]) -> Any:
    """The color between the nodes of the lattice, at a place counted in nodes."""
    (nx, ny, nz), (x, y, z) = atlas.counts, where
    width, height = atlas.image.size
    layer = build.math("MINIMUM", build.math("FLOOR", z), nz - 2.0)
    # a pixel's own color is in its middle
    row = build.math("ADD", build.math("ADD", y, 0.5), build.math("MULTIPLY", build.shown(followers.clock), float(ny)))
    up = build.math("SUBTRACT", build.math("MULTIPLY", row, 2.0 / height), 1.0)
    found = []
    for offset in (0.5, nx + 0.5):
        column = build.math("ADD", build.math("ADD", x, offset), build.math("MULTIPLY", layer, float(nx)))
        right = build.math("SUBTRACT", build.math("MULTIPLY", column, 2.0 / width), 1.0)
        found.append(build.node("At", color, build.joined(right, up)).outputs[0])
    return build.mixed(build.math("SUBTRACT", z, layer), *found)


def _left(build: TextureBuilder, reach: Reach, place: list[Any], near: list[Any]) -> Any:
    """Output socket of the share that is left beside the box; None where that is all. See `reach.left_of`."""
    if reach.kind not in (FADE, CONTINUE):
        return None
    distance = build.node("Distance", build.joined(*near), build.joined(*place)).outputs[0]
    if reach.kind == CONTINUE:
        start = 1.0 + reach.radius
        far = build.math("ADD", build.math("MULTIPLY", distance, 2.0), start)
        return build.math("POWER", build.math("DIVIDE", start, far), reach.power)
    fade = build.node("ValToRGB", build.math("MULTIPLY", distance, 2.0 / reach.width))
    fade.color_ramp.interpolation = "EASE"
    for element, grey in zip(fade.color_ramp.elements, (1.0, 0.0), strict=True):
        element.color = (grey, grey, grey, 1.0)
    return fade.outputs[0]
