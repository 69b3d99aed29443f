"""Films a sheet of benchmarks/scenes/shell_scenes.py with Cycles: render.py SCENE.npz DIR [--frames N] [--side X Y Z]

With the `bpy` wheel. Printed cloth before a plain wall, 30 frames a second, a quarter of each exposed, and the grain of few samples
left in. DIR gets frame_0000.png and on, those that are not there yet, and of frame 0 camera.json, mask.png, depth.npy [m] and
held.png (what is fixed, painted by its vertices), with a copy of the scene as truth.npz.
"""

import argparse
import json
import math
import shutil
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

WIDTH, HEIGHT, FPS = 800, 450, 30
SAMPLES = 6
FOCAL = 1.25
"""Focal length in frame widths."""
MARGIN = 1.1
"""Size of the frame relative to all positions of the sheet."""
PRINT = 1024
"""Pixels of the print's longer side."""


def camera_for(x, side):
    """camera_to_world (4, 4) with OpenCV axes: from the side (3,), as near as all of x (T, V, 3) fits into the frame."""
    back = np.asarray(side, float) / np.linalg.norm(side)
    forward, up = -back, np.array([0.0, 0.0, 1.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward], axis=1)
    points = x.reshape(-1, 3)
    local = (points - points.mean(axis=0)) @ turn
    middle = 0.5 * (local.max(axis=0) + local.min(axis=0))
    half = np.abs(local[:, :2] - middle[:2]) * MARGIN
    away = max(
        float((half[:, 0] * FOCAL / 0.5 - local[:, 2]).max()), float((half[:, 1] * FOCAL * WIDTH / HEIGHT / 0.5 - local[:, 2]).max())
    )
    pose = np.eye(4)
    pose[:3, :3] = turn
    pose[:3, 3] = points.mean(axis=0) + turn @ np.array([middle[0], middle[1], -away])
    return pose


def printed(rng):
    """(PRINT, PRINT, 3) in 0..1: a print of blots of many sizes, dark on light, with stripes."""
    total = np.zeros((PRINT, PRINT))
    for size in (8, 16, 32, 64, 128):
        coarse = rng.normal(size=(size, size))
        at = np.linspace(0.0, size - 1.001, PRINT)
        low, share = at.astype(int), at % 1.0
        rows = coarse[low] * (1.0 - share)[:, None] + coarse[np.minimum(low + 1, size - 1)] * share[:, None]
        total += (rows[:, low] * (1.0 - share) + rows[:, np.minimum(low + 1, size - 1)] * share) / size**0.3
    blots = 1.0 / (1.0 + np.exp(-6.0 * (total - np.quantile(total, 0.55)) / total.std()))
    light, dark = np.array([0.85, 0.78, 0.6]), np.array([0.12, 0.2, 0.4])
    image = light + blots[..., None] * (dark - light)
    stripes = (np.arange(PRINT) // (PRINT // 12)) % 4 == 0
    image[stripes] = image[stripes] * 0.5 + 0.5 * np.array([0.7, 0.15, 0.12])
    return image


def shaded(thing, image=None, color=(0.5, 0.5, 0.5), scale=0.0):
    """A matt material from an image over the UV map, or a colour mottled at `scale` [1/m]."""
    material = bpy.data.materials.new(thing.name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.9
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    if image is not None:
        texture = nodes.new("ShaderNodeTexImage")
        texture.image = bpy.data.images.new("print", PRINT, PRINT)
        texture.image.pixels = np.dstack([image, np.ones((PRINT, PRINT))]).astype(np.float32).ravel()
        links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    elif scale:
        texture, ramp = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeValToRGB")
        texture.inputs["Scale"].default_value = scale
        ramp.color_ramp.elements[0].color = (*(0.6 * value for value in color), 1.0)
        ramp.color_ramp.elements[1].color = (*(min(1.0, 1.3 * value) for value in color), 1.0)
        place = nodes.new("ShaderNodeTexCoord")
        links.new(place.outputs["Object"], texture.inputs["Vector"])
        links.new(texture.outputs["Fac"], ramp.inputs["Fac"])
        links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    thing.data.materials.append(material)


def scene(x, faces, pose):
    """The sheet, which has a shape key a frame, a wall, lights and the camera; the sheet and the wall."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("sheet")
    mesh.from_pydata(x[0].tolist(), [], faces.tolist())
    mesh.polygons.foreach_set("use_smooth", [True] * len(faces))
    sheet = bpy.data.objects.new("sheet", mesh)
    bpy.context.collection.objects.link(sheet)
    centre = x[0] - x[0].mean(axis=0)
    flat = centre @ np.linalg.svd(centre, full_matrices=False)[2][:2].T
    flat = (flat - flat.min(axis=0)) / np.ptp(flat, axis=0).max()
    layer = mesh.uv_layers.new(name="print")
    corner = np.empty(len(mesh.loops), int)
    mesh.loops.foreach_get("vertex_index", corner)
    layer.data.foreach_set("uv", flat[corner].astype(np.float32).ravel())
    shaded(sheet, printed(np.random.default_rng(5)))
    sheet.shape_key_add(name="Basis")
    for t in range(len(x)):
        key = sheet.shape_key_add(name=f"{t}")
        key.data.foreach_set("co", x[t].astype(np.float32).ravel())
        for at, value in ((t - 1, 0.0), (t, 1.0), (t + 1, 0.0)):
            key.value = value
            key.keyframe_insert("value", frame=at)
    for curve in curves_of(sheet.data.shape_keys):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    blender = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
    wall = bpy.data.meshes.new("wall")
    depth = float(((x.reshape(-1, 3) - pose[:3, 3]) @ pose[:3, 2]).max()) + 1.0
    far = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]) * np.array([2.0 * depth, 2.0 * depth, depth])
    wall.from_pydata((far @ pose[:3, :3].T + pose[:3, 3]).tolist(), [], [(0, 1, 2, 3)])
    behind = bpy.data.objects.new("wall", wall)
    bpy.context.collection.objects.link(behind)
    shaded(behind, color=(0.35, 0.36, 0.33), scale=1.2)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.data.angle = 2.5, 0.05
    sun.rotation_euler = (math.radians(50.0), 0.0, math.radians(-30.0))
    bpy.context.collection.objects.link(sun)
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (0.7, 0.8, 1.0, 1.0)
    world.node_tree.nodes["Background"].inputs[1].default_value = 0.7
    bpy.context.scene.world = world
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.matrix_world = Matrix(blender.tolist())
    camera.data.sensor_width, camera.data.lens, camera.data.sensor_fit = 36.0, 36.0 * FOCAL, "HORIZONTAL"
    camera.data.clip_end = 100.0
    bpy.context.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    return sheet, behind


def curves_of(data):
    """The F-curves of what is animated, in Blender's old layout and in its new one."""
    action = data.animation_data.action
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    return [curve for layer in action.layers for strip in layer.strips for bag in strip.channelbags for curve in bag.fcurves]


def depth_and_held(x, faces, pose, fixed):
    """Depth (H, W) [m] of frame 0, infinite off the sheet, and (H, W) bool, what is held: by rays through the pixels' centres."""
    focal = FOCAL * WIDTH
    local = (x[0] - pose[:3, 3]) @ pose[:3, :3]
    xy = focal * local[:, :2] / local[:, 2:] + [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]
    depth, held = np.full((HEIGHT, WIDTH), np.inf), np.zeros((HEIGHT, WIDTH), bool)
    for face in faces:
        corners, far = xy[face], local[face, 2]
        low = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(corners.max(axis=0)).astype(int), [WIDTH - 1, HEIGHT - 1])
        if (high < low).any():
            continue
        at = np.stack(np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1)), axis=-1)
        sides = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=1)
        if abs(np.linalg.det(sides)) < 1e-9:
            continue
        share = (at - corners[0]) @ np.linalg.inv(sides).T
        share = np.concatenate([1.0 - share.sum(axis=-1, keepdims=True), share], axis=-1)
        inside = (share >= -1e-9).all(axis=-1)
        value = 1.0 / (share @ (1.0 / far))
        rows, columns = at[..., 1][inside], at[..., 0][inside]
        nearer = value[inside] < depth[rows, columns]
        depth[rows[nearer], columns[nearer]] = value[inside][nearer]
    edge = float(np.median(np.linalg.norm(xy[faces[:, 0]] - xy[faces[:, 1]], axis=1)))
    rows, columns = np.nonzero(np.isfinite(depth))
    for place in xy[fixed]:
        near = np.hypot(columns - place[0], rows - place[1]) < 0.5 * edge
        held[rows[near], columns[near]] = True
    return depth, held


def main():
    """All frames, then what is known of frame 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path, metavar="SCENE.npz")
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--frames", type=int, default=91, help="frames")
    parser.add_argument("--side", type=float, nargs=3, default=(-0.5, -0.8, 0.15), help="where the camera is, seen from the sheet")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with np.load(options.truth, allow_pickle=False) as data:
        moves, faces, fixed = data["x"][: options.frames + 1].astype(float), data["faces"], data["fixed"].astype(bool)
    x = moves[: options.frames]
    pose = camera_for(x, options.side)
    depth, held = depth_and_held(x, faces, pose, fixed)
    np.save(options.folder / "depth.npy", depth)
    for name, mask in (("mask", np.isfinite(depth)), ("held", held)):
        image = bpy.data.images.new(name, WIDTH, HEIGHT)
        image.pixels = np.repeat(mask[::-1, :, None].astype(np.float32), 4, axis=2).ravel()
        image.filepath_raw, image.file_format = str(options.folder / f"{name}.png"), "PNG"
        image.save()
    focal = FOCAL * WIDTH
    camera = {"width": WIDTH, "height": HEIGHT, "fx": focal, "fy": focal, "cx": (WIDTH - 1) / 2, "cy": (HEIGHT - 1) / 2}
    (options.folder / "camera.json").write_text(json.dumps(camera | {"camera_to_world": pose.tolist()}))
    shutil.copy(options.truth, options.folder / "truth.npz")
    scene(moves, faces, pose)  # one frame more: the last one's blur goes on into it
    made_by, render = bpy.context.scene, bpy.context.scene.render
    render.engine, made_by.cycles.samples, made_by.cycles.use_denoising = "CYCLES", SAMPLES, False
    made_by.cycles.max_bounces, made_by.cycles.use_animated_seed = 1, True
    render.resolution_x, render.resolution_y, render.resolution_percentage = WIDTH, HEIGHT, 100
    render.use_motion_blur, render.motion_blur_shutter, render.use_persistent_data = True, 0.25, True
    made_by.view_settings.view_transform = "Standard"
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    for t in range(len(x)):
        path = options.folder / f"frame_{t:04d}.png"
        if not path.exists():  # of a run that was interrupted
            made_by.frame_set(t)
            render.filepath = str(path)
            bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()
