"""Meshes and materials of the rendered objects. Needs bpy (Blender, or its Python module) and NumPy only. Lengths in centimetres."""

from __future__ import annotations

import math

import bpy
import numpy as np


def mesh(name: str, vertices, faces, smooth: bool = True):
    """A linked object of the given vertices and faces."""
    data = bpy.data.meshes.new(name)
    data.from_pydata([tuple(map(float, v)) for v in vertices], [], [tuple(map(int, f)) for f in faces])
    data.validate()
    if smooth:
        data.shade_smooth()
        data.set_sharp_from_angle(angle=0.6)
    body = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(body)
    return body


def lathe(name: str, profile, sides: int = 96):
    """A profile of (radius, height) turned round the z axis; radius 0 closes it."""
    profile = np.asarray(profile, dtype=float)
    angle = np.arange(sides) * 2 * math.pi / sides
    rings = np.stack([np.outer(profile[:, 0], np.cos(angle)), np.outer(profile[:, 0], np.sin(angle))], -1)
    height = np.repeat(profile[:, 1:], sides, axis=1)[..., None]
    vertices = np.concatenate([rings, height], -1).reshape(-1, 3)
    faces = [
        (i * sides + j, i * sides + (j + 1) % sides, (i + 1) * sides + (j + 1) % sides, (i + 1) * sides + j)
        for i in range(len(profile) - 1)
        for j in range(sides)
    ]
    body = mesh(name, vertices, faces)
    weld = body.modifiers.new("weld", "WELD")
    weld.merge_threshold = 1e-4
    return body


def curve_profile(points):
    """A smooth profile (Catmull-Rom) through (radius, height) points."""
    p = np.asarray(points, dtype=float)
    p = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    out = []
    for k in range(1, len(p) - 2):
        for s in np.linspace(0, 1, 60 // (len(p) - 3) + 1, endpoint=False):
            a, b, c, d = p[k - 1 : k + 3]
            out.append(0.5 * (2 * b + (c - a) * s + (2 * a - 5 * b + 4 * c - d) * s**2 + (3 * b - a - 3 * c + d) * s**3))
    out = np.array([*out, p[-2]])
    out[:, 0] = np.maximum(out[:, 0], 0.0)
    return out


def box(name: str, size, at=(0, 0, 0), bevel: float = 0.15):
    """A box with rounded edges, standing at `at` (its base's middle)."""
    x, y, z = np.asarray(size, dtype=float) / 2
    corners = [(sx * x, sy * y, sz * z) for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    body = mesh(name, corners, faces, smooth=False)
    body.location = (at[0], at[1], at[2] + z)
    if bevel:
        rounded = body.modifiers.new("bevel", "BEVEL")
        rounded.width, rounded.segments = bevel, 4
    return body


def wire(name: str, points, radius: float):
    """A round wire through points."""
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions, data.bevel_depth, data.bevel_resolution = "3D", radius, 8
    spline = data.splines.new("POLY")
    spline.points.add(len(points) - 1)
    spline.points.foreach_set("co", np.column_stack([points, np.ones(len(points))]).astype(np.float32).ravel())
    spline.use_smooth = True
    body = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(body)
    return body


def ring(radius: float, at, tilt=(0.0, 0.0), wobble: float = 0.0, seed: int = 0) -> np.ndarray:
    """Points of a circle, tilted about x and y, a little out of round."""
    angle = np.linspace(0, 2 * math.pi, 160, endpoint=False)
    phase = np.random.default_rng(seed).uniform(0, 6.28, 3)
    r = radius * (1 + wobble * (np.sin(2 * angle + phase[0]) + 0.5 * np.sin(3 * angle + phase[1])))
    points = np.stack([r * np.cos(angle), r * np.sin(angle), wobble * radius * np.sin(2 * angle + phase[2])], 1)
    a, b = tilt
    rx = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    ry = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    return points @ (ry @ rx).T + np.asarray(at, dtype=float)


def dented_ball(name: str, radius: float, dents):
    """A ball rolled by hand: flattened, uneven, pressed in at `dents` (unit directions)."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64, radius=1.0)
    body = bpy.context.object
    body.name = name
    co = np.empty(3 * len(body.data.vertices), np.float32)
    body.data.vertices.foreach_get("co", co)
    unit = co.reshape(-1, 3).astype(float)
    rng = np.random.default_rng(3)
    r = np.ones(len(unit))
    for _ in range(24):
        k, phase = rng.normal(0, 2.2, 3), rng.uniform(0, 6.28)
        r += 0.04 * np.sin(unit @ k + phase) / 4
    for dent in dents:
        dent = np.asarray(dent, dtype=float) / np.linalg.norm(dent)
        off = np.linalg.norm(unit - dent, axis=1)
        r -= 0.16 * np.exp(-((off / 0.28) ** 2))
    shaped = radius * unit * r[:, None] * [1.05, 1.0, 0.86]
    shaped[:, 2] -= shaped[:, 2].min()
    body.data.vertices.foreach_set("co", shaped.astype(np.float32).ravel())
    body.data.shade_smooth()
    return body


def paint(body, color, **principled):
    """A Principled material; keys are its inputs with underscores. `noise` (scale, dark, bump) gives it a pattern, `grain` one along x."""
    noise, grain = principled.pop("noise", None), principled.pop("grain", None)
    material = bpy.data.materials.new(body.name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*color, 1.0)
    for key, value in principled.items():
        surface.inputs[key.replace("_", " ").title().replace("Ior", "IOR")].default_value = value
    if noise or grain:
        place = nodes.new("ShaderNodeTexCoord")
        texture = nodes.new("ShaderNodeTexNoise")
        scale, dark, bump = grain or noise
        texture.inputs["Scale"].default_value = scale
        texture.inputs["Detail"].default_value = 8.0
        stretch = nodes.new("ShaderNodeMapping")
        if grain:
            stretch.inputs["Scale"].default_value = (0.06, 1.0, 1.0)
        links.new(place.outputs["Object"], stretch.inputs["Vector"])
        links.new(stretch.outputs["Vector"], texture.inputs["Vector"])
        ramp = nodes.new("ShaderNodeValToRGB")
        ramp.color_ramp.elements[0].color = (*(np.array(color) * dark), 1.0)
        ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.3, 0.65
        ramp.color_ramp.elements[1].color = (*color, 1.0)
        height = texture.outputs["Fac"] if "Fac" in texture.outputs else texture.outputs["Factor"]
        links.new(height, ramp.inputs["Fac"])
        links.new(ramp.outputs["Color"], surface.inputs["Base Color"])
        if bump:
            relief = nodes.new("ShaderNodeBump")
            relief.inputs["Strength"].default_value, relief.inputs["Distance"].default_value = bump, 0.1
            links.new(height, relief.inputs["Height"])
            links.new(relief.outputs["Normal"], surface.inputs["Normal"])
    body.data.materials.clear()
    body.data.materials.append(material)
    return body
