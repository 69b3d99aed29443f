"""Renders a sample scene's clip with Cycles. Runs inside Blender or any Python that has the `bpy` wheel; needs bpy and NumPy only.

    blender -b --factory-startup --python render.py -- DIR         or         python render.py DIR

DIR holds what make.py wrote: scene.npz (vertices (T+1,V,3) m, triangles, uv, fps, samples; perhaps stand_vertices,
stand_triangles and stand_colour of what stands still beside it), camera.json, texture.png, and backdrop.png of meadow.py.
The result is DIR/clip.mp4.
"""

import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np

SUN = (math.radians(48.0), math.radians(-12.0), math.radians(-38.0))
"""Euler angles of the sun: high, over the camera's left shoulder."""
BACKDROP_DEPTH, BEYOND = 9.0, 1.05
"""Metres from the camera to the backdrop, and its size over that of the view."""


def main(folder: Path) -> None:
    """Build the scene from the files of `folder` and render it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with np.load(folder / "scene.npz", allow_pickle=False) as data:
        scene_data = {key: data[key] for key in data.files}
    camera = json.loads((folder / "camera.json").read_text())
    scene = bpy.context.scene
    place_camera(scene, camera)
    body = animated_mesh("body", scene_data["vertices"], scene_data["triangles"], scene_data["uv"])
    body.data.materials.append(textured_material(folder / "texture.png"))
    if "stand_vertices" in scene_data:
        stand = animated_mesh("stand", scene_data["stand_vertices"][None], scene_data["stand_triangles"])
        stand.data.materials.append(plain_material("stand", scene_data["stand_colour"]))
    hang_backdrop(scene.camera, camera, image_material("backdrop", bpy.data.images.load(str(folder / "backdrop.png"))))
    light(scene)
    settings(scene, camera, len(scene_data["vertices"]), float(scene_data["fps"]), int(scene_data["samples"]))
    video_output(scene, folder / "clip.mp4")
    bpy.ops.render.render(animation=True)


def place_camera(scene, camera: dict):
    """An OpenCV pinhole camera (x right, y down, z forward) as Blender's (y up, looking along -z), which it becomes the scene's."""
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens = camera["fx"] * 36.0 / camera["width"]
    data.shift_x = ((camera["width"] - 1) / 2 - camera["cx"]) / camera["width"]
    data.shift_y = (camera["cy"] - (camera["height"] - 1) / 2) / camera["width"]
    held = bpy.data.objects.new("camera", data)
    pose = np.array(camera["camera_to_world"], dtype=float)
    held.matrix_world = (pose @ np.diag([1.0, -1.0, -1.0, 1.0])).T.tolist()
    scene.collection.objects.link(held)
    scene.camera = held
    return held


def animated_mesh(name: str, vertices: np.ndarray, triangles: np.ndarray, uv: np.ndarray | None = None):
    """A mesh that passes through vertices (T+1, V, 3), frame t at frame t + 1, by absolute shape keys."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices[0].tolist(), [], triangles.tolist())
    mesh.shade_smooth()
    if uv is not None:
        layer = mesh.uv_layers.new(name="UVMap")
        corner = np.empty(len(mesh.loops), dtype=np.int32)
        mesh.loops.foreach_get("vertex_index", corner)
        layer.data.foreach_set("uv", uv[corner].astype(np.float32).ravel())
    body = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(body)
    if len(vertices) == 1:
        return body
    for t, shape in enumerate(vertices):
        body.shape_key_add(name=f"frame {t + 1}", from_mix=False).data.foreach_set("co", shape.astype(np.float32).ravel())
    keys = mesh.shape_keys
    keys.use_relative = False
    blocks = keys.key_blocks
    for block in blocks:
        block.interpolation = "KEY_LINEAR"
    for t in (0, len(vertices) - 1):
        keys.eval_time = blocks[t].frame
        keys.keyframe_insert("eval_time", frame=t + 1)
    for curve in curves_of(keys.animation_data.action):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    return body


def curves_of(action) -> list:
    """All curves of an action: `fcurves` up to Blender 4.x, layers, strips and channel bags from 5.0."""
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    return [curve for layer in action.layers for strip in layer.strips for bag in strip.channelbags for curve in bag.fcurves]


def textured_material(texture: Path):
    """Waxy, slightly translucent, with the veins standing out."""
    material, nodes, links, out = _blank("texture")
    image = nodes.new("ShaderNodeTexImage")
    image.image = bpy.data.images.load(str(texture))
    image.interpolation = "Cubic"
    surface = nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Roughness"].default_value = 0.62
    surface.inputs["Specular IOR Level"].default_value = 0.25
    bump = nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value = 0.25
    bump.inputs["Distance"].default_value = 0.004
    links.new(image.outputs["Color"], bump.inputs["Height"])
    links.new(bump.outputs["Normal"], surface.inputs["Normal"])
    links.new(image.outputs["Color"], surface.inputs["Base Color"])
    links.new(surface.outputs["BSDF"], out.inputs["Surface"])
    return material


def plain_material(name: str, colour):
    """Matt, one colour (linear)."""
    material, nodes, links, out = _blank(name)
    surface = nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Base Color"].default_value = (*(float(c) for c in colour), 1.0)
    surface.inputs["Roughness"].default_value = 0.8
    links.new(surface.outputs["BSDF"], out.inputs["Surface"])
    return material


def image_material(name: str, image):
    """A frame that shines by itself, so that its colours come through unchanged."""
    material, nodes, links, out = _blank(name)
    texture, shine = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeEmission")
    texture.image, texture.extension = image, "EXTEND"
    links.new(texture.outputs["Color"], shine.inputs["Color"])
    links.new(shine.outputs["Emission"], out.inputs["Surface"])
    return material


def _blank(name: str):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    return material, nodes, material.node_tree.links, nodes.new("ShaderNodeOutputMaterial")


def hang_backdrop(held, camera: dict, material) -> None:
    """A plane that fills the camera's view and some more, which the pixels on the border see too, with the frame exactly in the view. It is
    seen by the camera only: it neither lights nor shades anything."""
    right, up = (BEYOND * BACKDROP_DEPTH * camera[side] / camera[focal] / 2 for side, focal in (("width", "fx"), ("height", "fy")))
    low, high = 0.5 - 0.5 * BEYOND, 0.5 + 0.5 * BEYOND
    mesh = bpy.data.meshes.new("backdrop")
    mesh.from_pydata([(-right, -up, 0), (right, -up, 0), (right, up, 0), (-right, up, 0)], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", [low, low, high, low, high, high, low, high])
    mesh.materials.append(material)
    plane = bpy.data.objects.new("backdrop", mesh)
    plane.parent, plane.location = held, (0.0, 0.0, -BACKDROP_DEPTH)
    for ray in ("diffuse", "glossy", "transmission", "shadow", "volume_scatter"):
        setattr(plane, f"visible_{ray}", False)
    bpy.context.scene.collection.objects.link(plane)


def add_sun(scene, strength: float, degrees: float, colour: tuple[float, float, float]) -> None:
    """Of so many W/m², and so wide."""
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle, sun.color = strength, math.radians(degrees), colour
    lamp = bpy.data.objects.new("sun", sun)
    lamp.rotation_euler = SUN
    scene.collection.objects.link(lamp)


def light(scene) -> None:
    """A warm sun and a pale blue sky."""
    add_sun(scene, 2.6, 2.0, (1.0, 0.94, 0.84))
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    sky = scene.world.node_tree.nodes.get("Background")
    sky.inputs["Color"].default_value, sky.inputs["Strength"].default_value = (0.66, 0.78, 1.0, 1.0), 0.55


def settings(scene, camera: dict, frames: int, fps: float, samples: int) -> None:
    """Cycles on the CPU with few samples and bounces: the leaf is matt and the backdrop shines by itself, so little noise is left."""
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    cycles.device, cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = "CPU", samples, False, False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces, cycles.transmission_bounces = 1, 1, 0, 0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    render.use_persistent_data, render.use_motion_blur = True, False
    render.resolution_x, render.resolution_y, render.resolution_percentage = camera["width"], camera["height"], 100
    render.fps, render.fps_base = round(fps), round(fps) / fps
    scene.frame_start, scene.frame_end = 1, frames
    scene.view_settings.view_transform = "Standard"


def video_output(scene, path: Path) -> None:
    """H.264 in MP4, nearly lossless."""
    image = scene.render.image_settings
    if hasattr(image, "media_type"):  # from Blender 5.0
        image.media_type = "VIDEO"
    image.file_format = "FFMPEG"
    ffmpeg = scene.render.ffmpeg
    ffmpeg.format, ffmpeg.codec = "MPEG4", "H264"
    ffmpeg.constant_rate_factor, ffmpeg.ffmpeg_preset, ffmpeg.gopsize = "PERC_LOSSLESS", "GOOD", 12
    ffmpeg.audio_codec = "NONE"
    scene.render.filepath, scene.render.use_file_extension = str(path), False


if __name__ == "__main__":
    main(Path((sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])[0]).resolve())
