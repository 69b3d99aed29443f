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
CELLS = (6, 31)
"""Its faces across and along."""
MATERIAL = {"material": "leaf", "density": 400.0, "youngs_modulus": 1.0e5}
"""As heavy as the leaf, so that the same wind carries it; stiff enough not to tear where it is held."""
BESIDE = 0.27
"""The ribbons hang that far apart [m]."""
SAMPLES = 16
"""Of Cycles, per pixel."""
SEEDS = 60
"""Native particles: few and bright enough to be seen as what they are, not as noise of the picture."""


def main(folder: Path) -> None:
    """Load the recovery, insert, pin, weigh, re-simulate, bake, add particles, save, render."""
    say("loading the recovered field")
    start(folder)
    scene = bpy.context.scene
    insert_ribbons(scene)
    say("simulating three ribbons in the recovered wind")
    done(bpy.ops.seeing_wind.resimulate())
    done(bpy.ops.seeing_wind.bake())
    add_seeds(scene)
    # make.py's camera has no shutter: its pictures are sharp
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
    for name, at, colour in (
        ("Ribbon", place, (0.02, 0.33, 0.42)),
        ("Ribbon Pinned", place - right, (0.50, 0.05, 0.16)),
        ("Ribbon Twice the Mass", place + [0.0, 0.02, 0.0], (0.62, 0.33, 0.02)),
    ):
        ribbon = make_ribbon(name, at, colour)
        done(bpy.ops.seeing_wind.insert_mesh(object=ribbon.name, material=MATERIAL["material"]))
        body = scene.seeing_wind.bodies[-1]
        body.use_density, body.density = True, MATERIAL["density"]
        body.use_youngs_modulus, body.youngs_modulus = True, MATERIAL["youngs_modulus"]
    done(bpy.ops.seeing_wind.pin_vertices(object="Ribbon Pinned", vertex_group="Held"))
    done(bpy.ops.seeing_wind.scale_mass(object="Ribbon Twice the Mass", factor=2.0))


def start_of(leaf) -> np.ndarray:
    """Middle of the recovered object in picture 0 [m]."""
    vertices = np.empty(3 * len(leaf.data.vertices), dtype=np.float32)
    leaf.data.vertices.foreach_get("co", vertices)
    return vertices.reshape(-1, 3).mean(0) @ np.array(leaf.matrix_world)[:3, :3].T + np.array(leaf.matrix_world)[:3, 3]


def make_ribbon(name: str, centre: np.ndarray, colour: tuple[float, float, float]):
    """A ribbon that hangs, slightly twisted, with stripes across; its upper edge is the vertex group "Held"."""
    across, along = np.meshgrid(np.linspace(-0.5, 0.5, CELLS[0] + 1), np.linspace(0.5, -0.5, CELLS[1] + 1))
    twist = 0.9 * along
    vertices = np.stack([np.cos(twist) * across * RIBBON[0], np.sin(twist) * across * RIBBON[0], along * RIBBON[1]], -1).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(across.shape)
    faces = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata((vertices + centre).tolist(), [], faces.tolist())
    mesh.shade_smooth()
    for tone in (colour, (0.92, 0.88, 0.80)):
        mesh.materials.append(cloth(name, tone))
    stripe = (np.arange(CELLS[1]) // 3 % 2).repeat(CELLS[0])
    mesh.polygons.foreach_set("material_index", stripe.astype(np.int32))
    ribbon = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(ribbon)
    ribbon.vertex_groups.new(name="Held").add(index[0].tolist(), 1.0, "REPLACE")
    return ribbon


def cloth(name: str, colour: tuple[float, float, float]):
    """A matt, slightly shining material."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*colour, 1.0)
    surface.inputs["Roughness"].default_value = 0.5
    return material


def add_seeds(scene) -> None:
    """A native particle system, moved by the field object and gravity as matter of the recovered density."""
    field = scene.seeing_wind.field_object
    places = np.random.default_rng(5).uniform([-0.1, -0.04, -0.15], [0.75, 0.04, 0.15], (SEEDS, 3))
    places += start_of(scene.seeing_wind.recovered_object)
    mesh = bpy.data.meshes.new("Seeds")
    mesh.from_pydata(places.tolist(), [], [])
    emitter = bpy.data.objects.new("Seeds", mesh)
    scene.collection.objects.link(emitter)
    emitter.show_instancer_for_render = False
    settings = emitter.modifiers.new("Seeds", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.emit_from, settings.use_emit_random = SEEDS, "VERT", False
    settings.normal_factor, settings.lifetime = 0.0, 1000.0
    settings.frame_start = settings.frame_end = scene.frame_start
    calibrate_particles(settings, field, mass=1.0e-3)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=1.0, location=(0.0, 0.0, -50.0))
    seed = bpy.context.object
    seed.name = "Seed"
    seed.data.materials.append(cloth("Seed", (0.9, 0.45, 0.02)))
    settings.render_type, settings.instance_object, settings.particle_size = "OBJECT", seed, 0.0065
    for frame in range(scene.frame_start, scene.frame_end + 1):  # fills the point cache
        scene.frame_set(frame)
    bpy.ops.ptcache.bake_all(bake=True)


if __name__ == "__main__":
    main(Path((sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])[0]).resolve())
