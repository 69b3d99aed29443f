"""What stands behind a sample scene: a meadow before trees, filmed by the scene's own camera, whose focus is nearer.

    blender -b --factory-startup --python meadow.py -- DIR SEED DISTANCE         or         python meadow.py DIR SEED DISTANCE

DIR holds camera.json as make.py wrote it; the ground is at a height of 0, DISTANCE is where the lens is focused [m]. The result is
DIR/backdrop.png, which render.py hangs behind the object. It has the sun that lights the object. Needs bpy and NumPy only.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parent)]

from render import add_sun, place_camera  # noqa: E402

F_STOP = 1.4
"""Of the lens: what is far is blurred by a fiftieth of the frame's width."""
SAMPLES, EVENED = 24, 2
"""Of Cycles, per pixel: each sees another part of what is out of focus; and how often neighbours are mixed, which evens that out."""
EXPOSURE = 1.1
"""Stops by which it is brighter: a matt white card in the sun is nearly white."""
PATCH, BLADES, KINDS = 2.0, 5200, 3
"""Side of a patch of grass [m], its blades, and how many different ones there are."""
NEAR, FAR = 4.0, 24.0
"""Between these distances from the camera grow single blades [m]; beyond, it is the ground's colour."""
FLOWERS = 14
"""On a patch."""
TREES, LEAVES = 90, 1500
"""How many trees, and leaves on one, each as large as a twig's: nobody sees it out of focus."""
WOOD = (58.0, 96.0)
"""Where the trees stand, away from the camera [m]."""
HAZE = (0.62, 0.70, 0.78)
"""What the air between adds, linear."""


def main(folder: Path, seed: int, distance: float) -> None:
    """Plant it and render it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, rng = bpy.context.scene, np.random.default_rng(seed)
    camera = json.loads((folder / "camera.json").read_text())
    held = place_camera(scene, camera)
    held.data.dof.use_dof, held.data.dof.focus_distance, held.data.dof.aperture_fstop = True, distance, F_STOP
    held.data.clip_end = 2000.0
    middle = np.array(held.matrix_world.translation)
    half = 0.5 * camera["width"] / camera["fx"]
    sow(middle, half, rng)
    plant(middle, half, rng)
    light(scene)
    settings(scene, camera, folder / "backdrop.png")
    bpy.ops.render.render(write_still=True)
    even_out(folder / "backdrop.png")


def sow(middle: np.ndarray, half: float, rng: np.random.Generator) -> None:
    """The ground, and grass wherever the camera sees it nearer than FAR; `half` is half of the frame's width at a distance of one."""
    corners = np.array([[-900.0, -50.0, 0.0], [900.0, -50.0, 0.0], [900.0, 1500.0, 0.0], [-900.0, 1500.0, 0.0]])
    ground = mesh_of("Ground", corners, [[0, 1, 2, 3]])
    ground.data.materials.append(ground_material())
    patches = [patch(f"Grass {kind}", rng) for kind in range(KINDS)]
    for y in np.arange(NEAR, FAR, PATCH):
        for x in np.arange(-half * (y + PATCH) - PATCH, half * (y + PATCH) + PATCH, PATCH):
            stand(patches[rng.integers(KINDS)], (middle[0] + x, middle[1] + y, 0.0), 0.5 * np.pi * rng.integers(4), rng.uniform(0.85, 1.2))


def plant(middle: np.ndarray, half: float, rng: np.random.Generator) -> None:
    """Trees in a loose row, bushes before them, hills behind."""
    kinds = [tree(f"Tree {kind}", rng) for kind in range(KINDS)]
    for number in range(TREES):
        y = rng.uniform(*WOOD)
        x = 1.3 * half * WOOD[1] * (2.0 * (number + rng.uniform()) / TREES - 1.0)
        size = rng.uniform(0.3, 0.6) if number % 2 == 0 else rng.uniform(0.7, 1.3)
        stand(kinds[rng.integers(KINDS)], (middle[0] + x, middle[1] + y, 0.0), rng.uniform(0.0, 2.0 * np.pi), size)
    for away, height, haze in ((420.0, 20.0, 0.55), (900.0, 62.0, 0.82)):
        x = np.linspace(-1.6, 1.6, 81) * half * away
        rise = sum(rng.normal() / k * np.sin(k * x / away * 3.0 + rng.uniform(0.0, 6.0)) for k in range(1, 9))
        top = height * (1.0 + 0.28 * rise)
        low, high = np.stack([x, 0 * x + away, 0 * x - 5.0], 1), np.stack([x, 0 * x + away, top], 1)
        faces = [[k, k + 1, 82 + k, 81 + k] for k in range(80)]
        hill = mesh_of("Hill", np.concatenate([low, high]) + [middle[0], middle[1], 0.0], faces)
        hill.data.materials.append(far_material(haze))


# -- what grows -------------------------------------------------------------------------------------------------------------------


def patch(name: str, rng: np.random.Generator) -> bpy.types.Mesh:
    """Bent blades of every height, in tufts, and some flowers."""
    tufts = rng.uniform(-0.5, 0.5, (BLADES // 9, 2)) * PATCH
    root = tufts[rng.integers(len(tufts), size=BLADES)] + rng.normal(0.0, 0.05, (BLADES, 2))
    height = 0.10 + 0.26 * rng.beta(1.6, 4.0, BLADES)
    way = rng.uniform(0.0, 2.0 * np.pi, BLADES)
    lean, width = height * rng.uniform(0.1, 0.9, BLADES), rng.uniform(0.0025, 0.006, BLADES)
    along, across = np.stack([np.cos(way), np.sin(way)], 1), np.stack([-np.sin(way), np.cos(way)], 1)
    rows = []
    for share, thick in ((0.0, 1.0), (0.5, 0.8), (0.85, 0.45), (1.0, 0.05)):
        place = root + along * (lean * share**2)[:, None]
        up = height * share * (1.0 - 0.25 * share * lean / height)
        side = across * (width * thick)[:, None]
        rows += [np.concatenate([place + sign * side, up[:, None]], 1) for sign in (-1.0, 1.0)]
    vertices = np.stack(rows, 1)
    strip = np.array([[0, 1, 3, 2], [2, 3, 5, 4], [4, 5, 7, 6]])
    faces = (8 * np.arange(BLADES)[:, None, None] + strip).reshape(-1, 4)
    dry = rng.beta(1.2, 3.2, (BLADES, 1))
    colour = np.array([0.075, 0.145, 0.022]) * (1.0 - dry) + np.array([0.30, 0.25, 0.075]) * dry
    colour = colour * rng.uniform(0.6, 1.35, (BLADES, 1))
    shade = np.repeat(colour[:, None], 8, 1) * np.array([0.45, 0.45, 0.9, 0.9, 1.1, 1.1, 1.2, 1.2])[None, :, None]
    at = rng.uniform(-0.5, 0.5, (FLOWERS, 2)) * PATCH
    disc = 0.016 * np.stack([np.cos(np.arange(6) * np.pi / 3), np.sin(np.arange(6) * np.pi / 3), 0.6 * np.ones(6)], 1)
    heads = disc[None] + np.concatenate([at, rng.uniform(0.2, 0.42, (FLOWERS, 1))], 1)[:, None]
    petals = np.array([[0.75, 0.72, 0.66], [0.72, 0.52, 0.05]])[rng.integers(2, size=FLOWERS)]
    mesh = bpy.data.meshes.new(name)
    base = 8 * BLADES
    mesh.from_pydata(
        np.concatenate([vertices.reshape(-1, 3), heads.reshape(-1, 3)]).tolist(), [],
        [*faces.tolist(), *(list(range(base + 6 * k, base + 6 * k + 6)) for k in range(FLOWERS))],
    )  # fmt: skip
    paint(mesh, np.concatenate([shade.reshape(-1, 3), np.repeat(petals, 6, 0)]))
    mesh.materials.append(leafy_material("Grass", 0.0))
    return mesh


def tree(name: str, rng: np.random.Generator) -> bpy.types.Mesh:
    """A trunk, and leaves about the ends of its boughs."""
    boughs = np.clip(rng.normal(0.0, 1.0, (26, 3)), -1.6, 1.6) * [2.0, 2.0, 1.9] + [0.0, 0.0, 4.6]
    middle = boughs[rng.integers(len(boughs), size=LEAVES)] + np.clip(rng.normal(0.0, 0.7, (LEAVES, 3)), -1.2, 1.2)
    frames = np.linalg.qr(rng.normal(size=(LEAVES, 3, 3)))[0]
    corner = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    vertices = middle[:, None] + 0.26 * rng.uniform(0.6, 1.3, (LEAVES, 1, 1)) * np.einsum("ck,lkd->lcd", corner, frames[:, :2])
    turn = np.arange(8) * np.pi / 4
    ring = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], 1)
    trunk = np.concatenate([0.22 * ring, 0.12 * ring + [0.0, 0.0, 5.5]])
    mesh = bpy.data.meshes.new(name)
    base = 4 * LEAVES
    sides = [[base + k, base + (k + 1) % 8, base + 8 + (k + 1) % 8, base + 8 + k] for k in range(8)]
    mesh.from_pydata(np.concatenate([vertices.reshape(-1, 3), trunk]).tolist(), [], [*np.arange(base).reshape(-1, 4).tolist(), *sides])
    autumn = rng.beta(1.0, 5.0, (LEAVES, 1))
    colour = (np.array([0.045, 0.085, 0.018]) * (1.0 - autumn) + np.array([0.26, 0.15, 0.02]) * autumn) * rng.uniform(0.5, 1.5, (LEAVES, 1))
    paint(mesh, np.concatenate([np.repeat(colour, 4, 0), np.full((16, 3), 0.05)]))
    mesh.materials.append(leafy_material("Leaves", 0.035))
    return mesh


def mesh_of(name: str, vertices: np.ndarray, faces: list) -> bpy.types.Object:
    """An object of its own mesh, in the scene."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces)
    return stand(mesh, (0.0, 0.0, 0.0), 0.0, 1.0)


def stand(mesh: bpy.types.Mesh, place: tuple[float, float, float], turn: float, size: float) -> bpy.types.Object:
    """One of many that share a mesh."""
    obj = bpy.data.objects.new(mesh.name, mesh)
    obj.location, obj.rotation_euler, obj.scale = place, (0.0, 0.0, turn), (size, size, size)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def paint(mesh: bpy.types.Mesh, colours: np.ndarray) -> None:
    """Colours (V, 3) of its vertices, linear."""
    whole = np.concatenate([colours, np.ones((len(colours), 1))], 1)
    mesh.attributes.new("colour", "FLOAT_COLOR", "POINT").data.foreach_set("color", whole.astype(np.float32).ravel())


# -- materials, light, camera -----------------------------------------------------------------------------------------------------


def leafy_material(name: str, haze: float) -> bpy.types.Material:
    """Of the mesh's colours; some of the light shines through, and so much air is before it."""
    if name in bpy.data.materials:
        return bpy.data.materials[name]
    add, output = blank(name)
    colour = add("Attribute", {}, attribute_name="colour").outputs["Color"]
    front = add("BsdfPrincipled", {"Base Color": colour, "Roughness": 0.55, "Specular IOR Level": 0.25}).outputs[0]
    both = add("MixShader", {0: 0.35, 1: front, 2: add("BsdfTranslucent", {0: colour}).outputs[0]}).outputs[0]
    return output(add("MixShader", {0: haze, 1: both, 2: add("Emission", {0: (*HAZE, 1.0)}).outputs[0]}).outputs[0])


def ground_material() -> bpy.types.Material:
    """Grass from afar: patches of another green and of dry, more air before what is farther."""
    add, output = blank("Ground")
    place = add("TexCoord", {}).outputs["Object"]
    wide, fine = (add("TexNoise", {"Vector": place, "Scale": scale, "Detail": 6.0}).outputs[0] for scale in (0.045, 1.4))
    mixed = add("Math", {0: wide, 1: fine}, operation="ADD").outputs[0]
    share = add("MapRange", {0: mixed, 1: 0.75, 2: 1.25}).outputs[0]
    green = add("Mix", {0: share, 6: (0.040, 0.068, 0.014, 1.0), 7: (0.085, 0.098, 0.026, 1.0)}, data_type="RGBA").outputs[2]
    surface = add("BsdfDiffuse", {0: green}).outputs[0]
    away = add("MapRange", {0: add("CameraData", {}).outputs["View Distance"], 1: 40.0, 2: 900.0, 3: 0.0, 4: 0.8}).outputs[0]
    return output(add("MixShader", {0: away, 1: surface, 2: add("Emission", {0: (*HAZE, 1.0)}).outputs[0]}).outputs[0])


def far_material(haze: float) -> bpy.types.Material:
    """A wooded hill behind much air."""
    add, output = blank("Hill")
    wood = add("BsdfDiffuse", {0: (0.05, 0.075, 0.035, 1.0)}).outputs[0]
    return output(add("MixShader", {0: haze, 1: wood, 2: add("Emission", {0: (*HAZE, 1.0)}).outputs[0]}).outputs[0])


def blank(name: str):
    """Functions that add a node to a new material, and that link its surface and return it."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    nodes.clear()
    out = nodes.new("ShaderNodeOutputMaterial")
    return adder(nodes, link), lambda surface: (link(surface, out.inputs["Surface"]), material)[1]


def adder(nodes, link):
    """A function that adds a shader node: its kind, its inputs, its properties."""

    def add(kind: str, inputs: dict, **properties):
        node = nodes.new(f"ShaderNode{kind}")
        for key, value in properties.items():
            setattr(node, key, value)
        for key, value in inputs.items():
            if isinstance(value, bpy.types.NodeSocket):
                link(value, node.inputs[key])
            else:
                node.inputs[key].default_value = value
        return node

    return add


def light(scene: bpy.types.Scene) -> None:
    """The sun of render.py, and a sky that is pale at the horizon, with some thin clouds."""
    add_sun(scene, 4.2, 0.6, (1.0, 0.93, 0.80))
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    nodes, link = scene.world.node_tree.nodes, scene.world.node_tree.links.new
    add = adder(nodes, link)
    way = add("TexCoord", {}).outputs["Generated"]
    up = add("SeparateXYZ", {0: way}).outputs["Z"]
    ramp = add("ValToRGB", {0: add("MapRange", {0: up, 1: -0.02, 2: 0.6}).outputs[0]})
    stops = ramp.color_ramp.elements
    stops[0].color, stops[1].color = (0.46, 0.49, 0.51, 1.0), (0.09, 0.18, 0.36, 1.0)
    stops.new(0.22).color = (0.27, 0.37, 0.50, 1.0)
    # seen from below, clouds lie on a plane: nearer the horizon they are flatter
    parts = add("SeparateXYZ", {0: way})
    high = add("Math", {0: up, 1: 0.06}, operation="ADD").outputs[0]
    flat = [add("Math", {0: parts.outputs[axis], 1: high}, operation="DIVIDE").outputs[0] for axis in ("X", "Y")]
    above = add("CombineXYZ", {"X": flat[0], "Y": flat[1]}).outputs[0]
    cloud = add("TexNoise", {"Vector": above, "Scale": 0.55, "Detail": 9.0, "Roughness": 0.6, "Distortion": 0.4}).outputs[0]
    share = add("MapRange", {0: cloud, 1: 0.50, 2: 0.78, 3: 0.0, 4: 0.75}).outputs[0]
    sky = add("Mix", {0: share, 6: ramp.outputs[0], 7: (0.52, 0.53, 0.54, 1.0)}, data_type="RGBA").outputs[2]
    link(sky, nodes["Background"].inputs["Color"])


def settings(scene: bpy.types.Scene, camera: dict, path: Path) -> None:
    """Cycles on the CPU, one image of the clip's size."""
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    cycles.device, cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = "CPU", SAMPLES, False, False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces, cycles.transmission_bounces = 2, 1, 0, 2
    cycles.sample_clamp_indirect = 4.0
    render.resolution_x, render.resolution_y, render.resolution_percentage = camera["width"], camera["height"], 100
    scene.view_settings.view_transform, scene.view_settings.exposure = "Standard", EXPOSURE
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    render.filepath, render.use_file_extension = str(path), False


def even_out(path: Path) -> None:
    """Mix neighbouring pixels of an image, which is out of focus all over, so that what is left of the noise of few samples goes."""
    image = bpy.data.images.load(str(path))
    pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(image.size[1], image.size[0], 4)
    for axis in (0, 1) * EVENED:
        padded = np.pad(pixels, [(2, 2) if each == axis else (0, 0) for each in range(3)], mode="edge")
        count = pixels.shape[axis]
        pixels = sum(w / 16.0 * np.take(padded, np.arange(k, k + count), axis=axis) for k, w in enumerate((1, 4, 6, 4, 1)))
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    image.save()


if __name__ == "__main__":
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(Path(words[0]).resolve(), int(words[1]), float(words[2]))
