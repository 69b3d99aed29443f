"""Renders a frame of each everyday object with Cycles: DIR/NAME.jpg. Runs inside Blender or any Python with the `bpy` wheel.

blender -b --factory-startup --python render.py -- DIR [NAME ...]         or         python render.py DIR [NAME ...]
"""

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy  # noqa: E402
import numpy as np  # noqa: E402
from shapes import box, curve_profile, dented_ball, lathe, paint, ring, wire  # noqa: E402

SIZE, SAMPLES = 256, 24


def drinking_glass():
    wall = [(0, 0), (2.9, 0), (3.1, 0.2), (3.7, 10), (3.55, 10.1), (3.4, 10), (2.85, 1.2), (2.6, 0.9), (0, 0.9)]
    return [paint(lathe("glass", wall), (1, 1, 1), transmission_weight=1.0, ior=1.52, roughness=0.0)]


def porcelain_cup():
    outer = curve_profile([(2.3, 0), (2.5, 0.4), (3.6, 2.5), (4.1, 5), (4.3, 7.5)])
    inner = curve_profile([(4.1, 7.5), (3.9, 5), (3.4, 2.6), (2.2, 0.9), (0, 0.7)])
    cup = lathe("cup", [(0, 0.3), (2.0, 0.3), (2.1, 0), *outer, *inner])
    t = np.linspace(-1.35, 1.35, 40)
    handle = wire("handle", np.stack([3.7 + 2.3 * np.cos(t), 0 * t, 4.3 + 2.2 * np.sin(t)], 1), 0.42)
    white = {"roughness": 0.12, "coat_weight": 0.6}
    return [paint(cup, (0.88, 0.88, 0.86), **white), paint(handle, (0.88, 0.88, 0.86), **white)]


def rubber_bands():
    colors = [(0.55, 0.08, 0.05), (0.62, 0.36, 0.12), (0.05, 0.2, 0.42), (0.1, 0.35, 0.1), (0.6, 0.42, 0.06)]
    bands = []
    for k in range(5):
        at = (1.6 * math.cos(2.1 * k), 1.6 * math.sin(2.1 * k), 0.35 + 0.28 * k)
        band = wire(f"band{k}", ring(3.1 - 0.2 * k, at, (0.06 * k, -0.05 * k), 0.08, k), 0.22)
        band.data.splines[0].use_cyclic_u = True
        bands.append(paint(band, colors[k], roughness=0.62))
    return bands


def cork_stopper():
    body = lathe("cork", [(0, 0), (2.3, 0), (2.45, 0.15), (2.9, 6.1), (2.75, 6.25), (0, 6.25)])
    return [paint(body, (0.62, 0.4, 0.2), roughness=0.9, noise=(2.2, 0.35, 0.6))]


def oak_board():
    board = box("board", (12, 7.5, 1.6), bevel=0.25)
    board.rotation_euler = (0, 0, 0.35)
    return [paint(board, (0.47, 0.27, 0.12), roughness=0.5, grain=(1.7, 0.5, 0.15))]


def concrete_block():
    parts = [((12, 1.5, 6), (0, -2.75, 0)), ((12, 1.5, 6), (0, 2.75, 0))]
    parts += [((1.5, 4.2, 6), (x, 0, 0)) for x in (-5.25, 0, 5.25)]
    slabs = [box(f"slab{k}", size, at, 0.08) for k, (size, at) in enumerate(parts)]
    return [paint(slab, (0.36, 0.35, 0.33), roughness=0.95, noise=(4.0, 0.5, 0.8)) for slab in slabs]


def steel_spoon():
    s, a = np.linspace(0, 1, 60), np.linspace(-1, 1, 24)
    width = np.where(s < 0.36, 1.9 * np.sqrt(np.clip(1 - ((s - 0.18) / 0.18) ** 2, 0, 1)), 0)
    stem = 0.34 + 0.5 * np.clip((s - 0.7) / 0.3, 0, 1) ** 1.5
    width = np.maximum(width, np.where(s > 0.3, stem, 0.0))
    rows = []
    for k, one in enumerate(s):
        bowl = -1.1 * np.clip(1 - ((one - 0.18) / 0.18) ** 2, 0, 1) * (1 - a**2)
        lift = 1.25 + 0.9 * np.clip((one - 0.36) / 0.3, 0, 1) - 0.4 * np.clip((one - 0.66) / 0.34, 0, 1)
        rows.append(np.stack([np.full(24, 15 * one - 7.5), a * max(width[k], 0.02), lift + bowl], 1))
    from shapes import mesh

    vertices = np.concatenate(rows)
    faces = [(i * 24 + j, i * 24 + j + 1, (i + 1) * 24 + j + 1, (i + 1) * 24 + j) for i in range(59) for j in range(23)]
    spoon = mesh("spoon", vertices, faces)
    thick = spoon.modifiers.new("thick", "SOLIDIFY")
    thick.thickness = 0.16
    spoon.rotation_euler = (0, 0, 0.6)
    return [paint(spoon, (0.62, 0.61, 0.6), metallic=1.0, roughness=0.12)]


def aluminium_profile():
    a, b = box("leg", (12, 0.5, 4.5), (0, 2, 0), 0.06), box("foot", (12, 4.5, 0.5), (0, 0, 0), 0.06)
    for part in (a, b):
        part.rotation_euler = (0, 0, 0.5)
    a.location = (-2 * math.sin(0.5), 2 * math.cos(0.5), a.location.z)
    return [paint(part, (0.82, 0.83, 0.85), metallic=1.0, roughness=0.33) for part in (a, b)]


def brass_bell():
    outer = curve_profile([(0.01, 6.6), (1.2, 6.4), (1.9, 5.2), (2.3, 3), (3.2, 0.9), (4.2, 0)])
    bell = lathe("bell", [*outer, (3.9, 0), (3.0, 0.9), (2.0, 3), (1.6, 5), (0, 5.8)])
    knob = lathe("knob", curve_profile([(0.0, 8.6), (0.9, 8.1), (0.55, 7.2), (0.5, 6.5)]))
    return [paint(part, (0.83, 0.56, 0.19), metallic=1.0, roughness=0.18) for part in (bell, knob)]


def copper_pipe():
    profile = [(1.5, 0), (1.5, 11), (1.3, 11), (1.3, 0)]
    first, second = lathe("pipe", profile), lathe("second", [(r, h * 0.75) for r, h in profile])
    first.rotation_euler, first.location = (0, math.pi / 2, 0.35), (-5.2, -2.2, 1.5)
    second.rotation_euler, second.location = (0, math.pi / 2, 0.2), (-4.4, 2.2, 1.5)
    return [paint(part, (0.86, 0.42, 0.27), metallic=1.0, roughness=0.2) for part in (first, second)]


def hdpe_bottle():
    body = lathe("bottle", [(0, 0), (2.9, 0), *curve_profile([(3.3, 0.4), (3.4, 3), (3.4, 7), (2.9, 8.8), (1.5, 10), (1.35, 10.6)])])
    cap = lathe("cap", [(1.75, 10.3), (1.75, 11.7), (1.6, 11.85), (0, 11.85)])
    milky = {"roughness": 0.42, "subsurface_weight": 0.5, "transmission_weight": 0.12}
    return [paint(body, (0.83, 0.84, 0.82), **milky), paint(cap, (0.05, 0.2, 0.55), roughness=0.4)]


def toy_brick():
    block = box("brick", (12.8, 6.4, 3.84), bevel=0.1)
    studs = []
    for x in (-4.8, -1.6, 1.6, 4.8):
        for y in (-1.6, 1.6):
            stud = lathe("stud", [(1.0, 3.8), (1.0, 4.5), (0.93, 4.58), (0, 4.58)], 48)
            stud.location = (x, y, 0)
            studs.append(stud)
    return [paint(part, (0.62, 0.015, 0.015), roughness=0.16, coat_weight=0.3) for part in (block, *studs)]


def lead_sinker():
    drop = lathe("lead", curve_profile([(0.0, 0), (1.7, 0.5), (2.2, 2), (1.5, 4.5), (0.6, 6.6), (0.35, 7.2), (0, 7.3)]))
    eye = wire("eye", ring(0.6, (0, 0, 7.7), (math.pi / 2, 0.3)), 0.12)
    eye.data.splines[0].use_cyclic_u = True
    drop.rotation_euler, eye.rotation_euler = (0, 1.2, 0.5), (0, 1.2, 0.5)
    drop.location = eye.location = (-3.2, -1.5, 1.95)
    dull = paint(drop, (0.16, 0.17, 0.19), metallic=0.85, roughness=0.5, noise=(1.6, 0.6, 0.25))
    return [dull, paint(eye, (0.4, 0.4, 0.4), metallic=1.0, roughness=0.3)]


def solder_coil():
    t = np.linspace(0, 1, 2600)
    turn = t * 2 * math.pi * 26
    layer = np.floor(t * 26 / 9)
    r = 3.0 + 0.34 * layer + 0.02 * np.sin(3 * turn)
    z = 0.2 + 0.34 * np.abs(((t * 26) % 18) - 9)
    points = np.stack([r * np.cos(turn), r * np.sin(turn), z], 1)
    s = np.linspace(0, 1, 80)[:, None]
    end = points[-1] + s * np.array([3.5, 4.5, 0]) + np.column_stack([0 * s, 0 * s, -s * (points[-1, 2] - 0.2) + 0.8 * np.sin(3.1 * s)])
    return [paint(wire("solder", np.concatenate([points, end]), 0.17), (0.72, 0.72, 0.72), metallic=1.0, roughness=0.27)]


def ice_cubes():
    cubes = []
    for k, (x, y, turn) in enumerate([(-2.6, -0.8, 0.3), (2.2, -1.4, -0.4), (0.2, 2.8, 0.9)]):
        cube = box(f"ice{k}", (3.8, 3.8, 3.5), (x, y, 0), 0.55)
        cube.rotation_euler = (0, 0, turn)
        cubes.append(paint(cube, (0.93, 0.97, 1.0), transmission_weight=1.0, ior=1.31, roughness=0.06, noise=(0.8, 0.9, 0.5)))
    return cubes


def beeswax_candle():
    wax = lathe("wax", [(0, 0), (2.6, 0), (2.7, 0.1), (2.7, 7.8), (2.5, 8.1), *curve_profile([(2.2, 8.05), (1.2, 7.8), (0, 7.7)])])
    wick = wire("wick", np.array([[0, 0, 7.6], [0.02, 0, 8.2], [0.15, 0.05, 8.9], [0.4, 0.05, 9.3]]), 0.11)
    honey = paint(wax, (0.78, 0.45, 0.1), roughness=0.45, subsurface_weight=0.4, noise=(1.1, 0.85, 0.1))
    return [honey, paint(wick, (0.08, 0.06, 0.05), roughness=0.9)]


def plasticine_ball():
    ball = dented_ball("plasticine", 4.0, [(0.3, -1, 0.3), (-0.6, -0.7, 0.6), (0.8, -0.4, 0.75)])
    return [paint(ball, (0.06, 0.28, 0.5), roughness=0.7, noise=(5.0, 0.85, 0.15))]


OBJECTS = [
    drinking_glass, porcelain_cup, rubber_bands, cork_stopper, oak_board, concrete_block,
    steel_spoon, aluminium_profile, brass_bell, copper_pipe, hdpe_bottle, toy_brick,
    lead_sinker, solder_coil, ice_cubes, beeswax_candle, plasticine_ball,
]  # fmt: skip


def studio() -> None:
    """An empty scene with a table, a pale wall and two soft lights."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    table = box("table", (200, 200, 1), (0, 60, -1.02), 0)
    paint(table, (0.42, 0.4, 0.37), roughness=0.55, noise=(0.05, 0.85, 0.0))
    wall = box("wall", (240, 1, 120), (0, 70, -1), 0)
    paint(wall, (0.5, 0.54, 0.57), roughness=0.9)
    for name, at, energy, size in (("key", (-16, -18, 26), 13000, 12), ("rim", (22, 10, 18), 6000, 8), ("fill", (6, -30, 10), 2500, 16)):
        light = bpy.data.lights.new(name, "AREA")
        light.energy, light.size = energy, size
        lamp = bpy.data.objects.new(name, light)
        lamp.location = at
        lamp.rotation_euler = _towards((-at[0], -at[1], 3 - at[2]))
        scene.collection.objects.link(lamp)
    scene.world = bpy.data.worlds.new("room")
    scene.world.use_nodes = True
    room = scene.world.node_tree.nodes["Background"]
    room.inputs["Color"].default_value, room.inputs["Strength"].default_value = (0.75, 0.8, 0.9, 1.0), 0.35


def _towards(direction) -> tuple[float, float, float]:
    from mathutils import Vector

    return tuple(Vector(direction).to_track_quat("-Z", "Y").to_euler())


def look_at(parts) -> None:
    """A camera from the front, above, that sees all of `parts`."""
    from mathutils import Vector

    scene = bpy.context.scene
    bpy.context.view_layer.update()
    corners = np.array([list(part.matrix_world @ Vector(corner)) for part in parts for corner in part.bound_box])
    low, high = corners.min(0), corners.max(0)
    middle, reach = (low + high) / 2, np.linalg.norm(high - low) / 2
    data = bpy.data.cameras.new("camera")
    data.lens, data.sensor_width, data.clip_end = 60.0, 36.0, 500.0
    camera = bpy.data.objects.new("camera", data)
    direction = np.array([0.25, -1.0, 0.62])
    direction /= np.linalg.norm(direction)
    camera.location = middle + direction * reach * 1.12 / math.sin(math.atan(18 / 60))
    camera.rotation_euler = _towards(middle - np.array(camera.location))
    scene.collection.objects.link(camera)
    scene.camera = camera


def settings(path: Path) -> None:
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    cycles.device, cycles.samples, cycles.use_denoising = "CPU", SAMPLES, True
    cycles.max_bounces, cycles.transmission_bounces, cycles.glossy_bounces, cycles.diffuse_bounces = 10, 10, 4, 3
    cycles.sample_clamp_indirect = 3.0
    render.resolution_x = render.resolution_y = SIZE
    render.image_settings.file_format, render.image_settings.quality = "JPEG", 92
    scene.view_settings.view_transform = "AgX"
    render.filepath, render.use_file_extension = str(path), False


def main(folder: Path, names: list[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for make in OBJECTS:
        if names and make.__name__ not in names:
            continue
        studio()
        look_at(make())
        settings(folder / f"{make.__name__}.jpg")
        bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(Path(given[0]).resolve(), given[1:])
