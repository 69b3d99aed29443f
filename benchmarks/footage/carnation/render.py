"""Renders a carnation that sways before a still curtain, with Cycles: DIR/frame_0000.png to frame_0030.png, masks.npz, truth.json.

python render.py DIR        with the `bpy` wheel

400x460, 31 frames at 30 a second, half of each exposed, and the grain of few samples left in. The foot of the stem is below the frame.
The flower bends as a beam that is clamped at its foot. The masks (true where it covers more than half) are those of every tenth frame.
"""

import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np

WIDTH, HEIGHT, FRAMES, FPS = 400, 460, 31, 30
SAMPLES = 4
EVERY = 10
LENGTH = 0.36
"""Length of the stem from the clamp to the head [m]."""
LENS, DISTANCE = 50.0, 0.62
"""Focal length of a sensor of 36 mm [mm], and metres from the camera to the flower."""
SWAY = 0.16
"""Rotation of the head [rad] at a value of 1."""


def made(name, points, faces, color, noise=0.0, rough=0.8):
    """An object of `points` and `faces` with a matt colour, mottled by `noise`."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(map(float, point)) for point in points], [], [tuple(map(int, face)) for face in faces])
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(thing)
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = rough
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    if noise:
        texture, ramp = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeValToRGB")
        place = nodes.new("ShaderNodeTexCoord")
        texture.inputs["Scale"].default_value, texture.inputs["Detail"].default_value = noise, 6.0
        ramp.color_ramp.elements[0].color = (*(0.45 * value for value in color), 1.0)
        ramp.color_ramp.elements[1].color = (*(min(1.0, 1.5 * value) for value in color), 1.0)
        ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.3, 0.7
        links.new(place.outputs["Object"], texture.inputs["Vector"])
        links.new(texture.outputs["Fac"], ramp.inputs["Fac"])
        links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    mesh.materials.append(material)
    return thing


def grid_faces(rows, columns):
    """Quads of a grid of points, row by row."""
    first = [row * columns + column for row in range(rows - 1) for column in range(columns - 1)]
    return [(at, at + 1, at + columns + 1, at + columns) for at in first]


def stem():
    """Points and faces of a tube round the z axis."""
    z, angle = np.linspace(0.0, LENGTH, 40), np.linspace(0.0, 2.0 * np.pi, 13)
    points = [(0.0035 * np.cos(a), 0.0035 * np.sin(a), at) for at in z for a in angle]
    return points, grid_faces(len(z), len(angle))


def leaf(side, at):
    """Points and faces of a narrow blade from the stem outwards."""
    along, across = np.linspace(0.0, 1.0, 14), np.linspace(-1.0, 1.0, 5)
    width = 0.009 * np.sin(np.pi * np.clip(along, 0.04, 0.98)) ** 0.7
    points = [
        (side * (0.003 + 0.07 * s), 0.01 * c * c - 0.006, at + 0.055 * s - 0.03 * s * s + w * c)
        for s, w in zip(along, width)
        for c in across
    ]
    return points, grid_faces(len(along), len(across))


def head(rng):
    """Points and faces of ruffled petals on a ball's upper part."""
    points, faces = [], []
    for ring, (count, tilt, size) in enumerate(((11, 1.2, 0.05), (10, 0.85, 0.052), (8, 0.5, 0.052), (5, 0.2, 0.05))):
        for k in range(count):
            turn = 2.0 * math.pi * (k + 0.37 * ring) / count + rng.uniform(-0.15, 0.15)
            out, up = np.array([math.cos(turn), math.sin(turn), 0.0]), np.array([0.0, 0.0, 1.0])
            side = np.cross(up, out)
            base, s, c = len(points), np.linspace(0.0, 1.0, 7), np.linspace(-1.0, 1.0, 11)
            for a in s:
                bend = tilt * (0.5 + 0.6 * a)
                for b in c:
                    ruffle = 0.004 * a * a * math.sin(9.0 * b + 5.0 * turn + ring)
                    reach = size * a * (1.0 - 0.12 * math.sin(4.0 * b) ** 2)
                    at = reach * (math.sin(bend) * out + math.cos(bend) * up) + 0.55 * size * (a**0.7) * b * side + ruffle * up
                    points.append(at + np.array([0.0, 0.0, LENGTH]))
            faces += [tuple(base + index for index in face) for face in grid_faces(len(s), len(c))]
    return points, faces


def bends(thing):
    """A shape key that bends `thing` as a clamped beam whose head turns by `SWAY`, animated."""
    thing.shape_key_add(name="Basis")
    key = thing.shape_key_add(name="Bent")
    for vertex in key.data:
        x, z = vertex.co.x, vertex.co.z
        s = min(max(z / LENGTH, 0.0), 1.0)
        slope = SWAY * s  # of the beam's axis; beyond its end the head goes on straight
        beyond = max(z - LENGTH, 0.0)
        vertex.co.x = x + 0.5 * SWAY * LENGTH * s * s + beyond * slope
        vertex.co.z = z - x * slope
    for t in range(-1, FRAMES + 1):
        key.value = value_at(t)
        key.slider_min, key.slider_max = -3.0, 3.0
        key.keyframe_insert("value", frame=t)


def value_at(t):
    """How far the flower is bent in frame `t`, 1 turning its head by `SWAY`."""
    return math.sin(2.0 * math.pi * t / 21.0) + 0.35 * math.sin(2.0 * math.pi * t / 8.3 + 1.0) - 0.29


def scene():
    """The flower, the curtain behind it and the lights; the curtain."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    rng = np.random.default_rng(3)
    bends(made("stem", *stem(), (0.1, 0.2, 0.06), 90.0))
    for side, at in ((-1, 0.15), (1, 0.11)):
        bends(made(f"leaf{side}", *leaf(side, at), (0.13, 0.26, 0.08), 60.0))
    bends(made("head", *head(rng), (0.72, 0.4, 0.36), 120.0))
    x, z = np.linspace(-0.5, 0.5, 241), np.linspace(-0.3, 0.8, 41)
    folds = 0.02 * np.sin(2 * np.pi * x / 0.055 + 1.3 * np.sin(9.0 * x))
    points = [(a, 0.18 + f * (1.0 - 0.2 * b), b) for b in z for a, f in zip(x, folds)]
    curtain = made("curtain", points, grid_faces(len(z), len(x)), (0.6, 0.42, 0.36), 45.0, 0.95)
    for name, place, size, power in (("key", (-0.5, -0.9, 0.9), 0.4, 14.0), ("fill", (0.8, -0.7, 0.4), 0.8, 5.0)):
        light = bpy.data.objects.new(name, bpy.data.lights.new(name, "AREA"))
        light.data.size, light.data.energy, light.location = size, power, place
        track = light.constraints.new("TRACK_TO")
        track.target, track.track_axis, track.up_axis = curtain, "TRACK_NEGATIVE_Z", "UP_Y"
        bpy.context.collection.objects.link(light)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    # The frame's lower edge cuts the stem 3 cm above the clamp.
    metres = HEIGHT / pixels_per_metre()
    camera.location, camera.rotation_euler = (0.0, -DISTANCE, 0.03 + 0.5 * metres), (0.5 * math.pi, 0.0, 0.0)
    camera.data.lens, camera.data.sensor_width, camera.data.sensor_fit = LENS, 36.0, "HORIZONTAL"
    bpy.context.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    return curtain


def pixels_per_metre():
    """Pixels per metre in the flower's plane."""
    return WIDTH * LENS / 36.0 / DISTANCE


def main(folder):
    """All frames, then the masks."""
    curtain = scene()
    made_by, render = bpy.context.scene, bpy.context.scene.render
    render.engine, made_by.cycles.samples, made_by.cycles.use_denoising = "CYCLES", SAMPLES, False
    made_by.cycles.max_bounces, made_by.cycles.use_animated_seed = 1, True
    render.resolution_x, render.resolution_y, render.resolution_percentage = WIDTH, HEIGHT, 100
    render.use_motion_blur, render.motion_blur_shutter, render.use_persistent_data = True, 0.5, True
    made_by.view_settings.view_transform = "Standard"
    render.image_settings.file_format = "PNG"

    def render_image(t, name, mode):
        render.image_settings.color_mode = mode
        made_by.frame_set(t)
        render.filepath = str(folder / name)
        bpy.ops.render.render(write_still=True)

    for t in range(FRAMES):
        render_image(t, f"frame_{t:04d}.png", "RGB")
    curtain.hide_render, render.film_transparent = True, True
    chosen, masks = list(range(0, FRAMES, EVERY)), []
    for t in chosen:
        render_image(t, "mask.png", "RGBA")
        image = bpy.data.images.load(str(folder / "mask.png"))
        masks.append(np.array(image.pixels[:], np.float32).reshape(HEIGHT, WIDTH, 4)[::-1, :, 3] > 0.5)
        bpy.data.images.remove(image)
    (folder / "mask.png").unlink()
    np.savez_compressed(folder / "masks.npz", frames=chosen, masks=np.stack(masks))
    truth = {"fps": FPS, "pixels_per_metre": pixels_per_metre(), "length": LENGTH, "sway": SWAY}
    (folder / "truth.json").write_text(json.dumps(truth))


if __name__ == "__main__":
    target = Path(sys.argv[-1]).resolve()
    target.mkdir(parents=True, exist_ok=True)
    main(target)
