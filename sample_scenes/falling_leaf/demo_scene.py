"""The Blender part of the demo: demo.blend and edited.mp4. Runs inside Blender or any Python that has the `bpy` wheel.

    blender -b --factory-startup --python demo_scene.py -- DIR         or         python demo_scene.py DIR

DIR holds clip/, wind.take/ and the leaves as demo.py made them. Everything is done with the operators that the panel has.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "common"), str(HERE.parents[1])]  # the source tree

from meadow import F_STOP  # noqa: E402
from washing import INSET, blank, hang_cloth, hang_line, new_mesh, place_on, set_post, woven  # noqa: E402

import seeing_wind.ui as ui  # noqa: E402
from seeing_wind.ui.field.solvers.particles import calibrate_particles  # noqa: E402

LINE = np.array([[-1.60, 1.40, 0.28], [1.40, -0.46, 0.14]])
"""The ends of the washing line, right of, behind and above the leaf's first place [m]: beyond both sides of the frame, and askew, since
cloth along the frame would hide how the wind, which blows across it, bellies it out."""
TOWEL, NAPKIN = (0.27, 0.36), (0.20, 0.20)
"""Width and height of what hangs there [m];"""
OVER, CORNERS = 0.05, 0.045
"""So much of the towel is turned over the line, and so far from its corners, which hang down, do the outer pegs bite [m];"""
TOWEL_FOLDS, NAPKIN_FOLDS = (0.13, 0.18), (0.15, 0.06)
"""length [m] and slack of their folds: the edge sags between two pegs, and a fold runs down from there, which wind alone does not raise;"""
TOWEL_AT, NAPKIN_AT = 0.56, 0.88
"""how far to the right,"""
TEA_TOWEL, LINEN = 1.7, 1.5
"""and their mass factors: a tea towel weighs 200 g/m², a napkin 180, a shirt's cotton 120. At its strongest, the updraft that carries the
leaf lifts one and a tenth of a shirt's weight, and would throw it over the line."""
POSTS = np.array([[-1.55, 4.5, 1.78], [2.75, 5.2, 1.74]])
"""Where a second line is tied to two posts in the meadow [m, world]: in the frame, feet and shadows, too, since what stands nowhere is
seen to be put in."""
SHEETS = (
    ("Sheet", -0.62, (1.60, 1.28), 6, (0.94, 0.90, 0.84), (0.58, 0.60, 0.66)),
    ("Pillowcase", 2.0, (0.5, 0.74), 3, (0.92, 0.87, 0.76), (0.74, 0.50, 0.30)),
)
"""What hangs there: how far to the right [m, world], width and height [m], pegs, and its colours;"""
BED_LINEN, COARSE, SOFT = 2.0, 0.036, 0.002
"""its mass factor, and the edges of its faces and pixels [m], as it is out of focus;"""
SHADOWS = (1.35, 5.45), (6.4, 2.7)
"""Where the shadows of posts and bed linen fall: the middle, and how far to the right and away from the camera [m, world];"""
FULL_FOLDS = (0.34, 0.16)
"""length and slack of its folds, deep enough to be seen from there."""
ROPE, WHITE = 0.008, (0.62, 0.62, 0.58)
"""Thickness [m] and colour of that line, one of plastic, and"""
STORM_PEG, PLASTIC = (0.018, 0.088, 0.020), ((0.60, 0.05, 0.04), (0.70, 0.42, 0.03), (0.05, 0.16, 0.55))
"""size [m] and colours of its pegs: what is thin and grey is lost in the blur at that distance."""
SETTLE = 30
"""Frames for which they hang before the clip begins."""
DENSITY = 400.0
"""Of the leaves that fly, as dense as the filmed one [kg/m³], so that the same wind carries them."""
LEAF, FIRST, SECOND = 0.40, (0.27, 0.02, -0.05), (-0.38, -0.05, 0.10)
"""Size of the two leaves that are simulated over that of the filmed one, and where they begin [m]."""
SAMPLES, FEWEST, NOISE = 36, 12, 0.03
"""Of Cycles, per pixel, at most and at least, and the noise at which a pixel has enough. No denoiser smooths the rims of what is
out of focus: they are a matter of alpha."""
LEAVES, SMALL = 44, (0.12, 0.26)
"""Native particles, and their size over that of the filmed leaf."""
AWAY, ACROSS, UP = (1.35, 4.8), (-0.50, 0.52), (-0.08, 0.36)
"""Where they begin: away from the camera [m], right of its axis and above it [parts of that]."""
BACKSIDE = (0.60, 0.42, 0.22)
"""Colour of a leaf's lower side, linear: paler and duller;"""
THROUGH = (0.35, 0.8)
"""and how much of its light has come through it, seen across and along its surface: its rim glows against the sun."""


def main(folder: Path) -> None:
    """Load the recovery, insert, pin, weigh, re-simulate, bake, add particles, save, render."""
    say("loading the recovered field")
    start(folder)
    scene = bpy.context.scene
    # far behind the filmed leaf the wind is taken to be as at the edge of what is known
    scene.seeing_wind.field_reach = "HOLD"
    done(bpy.ops.seeing_wind.apply_to_field())
    insert_washing(scene)
    insert_leaves(scene, folder)
    say("simulating four cloths and two leaves in the recovered wind")
    done(bpy.ops.seeing_wind.resimulate())
    done(bpy.ops.seeing_wind.bake())
    add_leaves(scene, folder)
    set_cost(scene.cycles)
    # make.py's camera has no shutter: its frames are sharp
    done(bpy.ops.seeing_wind.set_up_composite(samples=SAMPLES, shutter=0.0, fstop=F_STOP, floor=True))
    lay_floor(scene)
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


def start_of(leaf) -> np.ndarray:
    """Middle of the recovered object in frame 0 [m]."""
    vertices = np.empty(3 * len(leaf.data.vertices), dtype=np.float32)
    leaf.data.vertices.foreach_get("co", vertices)
    return vertices.reshape(-1, 3).mean(0) @ np.array(leaf.matrix_world)[:3, :3].T + np.array(leaf.matrix_world)[:3, 3]


def set_cost(cycles) -> None:
    """What a frame costs beside its samples. Empty pixels, most of them, need few; and a denoiser as thorough as Blender's usual one takes
    as long as twenty samples, whatever the frame shows."""
    cycles.use_adaptive_sampling, cycles.adaptive_threshold, cycles.adaptive_min_samples = True, NOISE, FEWEST
    cycles.use_denoising, cycles.denoising_prefilter, cycles.denoising_quality = True, "FAST", "FAST"


def lay_floor(scene) -> None:
    """What catches shadows lies where the meadow's ground is, as far as they reach and no further: each of its samples counts twice."""
    floor = scene.objects["Seeing Wind Floor"]
    floor.location, floor.dimensions = (*SHADOWS[0], 0.0), (*SHADOWS[1], 0.0)


# -- the edit ---------------------------------------------------------------------------------------------------------------------


def insert_washing(scene) -> None:
    """A towel and a napkin on a line, held where their pegs bite."""
    leaf = start_of(scene.seeing_wind.recovered_object)
    line = leaf + LINE
    hang_line(*line)
    towel = woven(TOWEL, (0.93, 0.91, 0.86), (0.22, 0.35, 0.56), 3, checked=False)
    napkin = woven(NAPKIN, (0.92, 0.88, 0.83), (0.70, 0.24, 0.21), 4, checked=True)
    hung = (
        ("Towel", TOWEL_AT, TOWEL, 3, towel, TOWEL_FOLDS, OVER, CORNERS, TEA_TOWEL),
        ("Napkin", NAPKIN_AT, NAPKIN, 2, napkin, NAPKIN_FOLDS, 0.0, INSET, LINEN),
    )
    for name, x, size, pegs, texture, folds, over, inset, mass in hung:
        hang_cloth(name, *place_on(*line, leaf[0] + x), size, pegs, texture, folds=folds, over=over, inset=inset)
        done(bpy.ops.seeing_wind.insert_mesh(object=name, material="cotton"))
        done(bpy.ops.seeing_wind.pin_vertices(object=name, vertex_group="Held"))
        done(bpy.ops.seeing_wind.scale_mass(object=name, factor=mass))
    set_yard()
    scene.seeing_wind.edit_preroll = SETTLE


def set_yard() -> None:
    """A second line between posts in the meadow, with bed linen on it."""
    hang_line(*POSTS, ROPE, WHITE)
    for number, top in enumerate(POSTS):
        set_post(f"Post {number}", top)
    for name, x, size, pegs, ground, stripe in SHEETS:
        texture = woven(size, ground, stripe, 5, checked=False, fine=SOFT)
        hang_cloth(name, *place_on(*POSTS, x), size, pegs, texture, COARSE, FULL_FOLDS, peg_size=STORM_PEG, peg_colours=PLASTIC)
        done(bpy.ops.seeing_wind.insert_mesh(object=name, material="cotton", pin_group="Held"))
        done(bpy.ops.seeing_wind.scale_mass(object=name, factor=BED_LINEN))


def insert_leaves(scene, folder: Path) -> None:
    """Two leaves of the same make that fly off, one at twice the mass of the other."""
    place = start_of(scene.seeing_wind.recovered_object)
    for name, at, number, turn in (("Leaf", FIRST, 0, 0.7), ("Leaf Twice the Mass", SECOND, 1, -0.9)):
        flat, faces, uv, texture = pressed(folder, number)
        c, s = np.cos(turn), np.sin(turn)
        x, z = LEAF * (c * flat[:, 0] - s * flat[:, 1]), LEAF * (s * flat[:, 0] + c * flat[:, 1])
        leaf = new_mesh(name, np.stack([x, LEAF * curled(flat), z], -1) + place + at, faces, uv)
        leaf.data.materials.append(leaf_material(name, texture))
        # a settling cloth's frames are not theirs
        done(bpy.ops.seeing_wind.insert_mesh(object=name, material="leaf", density=DENSITY, start_frame=1))
    done(bpy.ops.seeing_wind.scale_mass(object="Leaf Twice the Mass", factor=2.0))


def add_leaves(scene, folder: Path) -> None:
    """A native particle system, moved by the field object and gravity as matter of the recovered density. It begins nearer to the camera
    than the filmed leaf and goes on far behind it."""
    field, rng = scene.seeing_wind.field_object, np.random.default_rng(5)
    away = rng.uniform(*AWAY, LEAVES)
    ahead = np.stack([away * rng.uniform(*ACROSS, LEAVES), away, away * rng.uniform(*UP, LEAVES)], axis=1)
    places = np.array(scene.camera.matrix_world.translation) + ahead
    mesh = bpy.data.meshes.new("Leaves")
    mesh.from_pydata(places.tolist(), [], [])
    emitter = bpy.data.objects.new("Leaves", mesh)
    scene.collection.objects.link(emitter)
    emitter.show_instancer_for_render = False
    settings = emitter.modifiers.new("Leaves", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.emit_from, settings.use_emit_random = LEAVES, "VERT", False
    settings.normal_factor, settings.factor_random, settings.lifetime = 0.0, 0.25, 1000.0
    settings.frame_start = settings.frame_end = scene.frame_start
    settings.use_rotations, settings.rotation_factor_random, settings.phase_factor_random = True, 1.0, 2.0
    settings.angular_velocity_mode, settings.angular_velocity_factor = "RAND", 4.0
    calibrate_particles(settings, field, mass=1.0e-3)
    settings.render_type, settings.instance_collection = "COLLECTION", small_leaves(scene, folder)
    settings.use_collection_pick_random = True
    settings.particle_size, settings.size_random = SMALL[1], 1.0 - SMALL[0] / SMALL[1]
    for frame in range(scene.frame_start, scene.frame_end + 1):  # fills the point cache
        scene.frame_set(frame)
    bpy.ops.ptcache.bake_all(bake=True)


# -- leaves -----------------------------------------------------------------------------------------------------------------------


def pressed(folder: Path, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, Path]:
    """A leaf as demo.py drew it: vertices (V, 2) [m], faces (M, 3), uv (V, 2), and its frame."""
    with np.load(folder / f"leaf_{number}.npz", allow_pickle=False) as leaf:
        return leaf["vertices"].astype(float), leaf["triangles"], leaf["uv"], folder / f"leaf_{number}.png"


def curled(flat: np.ndarray) -> np.ndarray:
    """How far a leaf that is flat at (V, 2) [m] stands up as it dries [m]: folded along its rib, and bent back towards its tip."""
    return 0.35 * np.sqrt(flat[:, 0] ** 2 + 4e-4) + 1.1 * flat[:, 1] ** 2 + 0.9 * flat[:, 0] * flat[:, 1]


def small_leaves(scene, folder: Path) -> bpy.types.Collection:
    """What particles are instances of: leaves out of the frame."""
    several = bpy.data.collections.new("Small Leaves")
    for number in range(3):
        flat, faces, uv, texture = pressed(folder, number)
        leaf = new_mesh(f"Small Leaf {number}", np.concatenate([flat, 1.6 * curled(flat)[:, None]], axis=1), faces, uv)
        leaf.location = (0.0, 0.0, -50.0)
        leaf.data.materials.append(leaf_material(leaf.name, texture, tones=True))
        scene.collection.objects.unlink(leaf)
        several.objects.link(leaf)
    scene.collection.children.link(several)
    return several


def leaf_material(name: str, texture: Path, tones: bool = False) -> bpy.types.Material:
    """As the clip's leaf, with a paler lower side, and light that shines through; with `tones` each particle has its own."""
    material, add = blank(name)
    image = bpy.data.images.load(str(texture), check_existing=True)
    image.pack()
    colour = add("TexImage", {}, image=image, interpolation="Cubic").outputs[0]
    bump = add("Bump", {"Height": colour, "Strength": 0.25, "Distance": 0.004}).outputs[0]
    if tones:
        chance = add("ParticleInfo", {}).outputs["Random"]
        hue, value = (add("MapRange", {0: chance, 3: low, 4: high}).outputs[0] for low, high in ((0.46, 0.52), (1.5, 0.8)))
        colour = add("HueSaturation", {"Color": colour, "Hue": hue, "Saturation": 0.95, "Value": value}).outputs[0]
    pale = add("Mix", {0: 0.4, 6: colour, 7: (*BACKSIDE, 1.0)}, data_type="RGBA").outputs[2]
    back = add("NewGeometry", {}).outputs["Backfacing"]
    seen = add("Mix", {0: back, 6: colour, 7: pale}, data_type="RGBA").outputs[2]
    front = add("BsdfPrincipled", {"Base Color": seen, "Roughness": 0.62, "Specular IOR Level": 0.25, "Normal": bump})
    behind = add("BsdfTranslucent", {0: colour, "Normal": bump})
    grazing = add("LayerWeight", {"Blend": 0.5}).outputs["Facing"]
    share = add("MapRange", {0: grazing, 3: THROUGH[0], 4: THROUGH[1]}).outputs[0]
    both = add("MixShader", {0: share, 1: front.outputs[0], 2: behind.outputs[0]})
    material.node_tree.links.new(both.outputs[0], material.node_tree.nodes["Material Output"].inputs["Surface"])
    return material


if __name__ == "__main__":
    main(Path((sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])[0]).resolve())
