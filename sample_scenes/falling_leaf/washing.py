"""What hangs in the demo's wind: a line across the frame, and washing pegged to it. For demo_scene.py: needs bpy and NumPy only."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

CORD, SAG = 0.0035, 0.03
"""Thickness of the line, and how far it sags in the middle [m]."""
PEG = (0.010, 0.062, 0.013)
"""Width, height and depth of a clothes peg [m]."""
BITE, INSET = 0.008, 0.016
"""So far round a peg's middle is the cloth held, and so far from its corners do the pegs bite [m]."""
CELL = 0.0115
"""Edge of a face of the cloth [m]."""
POST = 0.045
"""Radius of a post [m]."""
WAVE, SLACK = 0.15, 0.05
"""Length of the folds in which it is hung [m], and by how much more cloth there is than line between its pegs."""
BEHIND = 0.006
"""So far is what is turned over the line behind the rest of a cloth [m]."""
WOOD = ((0.42, 0.27, 0.14),)
"""Colours of the pegs, linear."""
THROUGH = 0.42
"""Of the light that a cloth does not take, so much comes out on its other side: thin cotton in the sun glows from behind."""
HEM, SEAM = 0.011, 0.0015
"""Width of the turned edge and of its seam [m]."""
FINE = 0.0007
"""A pixel of the painted cloth [m], where it is not told."""
STAINS, TEA = 7, np.array([0.03, 0.065, 0.13])
"""Spots on a cloth, and what they take of its colours."""
GRASS = 0.09
"""Height of the grass that stands before a foot [m]."""
SEED = 11
"""Of its folds."""


def hang_line(
    left: np.ndarray, right: np.ndarray, thick: float = CORD, colour: tuple[float, float, float] = (0.30, 0.27, 0.23)
) -> None:
    """A cord so thick from one place (3,) to another [m], which sags."""
    along = np.linspace(0.0, 1.0, 33)[:, None]
    places = left + along * (right - left) - SAG * 4.0 * along * (1.0 - along) * [0.0, 0.0, 1.0]
    curve = bpy.data.curves.new("Line", "CURVE")
    curve.dimensions, curve.bevel_depth, curve.bevel_resolution = "3D", 0.5 * thick, 3
    spline = curve.splines.new("POLY")
    spline.points.add(len(places) - 1)
    spline.points.foreach_set("co", np.concatenate([places, np.ones_like(along)], axis=1).astype(np.float32).ravel())
    line = bpy.data.objects.new("Line", curve)
    bpy.context.scene.collection.objects.link(line)
    curve.materials.append(plain("Cord", colour))


def place_on(left: np.ndarray, right: np.ndarray, x: float) -> tuple[np.ndarray, np.ndarray]:
    """Where the line of `hang_line` is at an x [m], and its direction there seen from above: (3,) each."""
    way = right - left
    share = (x - left[0]) / way[0]
    level = way * [1.0, 1.0, 0.0]
    return left + share * way - [0.0, 0.0, SAG * 4.0 * share * (1.0 - share)], level / np.linalg.norm(level)


def set_post(name: str, top: np.ndarray) -> None:
    """A round wooden post from the ground, at a height of 0, to a place (3,) [m] a hand's breadth below its end."""
    turn = np.arange(24) * 2.0 * np.pi / 24
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    # a little thicker at its foot, its upper edge planed off
    rows = [(-0.05, 1.08), (0.5 * top[2], 1.0), (top[2] + 0.09, 0.93), (top[2] + 0.10, 0.80), (top[2] + 0.10, 0.0)]
    vertices = np.concatenate([np.insert(top[:2] + POST * share * ring, 2, height, axis=1) for height, share in rows])
    k = np.arange(24)
    sides = np.stack([k, (k + 1) % 24, 24 + (k + 1) % 24, 24 + k], axis=1)
    faces = np.concatenate([sides + 24 * row for row in range(len(rows) - 1)])
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    mesh.shade_smooth()
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    mesh.materials.append(bpy.data.materials.get("Grey Wood") or in_grass(plain("Grey Wood", (0.16, 0.125, 0.09))))


def hang_cloth(
    name: str, at: np.ndarray, along: np.ndarray, size: tuple[float, float], pegs: int, texture: np.ndarray, cell: float = CELL,
    folds: tuple[float, float] = (WAVE, SLACK), over: float = 0.0, inset: float = INSET,
    peg_size: tuple[float, float, float] = PEG, peg_colours: Sequence[tuple[float, float, float]] = WOOD,
) -> None:  # fmt: skip
    """A cloth that hangs in folds from so many pegs on a line through `at`, see `place_on`; what the pegs bite is the vertex group "Held".

    Args:
        size: width and height [m].
        texture: as of `woven`.
        cell: edge of a face [m].
        folds: their length [m] and slack, as `WAVE` and `SLACK`.
        over: how much of its height is turned over the line and hangs behind [m].
        inset: as `INSET`.
        peg_size, peg_colours: as `PEG` and `WOOD`; one after the other.
    """
    rng = np.random.default_rng(SEED)
    wave, slack = folds
    count = [round(side / cell) + 1 for side in size]
    # from its upper edge, which is behind the line if it is turned over it, to the lower one in front
    rows = round(over / cell)
    s, row = np.meshgrid(np.linspace(-0.5, 0.5, count[0]) * size[0], np.arange(count[1]))
    down = (row - rows) * (size[1] / (count[1] - 1))
    # as long as it is along the folds, and pegs that far apart
    slope = 2.0 * np.sqrt(1.0 / (1.0 - slack) - 1.0)
    turn = 2.0 * np.pi / wave
    # folds run a little askew, and change on their way down
    askew = 0.12 * down * rng.uniform(0.5, 1.0) + 0.01 * np.sin(9.0 * down + rng.uniform(0.0, 6.0))
    fold = slope / turn * np.sin(turn * (s + askew) + rng.uniform(0.0, 6.0))
    axes = np.array([along, [-along[1], along[0], 0.0], [0.0, 0.0, 1.0]])
    vertices = np.stack([(1.0 - slack) * s, fold + np.where(down < 0.0, BEHIND, 0.0), -np.abs(down)], -1) @ axes + at
    bites = np.linspace(inset - 0.5 * size[0], 0.5 * size[0] - inset, pegs)
    near = np.abs(s[..., None] - bites) < max(BITE, 0.51 * cell)
    near &= (np.abs(down) < 1.5 * cell)[..., None]
    u, v = s / size[0] + 0.5, 1.0 - row / (count[1] - 1)
    cloth = mesh_of_rows(name, vertices, u, v)
    cloth.data.materials.append(cotton(name, texture))
    cloth.vertex_groups.new(name="Held").add(np.flatnonzero(near.any(axis=-1)).tolist(), 1.0, "REPLACE")
    for number, held in enumerate(np.moveaxis(near, -1, 0)):
        colour = peg_colours[number % len(peg_colours)]
        peg(f"{name} Peg", vertices[held].mean(axis=0), axes, rng.uniform(-0.08, 0.08), peg_size, colour)


def mesh_of_rows(name: str, vertices: np.ndarray, u: np.ndarray, v: np.ndarray) -> bpy.types.Object:
    """A smooth mesh of vertices (R, C, 3) [m] in rows and columns, with u and v (R, C) as its UV map."""
    index = np.arange(u.size).reshape(u.shape)
    faces = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    return new_mesh(name, vertices.reshape(-1, 3), faces, np.stack([u.ravel(), v.ravel()], -1))


def new_mesh(name: str, vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray) -> bpy.types.Object:
    """A smooth mesh in the scene: vertices (V, 3) [m], faces (F, K), uv (V, 2)."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    mesh.shade_smooth()
    mesh.uv_layers.new().data.foreach_set("uv", uv[faces.ravel()].astype(np.float32).ravel())
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def peg(
    name: str, at: np.ndarray, axes: np.ndarray, tilt: float, size: tuple[float, float, float], colour: tuple[float, float, float]
) -> None:
    """A clothes peg of two pieces that clasps the line at `at` (3,) [m]; axes (3, 3): rows along the line, across it, and up."""
    width, height, depth = size
    material = f"Peg {colour}"
    # a piece from the side: thick at the spring, thin at both ends; it sits with its upper third above the line
    z = np.array([0.35, 0.30, 0.05, -0.15, -0.58, -0.65]) * height
    y = np.array([0.16, 0.30, 0.42, 0.50, 0.42, 0.30]) * depth
    for side in (-1.0, 1.0):
        inner, outer = np.stack([0.08 * depth + 0.0 * y, z], -1), np.stack([y, z], -1)
        ring = np.concatenate([outer, inner[::-1]]) * [side, 1.0]
        corners = np.concatenate([np.insert(ring, 0, -0.5 * width, axis=1), np.insert(ring, 0, 0.5 * width, axis=1)])
        corners[:, [0, 2]] = corners[:, [0, 2]] @ np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
        n = len(ring)
        sides = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata((corners @ axes + at).tolist(), [], [*sides, tuple(range(n))[::-1], tuple(range(n, 2 * n))])
        obj = bpy.data.objects.new(name, mesh)
        bpy.context.scene.collection.objects.link(obj)
        mesh.materials.append(bpy.data.materials.get(material) or plain(material, colour))


def woven(
    size: tuple[float, float], ground: tuple[float, float, float], stripe: tuple[float, float, float], seed: int, checked: bool,
    fine: float = FINE,
):  # fmt: skip
    """A used cotton cloth (H, W, 4): sRGB 0..1, row 0 at the bottom, and how much light shines through, which is its relief, too.

    Args:
        size: width and height [m].
        ground, stripe: its colours.
        checked: stripes both ways all over, instead of a few before its lower and upper end.
        fine: a pixel [m].
    """
    rng = np.random.default_rng(seed)
    width, height = (round(side / fine) for side in size)
    x, y = np.meshgrid((np.arange(width) + 0.5) * fine, (np.arange(height) + 0.5) * fine)
    if checked:
        share = sum(0.5 * ((along / 0.017) % 1.0 < 0.5) for along in (x, y))
    else:
        end = np.minimum(y, size[1] - y)
        share = sum(1.0 * (np.abs(end - at) < half) for at, half in ((0.045, 0.007), (0.060, 0.0018), (0.030, 0.0018)))
    # threads of uneven thickness, washed out in places, the stripes more so, and ironed into eighths
    threads = 0.5 * (rng.normal(size=(height, 1)) + rng.normal(size=(1, width))) + 0.5 * rng.normal(size=(height, width))
    worn = waves(x, y, 40.0, rng) + 0.6 * waves(x, y, 160.0, rng)
    colour = np.asarray(ground) + (np.asarray(stripe) - ground) * (share * np.clip(0.82 + 0.07 * worn, 0.0, 1.0))[..., None]
    ironed = sum(np.exp(-(((along - at * side) / 0.0022) ** 2)) for along, side, at in (
        (x, size[0], 0.5), (y, size[1], 0.25), (y, size[1], 0.5), (y, size[1], 0.75)))  # fmt: skip
    colour *= (1.0 + 0.022 * threads + 0.018 * worn - 0.012 * ironed)[..., None]
    colour *= 1.0 - stains(x, y, size, rng)[..., None] * TEA
    edge = np.minimum.reduce([x, size[0] - x, y, size[1] - y])
    seam = np.exp(-(((edge - HEM) / SEAM) ** 2)) * (0.75 + 0.25 * np.sin(2.0 * np.pi * (x + y) / 0.004))
    colour *= (1.0 - 0.05 * (edge < HEM) - 0.13 * seam)[..., None]
    through = np.where(edge < HEM, 0.35, 1.0) * (1.0 + 0.08 * threads - 0.25 * ironed)
    return np.clip(np.concatenate([colour, through[..., None]], axis=-1), 0.0, 1.0)


def waves(x: np.ndarray, y: np.ndarray, finest: float, rng: np.random.Generator) -> np.ndarray:
    """Uneven at places x, y (H, W) [m], with a standard deviation of one: waves of so many radians per metre at most."""
    several = [rng.normal() * np.cos(k * x + m * y + p) for k, m, p in rng.uniform(-finest, finest, (12, 3))]
    return sum(several) / np.sqrt(6.0)


def stains(x: np.ndarray, y: np.ndarray, size: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """How stained a cloth of a size [m] is at places x, y (H, W), 0..1: spots that no wash has taken out, darkest where they dried last."""
    found = np.zeros_like(x)
    for _ in range(STAINS):
        middle, radius = rng.uniform(0.15, 0.85, 2) * size, rng.uniform(0.02, 0.09) * min(size)
        away = np.hypot(x - middle[0], y - middle[1]) / radius + 0.12 * waves(x, y, 4.0 / radius, rng)
        spot = 1.0 / (1.0 + np.exp(14.0 * (away - 1.0)))
        found = np.maximum(found, rng.uniform(0.3, 1.0) * spot * (0.55 + 0.45 * np.exp(-(((away - 0.92) / 0.12) ** 2))))
    return found


# -- materials ----------------------------------------------------------------------------------------------------------------------


def plain(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    """Matt and of one colour (linear), a little uneven."""
    material, add = blank(name)
    uneven = add("TexNoise", {"Scale": 90.0, "Detail": 3.0}).outputs[0]
    dark, light = ((*(factor * each for each in colour), 1.0) for factor in (0.7, 1.3))
    mixed = add("Mix", {0: uneven, 6: dark, 7: light}, data_type="RGBA").outputs[2]
    surface = add("BsdfPrincipled", {"Base Color": mixed, "Roughness": 0.85})
    material.node_tree.links.new(surface.outputs[0], material.node_tree.nodes["Material Output"].inputs["Surface"])
    return material


def in_grass(material: bpy.types.Material) -> bpy.types.Material:
    """The same, hidden from the ground, at a height of 0, up to the tips of the blades before it."""
    tree, output = material.node_tree, material.node_tree.nodes["Material Output"]
    add = adder(tree)
    place = add("NewGeometry", {}).outputs["Position"]
    blades = add("TexNoise", {"Vector": add("VectorMath", {0: place, 1: (90.0, 90.0, 8.0)}, operation="MULTIPLY").outputs[0], "Scale": 1.0})
    height = add("SeparateXYZ", {0: place}).outputs["Z"]
    tips = add("MapRange", {0: blades.outputs[0], 1: 0.3, 2: 0.7, 3: 0.0, 4: GRASS}).outputs[0]
    above = add("Math", {0: height, 1: tips}, operation="GREATER_THAN").outputs[0]
    surface = output.inputs["Surface"].links[0].from_socket
    both = add("MixShader", {0: above, 1: add("BsdfTransparent", {}).outputs[0], 2: surface})
    tree.links.new(both.outputs[0], output.inputs["Surface"])
    return material


def cotton(name: str, texture: np.ndarray) -> bpy.types.Material:
    """Cloth with the colours of a `woven` frame, fuzzy at grazing angles, bright where the light is behind it."""
    image = bpy.data.images.new(name, texture.shape[1], texture.shape[0], alpha=True)
    image.alpha_mode = "CHANNEL_PACKED"
    image.pixels.foreach_set(texture.astype(np.float32).ravel())
    image.pack()
    material, add = blank(name)
    seen = add("TexImage", {}, image=image)
    creases = add("TexNoise", {"Vector": add("TexCoord", {}).outputs["UV"], "Scale": 7.0, "Detail": 3.0, "Roughness": 0.55})
    threads = add("Bump", {"Height": seen.outputs[1], "Strength": 0.6, "Distance": 0.0015}).outputs[0]
    bump = add("Bump", {"Height": creases.outputs[0], "Strength": 0.7, "Distance": 0.008, "Normal": threads}).outputs[0]
    front = add("BsdfPrincipled", {"Base Color": seen.outputs[0], "Roughness": 0.9, "Specular IOR Level": 0.15, "Sheen Weight": 0.25,
                                   "Normal": bump})  # fmt: skip
    behind = add("BsdfTranslucent", {0: seen.outputs[0], "Normal": bump})
    share = add("Math", {0: seen.outputs[1], 1: THROUGH}, operation="MULTIPLY").outputs[0]
    both = add("MixShader", {0: share, 1: front.outputs[0], 2: behind.outputs[0]})
    material.node_tree.links.new(both.outputs[0], material.node_tree.nodes["Material Output"].inputs["Surface"])
    return material


def blank(name: str):
    """A new material with nothing but its output, and `adder` of its nodes."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    return material, adder(tree)


def adder(tree: bpy.types.NodeTree):
    """A function that adds a shader node: its kind, its inputs, its properties."""

    def add(kind: str, inputs: dict, **properties):
        node = tree.nodes.new(f"ShaderNode{kind}")
        for key, value in properties.items():
            setattr(node, key, value)
        for key, value in inputs.items():
            if isinstance(value, bpy.types.NodeSocket):
                tree.links.new(value, node.inputs[key])
            else:
                node.inputs[key].default_value = value
        return node

    return add
