"""The Blender part of the demo: demo.blend and edited.mp4. Runs inside Blender or any Python that has the `bpy` wheel.

    blender -b --factory-startup --python demo_scene.py -- DIR         or         python demo_scene.py DIR

DIR holds clip/ and wind.take/ as demo.py made them. Everything is done with the operators that the panel has.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))  # the source tree

import seeing_wind.ui as ui  # noqa: E402
from seeing_wind.ui.field.solvers.particles import calibrate_particles  # noqa: E402

RIBBON = (0.05, 0.26)
"""Width and length of the inserted ribbon [m]."""
CELLS = (6, 40)
"""Its faces across and along."""
CURL = (0.02, 0.17)
"""How far a ribbon that comes off its spool waves, and the length of a wave [m]."""
SLANT = 0.35
"""Ribbons are cut askew: how far along for every metre across."""
MATERIAL, DENSITY = "cotton", 400.0
"""Cloth: an open mesh is simulated as a shell. As dense as the leaf [kg/m³], so that the same wind carries it."""
BESIDE = 0.27
"""The ribbons hang that far apart [m]."""
SAMPLES = 16
"""Of Cycles, per pixel."""
LEAVES, LEAF = 60, 0.04
"""Native particles: few and large enough to be seen as what they are, not as noise of the frame; their length [m]."""
AUTUMN = ([0.30, 0.07, 0.015], [0.55, 0.17, 0.02], [0.62, 0.36, 0.04], [0.24, 0.22, 0.04], [0.20, 0.09, 0.03])
"""Linear colours of small leaves."""


def main(folder: Path) -> None:
    """Load the recovery, insert, pin, weigh, re-simulate, bake, add particles, save, render."""
    say("loading the recovered field")
    start(folder)
    scene = bpy.context.scene
    insert_ribbons(scene)
    grow_twig(scene)
    say("simulating three ribbons in the recovered wind")
    done(bpy.ops.seeing_wind.resimulate())
    done(bpy.ops.seeing_wind.bake())
    add_leaves(scene)
    # make.py's camera has no shutter: its frames are sharp
    done(bpy.ops.seeing_wind.set_up_composite(samples=SAMPLES, shutter=0.0))
    scene.frame_set(scene.frame_start)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "demo.blend"), compress=True)
    say("rendering edited.mp4")
    done(bpy.ops.seeing_wind.render_composite(filepath=str(folder / "edited.mp4")))


def say(what: str) -> None:
    """A line that demo.py passes on."""
    print(f"demo: {what}", flush=True)


def done(outcome: set) -> None:
    """Operators report errors as an outcome; here an error ends the script."""
    if outcome != {"FINISHED"}:
        raise SystemExit("demo: an operator did not finish; what it said is above")


def start(folder: Path) -> None:
    """An empty file with the extension switched on and the take's results in it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if not hasattr(bpy.types.Scene, "seeing_wind"):
        ui.register()
    done(bpy.ops.seeing_wind.build_scene(take=str(folder / "wind.take"), clip=str(folder / "clip" / "clip.mp4")))


# -- the edit ---------------------------------------------------------------------------------------------------------------------


def insert_ribbons(scene) -> None:
    """The inserted mesh three times: as it is, held at its upper end, and at twice its mass."""
    right = np.array([BESIDE, 0.0, 0.0])
    place = start_of(scene.seeing_wind.recovered_object) + 2.0 * right + [0.0, 0.0, 0.02]
    for name, at, phase, colour in (
        ("Ribbon", place, 0.5, (0.03, 0.22, 0.27)),
        ("Ribbon Pinned", place - right, 0.0, (0.42, 0.03, 0.06)),
        ("Ribbon Twice the Mass", place + [0.0, 0.09, 0.0], 2.6, (0.55, 0.27, 0.03)),
    ):
        ribbon = make_ribbon(name, at, phase, colour)
        done(bpy.ops.seeing_wind.insert_mesh(object=ribbon.name, material=MATERIAL))
        body = scene.seeing_wind.bodies[-1]
        body.use_density, body.density = True, DENSITY
    done(bpy.ops.seeing_wind.pin_vertices(object="Ribbon Pinned", vertex_group="Held"))
    done(bpy.ops.seeing_wind.scale_mass(object="Ribbon Twice the Mass", factor=2.0))


def start_of(leaf) -> np.ndarray:
    """Middle of the recovered object in frame 0 [m]."""
    vertices = np.empty(3 * len(leaf.data.vertices), dtype=np.float32)
    leaf.data.vertices.foreach_get("co", vertices)
    return vertices.reshape(-1, 3).mean(0) @ np.array(leaf.matrix_world)[:3, :3].T + np.array(leaf.matrix_world)[:3, 3]


def make_ribbon(name: str, centre: np.ndarray, phase: float, colour: tuple[float, float, float]):
    """A ribbon that hangs, slightly twisted and in waves from its spool; its upper edge is the vertex group "Held"."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, CELLS[0] + 1), np.linspace(0.0, 1.0, CELLS[1] + 1))
    across, along = (u - 0.5) * RIBBON[0], (0.5 - v) * RIBBON[1]
    along += SLANT * across * (2.0 * v - 1.0) * (v > 0.5)  # its lower end; what is held is straight
    twist = 3.5 * (along - 0.5 * RIBBON[1])
    turn = 2.0 * np.pi / CURL[1] * (0.5 * RIBBON[1] - along) + phase
    wave = CURL[0] * (np.sin(turn) - np.sin(phase))
    # as long as it is along the wave
    down = along - 0.25 * (2.0 * np.pi * CURL[0] / CURL[1]) ** 2 * (along - 0.5 * RIBBON[1])
    vertices = np.stack([np.cos(twist) * across, np.sin(twist) * across + wave, down], -1).reshape(-1, 3)
    ribbon = new_object(name, vertices + centre, u, v)
    ribbon.data.materials.append(cloth(name, colour))
    ribbon.vertex_groups.new(name="Held").add(list(range(CELLS[0] + 1)), 1.0, "REPLACE")
    return ribbon


def new_object(name: str, vertices: np.ndarray, u: np.ndarray, v: np.ndarray):
    """A smooth mesh of vertices (R * C, 3) [m] in rows and columns, with u and v (R, C) as its UV map."""
    index = np.arange(u.size).reshape(u.shape)
    faces = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    mesh.shade_smooth()
    flat = np.stack([u.ravel(), v.ravel()], -1)[faces.ravel()]
    mesh.uv_layers.new().data.foreach_set("uv", flat.astype(np.float32).ravel())
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def cloth(name: str, colour: tuple[float, float, float]):
    """Cotton: unevenly dyed and a little faded, with two woven stripes, and bright where the light is behind it."""
    material, surface, add = thin(name, 0.85)
    flat = add("TexCoord", {}).outputs["UV"]
    metres = add("VectorMath", {0: flat, 1: (*RIBBON, 0.0)}, operation="MULTIPLY").outputs[0]
    faded = [0.25 + 0.6 * value for value in colour]
    dye = add("TexNoise", {"Vector": metres, "Scale": 30.0, "Detail": 6.0, "Roughness": 0.65})
    worn = [0.6 * value + 0.4 * pale for value, pale in zip(colour, faded, strict=True)]
    uneven = ramp(add, dye.outputs[0], ((0.3, [0.55 * value for value in colour]), (0.52, colour), (0.75, worn)))
    across = add("SeparateXYZ", {0: flat}).outputs[0]
    stripes = [(at + side, [white] * 3) for at in (0.24, 0.76) for side, white in ((-0.09, 0.0), (-0.03, 0.8), (0.03, 0.8), (0.09, 0.0))]
    woven = ramp(add, across, stripes)
    link = material.node_tree.links.new
    mixed = add("Mix", {}, data_type="RGBA")
    for value, socket in ((woven.outputs[0], 0), (uneven.outputs[0], 6)):
        link(value, mixed.inputs[socket])
    mixed.inputs[7].default_value = (*faded, 1.0)
    for node in surface:
        link(mixed.outputs[2], node.inputs[0])
    creases = add("TexNoise", {"Vector": metres, "Scale": 70.0, "Detail": 3.0})
    bump = add("Bump", {"Height": creases.outputs[0], "Strength": 0.5, "Distance": 0.003})
    for node in surface:
        link(bump.outputs[0], node.inputs["Normal"])
    return material


def grow_twig(scene) -> None:
    """What the held ribbon hangs from: a twig that reaches into the frame from above."""
    held = start_of(scene.seeing_wind.recovered_object) + [BESIDE, 0.0, 0.02 + 0.5 * RIBBON[1]]
    right = np.array([-0.05, -0.02, 0.03, 0.07, 0.13, 0.2])
    way = np.stack([right, np.array([0.0, 0.0, 0.0, 0.01, 0.02, 0.02]), np.array([-0.006, 0.0, 0.001, 0.016, 0.06, 0.16])], axis=1)
    curve = bpy.data.curves.new("Twig", "CURVE")
    curve.dimensions, curve.bevel_depth, curve.bevel_resolution = "3D", 0.0035, 3
    for points, thick in ((way, np.linspace(0.45, 1.5, len(way))), (way[3] + [[0.0] * 3, [-0.03, 0.02, 0.05]], np.array([0.6, 0.25]))):
        spline = curve.splines.new("POLY")
        spline.points.add(len(points) - 1)
        for point, place, radius in zip(spline.points, points + held, thick, strict=True):
            point.co, point.radius = (*place, 1.0), radius
    twig = bpy.data.objects.new("Twig", curve)
    scene.collection.objects.link(twig)
    material = bpy.data.materials.new("Bark")
    material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value, surface.inputs["Roughness"].default_value = (0.06, 0.038, 0.024, 1.0), 0.9
    curve.materials.append(material)


def thin(name: str, roughness: float):
    """A new material of what lets a third of the light through: it, its two surfaces, and a function that adds nodes."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree

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

    front, behind = tree.nodes["Principled BSDF"], add("BsdfTranslucent", {})
    front.inputs["Roughness"].default_value = roughness
    both = add("MixShader", {0: 0.35, 1: front.outputs[0], 2: behind.outputs[0]})
    tree.links.new(both.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material, (front, behind), add


def ramp(add, value, stops, interpolation: str = "LINEAR"):
    """A colour ramp node over stops of places and linear colours."""
    node = add("ValToRGB", {0: value})
    elements = node.color_ramp.elements
    node.color_ramp.interpolation = interpolation
    while len(elements) < len(stops):
        elements.new(1.0)
    for element, (at, colour) in zip(elements, stops, strict=True):
        element.position, element.color = at, (*colour, 1.0)
    return node


def add_leaves(scene) -> None:
    """A native particle system, moved by the field object and gravity as matter of the recovered density."""
    field = scene.seeing_wind.field_object
    places = np.random.default_rng(5).uniform([-0.1, -0.04, -0.15], [0.75, 0.04, 0.15], (LEAVES, 3))
    places += start_of(scene.seeing_wind.recovered_object)
    mesh = bpy.data.meshes.new("Leaves")
    mesh.from_pydata(places.tolist(), [], [])
    emitter = bpy.data.objects.new("Leaves", mesh)
    scene.collection.objects.link(emitter)
    emitter.show_instancer_for_render = False
    settings = emitter.modifiers.new("Leaves", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.emit_from, settings.use_emit_random = LEAVES, "VERT", False
    settings.normal_factor, settings.lifetime = 0.0, 1000.0
    settings.frame_start = settings.frame_end = scene.frame_start
    settings.use_rotations, settings.rotation_factor_random, settings.phase_factor_random = True, 1.0, 2.0
    settings.angular_velocity_mode, settings.angular_velocity_factor = "RAND", 5.0
    calibrate_particles(settings, field, mass=1.0e-3)
    settings.render_type, settings.instance_object = "OBJECT", small_leaf()
    settings.particle_size, settings.size_random = 1.0, 0.55
    for frame in range(scene.frame_start, scene.frame_end + 1):  # fills the point cache
        scene.frame_set(frame)
    bpy.ops.ptcache.bake_all(bake=True)


def small_leaf():
    """A pointed leaf, folded along its rib and curled, out of the frame; each of its instances has its own colour of autumn."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 7), np.linspace(0.0, 1.0, 13))
    side, along = 2.0 * u - 1.0, LEAF * (v - 0.5)
    across = 0.36 * LEAF * side * np.sin(np.pi * v**0.8) ** 0.8
    up = 0.4 * np.abs(across) + 2.2 * along**2 / LEAF
    leaf = new_object("Small Leaf", np.stack([across, along, up], -1).reshape(-1, 3), u, v)
    leaf.location = (0.0, 0.0, -50.0)
    material, surface, add = thin("Small Leaf", 0.6)
    chance = add("ParticleInfo", {}).outputs["Random"]
    tone = ramp(add, chance, tuple((k / (len(AUTUMN) - 1), colour) for k, colour in enumerate(AUTUMN)))
    spots = ramp(add, add("TexNoise", {"Scale": 160.0, "Detail": 3.0}).outputs[0], ((0.35, [0.45] * 3), (0.6, [1.0] * 3)))
    mixed = add("Mix", {0: 1.0}, data_type="RGBA", blend_type="MULTIPLY")
    for value, socket in ((tone.outputs[0], 6), (spots.outputs[0], 7)):
        material.node_tree.links.new(value, mixed.inputs[socket])
    for node in surface:
        material.node_tree.links.new(mixed.outputs[2], node.inputs[0])
    leaf.data.materials.append(material)
    return leaf


if __name__ == "__main__":
    main(Path((sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])[0]).resolve())
