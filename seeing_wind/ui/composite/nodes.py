"""The compositor's nodes: clip or clean plate under the render, with the clip's grain on plate and render."""

from __future__ import annotations

from typing import Any

import bpy

from ..clip.inputs.pace import set_pace_of_images
from .film import Lens
from .mattes import COVERED, Mattes

TREE = "Seeing Wind Composite"
LAST = 2
"""Value of our custom property on the node that outputs the finished image; on our other nodes it is True."""


def is_set_up(scene: bpy.types.Scene) -> bool:
    """Whether the scene's compositor contains our nodes."""
    tree = getattr(scene, "compositing_node_group", None) or getattr(scene, "node_tree", None)
    return tree is not None and any(node.get("seeing_wind") for node in tree.nodes)


def build(
    scene: bpy.types.Scene, clip: bpy.types.MovieClip, plate: bpy.types.Image | None, mattes: Mattes | None, grain: float,
    lens: Lens | None, rendered: bpy.types.Scene,
) -> None:  # fmt: skip
    """Rebuild our nodes in the scene's compositor. The user's own nodes stay, also those between ours and the output.

    Args:
        plate: covers the clip's object; None shows the clip as it is.
        mattes: where the plate covers the clip; None: everywhere.
        grain: standard deviation of the noise on plate and render, in display values 0..1; 0: none.
        lens: distortion to apply to render, plate and mattes; None if the clip's lens has none.
        rendered: the scene whose render is put over the clip, see `overscan`.
    """
    tree, output = _tree(scene)
    fed = [link.to_socket for link in tree.links if link.from_node.get("seeing_wind") == LAST and not link.to_node.get("seeing_wind")]
    for node in [node for node in tree.nodes if node.get("seeing_wind")]:
        tree.nodes.remove(node)
    make = _Maker(tree, lens)
    behind, covered = _behind(make, clip, plate, mattes)
    layers = make.node("RLayers")
    layers.scene, layers.layer = rendered, rendered.view_layers[0].name
    front = make.bent(layers.outputs["Image"], wide=rendered != scene)
    image = make.over(behind, front)
    if grain > 0.0:
        alpha = make.node("SeparateColor")
        make.link(front, alpha.inputs[0])
        made = alpha.outputs["Alpha"]
        made = made if covered is None else make.math("MAXIMUM", covered, made)
        image = _grained(make, image, make.math("MULTIPLY", made, grain))
    image.node["seeing_wind"] = LAST
    for socket in fed:
        tree.links.new(image, socket)
    if not fed or not output.inputs[0].links:
        tree.links.new(image, output.inputs[0])
    output.location = (260 * make.count, 0)


def _behind(make: _Maker, clip: bpy.types.MovieClip, plate: bpy.types.Image | None, mattes: Mattes | None) -> tuple[Any, Any]:
    """The background image, and the coverage of the plate in it (None without a plate)."""
    film = make.node("MovieClip")
    film.clip = clip
    shown = make.fitted(film.outputs["Image"])
    if plate is None:
        return shown, None
    still = make.node("Image")
    still.image = plate
    clean = make.bent(make.fitted(still.outputs["Image"]))
    if mattes is None:
        return make.over(shown, clean), 1.0
    matte = make.node("Image")
    matte.image, matte.use_auto_refresh = mattes.image, True
    set_pace_of_images(matte, mattes.frames, mattes.pace)
    channels = make.node("SeparateColor")
    make.link(make.bent(make.fitted(matte.outputs["Image"])), channels.inputs[0])
    return make.over(shown, clean, channels.outputs[COVERED]), channels.outputs[COVERED]


def _grained(make: _Maker, image: Any, strength: Any) -> Any:
    """Add noise per pixel and frame to the display values. The sum of two uniform variables is closer to Gaussian grain than one."""
    place, time = make.node("ImageCoordinates"), make.node("SceneTime")
    make.link(image, place.inputs[0])
    noise = None
    for offset in (0.0, 0.5):
        dice = make.plain("ShaderNodeTexWhiteNoise", noise_dimensions="4D")
        make.link(place.outputs["Pixel"], dice.inputs["Vector"])
        make.link(make.math("ADD", time.outputs["Frame"], offset), dice.inputs["W"])
        noise = dice.outputs["Color"] if noise is None else make.vector("ADD", noise, dice.outputs["Color"])
    # the sum has mean 1 and variance 2 / 12
    even = make.vector("SUBTRACT", noise, (1.0, 1.0, 1.0))
    scaled = make.plain("ShaderNodeVectorMath", operation="SCALE")
    make.link(even, scaled.inputs[0])
    make.link(make.math("MULTIPLY", strength, 6.0**0.5), scaled.inputs["Scale"])
    shown = make.converted(image, "Linear Rec.709", "sRGB")
    return make.converted(make.vector("ADD", shown, scaled.outputs["Vector"]), "sRGB", "Linear Rec.709")


class _Maker:
    """Adds our nodes to a tree, from left to right, in Blender 4.5 and 5."""

    def __init__(self, tree: bpy.types.NodeTree, lens: Lens | None) -> None:
        self.tree, self.count, self.lens = tree, 0, lens
        self.link = tree.links.new

    def plain(self, kind: str, **properties: Any) -> Any:
        """Add a node of the full type name `kind`."""
        node = self.tree.nodes.new(kind)
        node["seeing_wind"], node.location = True, (200 * self.count, -240 * (self.count % 3))
        self.count += 1
        for key, value in properties.items():
            setattr(node, key, value)
        return node

    def node(self, kind: str) -> Any:
        """Add a compositor node."""
        return self.plain(f"CompositorNode{kind}")

    def _set(self, socket: Any, value: Any) -> None:
        if isinstance(value, bpy.types.NodeSocket):
            self.link(value, socket)
        else:
            socket.default_value = value

    def math(self, operation: str, *values: Any) -> Any:
        """Output of a new math node."""
        node = self.plain("ShaderNodeMath", operation=operation)
        for socket, value in zip(node.inputs, values):
            self._set(socket, value)
        return node.outputs[0]

    def vector(self, operation: str, *values: Any) -> Any:
        """Output of a new vector math node; colours count as vectors."""
        node = self.plain("ShaderNodeVectorMath", operation=operation)
        for socket, value in zip(node.inputs, values):
            self._set(socket, value)
        return node.outputs["Vector"]

    def converted(self, image: Any, source: str, target: str) -> Any:
        """The image converted to another colour space."""
        node = self.node("ConvertColorSpace")
        node.from_color_space, node.to_color_space = source, target
        self.link(image, node.inputs[0])
        return node.outputs[0]

    def fitted(self, image: Any) -> Any:
        """The image stretched to the render's size."""
        scale = self.node("Scale")
        if hasattr(scale, "space"):  # up to Blender 4.5
            scale.space, scale.frame_method = "RENDER_SIZE", "STRETCH"
        else:
            scale.inputs["Type"].default_value, scale.inputs["Frame Type"].default_value = "Render Size", "Stretch"
        self.link(image, scale.inputs["Image"])
        return scale.outputs["Image"]

    def bent(self, image: Any, wide: bool = False) -> Any:
        """An undistorted image, with overscan if `wide`, distorted by the clip's lens; transparent where it has no pixel."""
        if self.lens is None:
            return image
        places, mapped = self.node("Image"), self.node("MapUV")
        places.image = self.lens.wide if wide else self.lens.image
        self.link(image, mapped.inputs["Image"])
        self.link(self.fitted(places.outputs["Image"]), mapped.inputs["UV"])
        return mapped.outputs["Image"]

    def over(self, behind: Any, front: Any, share: Any = 1.0) -> Any:
        """`front` over `behind` by the alpha of `front` and the factor `share`."""
        node = self.node("AlphaOver")
        old = "Background" not in node.inputs  # up to Blender 4.5
        factor, lower, upper = (node.inputs[key] for key in ((0, 1, 2) if old else ("Factor", "Background", "Foreground")))
        self._set(factor, share)
        self.link(behind, lower)
        self.link(front, upper)
        return node.outputs["Image"]


def _tree(scene: bpy.types.Scene) -> tuple[bpy.types.NodeTree, bpy.types.Node]:
    """The scene's compositor and its output node: `node_tree` with a Composite node up to 4.5, a node group with an output from 5.0."""
    if hasattr(scene, "compositing_node_group"):
        tree = scene.compositing_node_group
        if tree is None:
            tree = scene.compositing_node_group = bpy.data.node_groups.new(TREE, "CompositorNodeTree")
        if not any(item.item_type == "SOCKET" and item.in_out == "OUTPUT" for item in tree.interface.items_tree):
            tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        kind = "NodeGroupOutput"
    else:
        empty = scene.node_tree is None
        scene.use_nodes = True
        if empty:  # the two nodes that Blender adds by itself
            scene.node_tree.nodes.clear()
        tree, kind = scene.node_tree, "CompositorNodeComposite"
    output = next((node for node in tree.nodes if node.bl_idname == kind), None) or tree.nodes.new(kind)
    return tree, output
