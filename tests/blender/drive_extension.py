"""Drives the installed extension in a real Blender: `blender -b --python-exit-code 9 --python drive_extension.py`.

run.sh prepares SEEING_WIND_PYTHON (a stand-in for the engine with known results) and SEEING_WIND_CLIP. Any failure is an exception, hence
exit code 9: Blender's own install command returns 0 even when it failed.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import bpy
import numpy as np

MODULE = "bl_ext.user_default.seeing_wind"


def check(condition: bool, what: str) -> None:
    """An assertion that no optimisation switches off."""
    if not condition:
        raise AssertionError(what)
    print(f"ok  {what}", flush=True)


def world_vertices(obj: bpy.types.Object, frame: int) -> np.ndarray:
    """Where the vertices are at a frame, (V, 3)."""
    bpy.context.scene.frame_set(frame)
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return np.array([obj.matrix_world @ vertex.co for vertex in mesh.vertices])


def motion_by_point_cache(cube: bpy.types.Object) -> np.ndarray:
    """The last frame (V, 3) after a bake to PC2; the object is left with its shape keys."""
    bpy.ops.seeing_wind.bake(object=cube.name, way="POINT_CACHE")
    check(cube.data.shape_keys is None and cube.modifiers[0].type == "MESH_CACHE", "bake to a point cache")
    last = world_vertices(cube, 13)
    bpy.ops.seeing_wind.bake(object=cube.name, way="SHAPE_KEYS")
    check(cube.data.shape_keys is not None and not cube.modifiers, "and back to shape keys")
    return last


def main() -> None:
    """From a clip to keyframes, and every way to fail that the stand-in knows."""
    folder = Path(os.environ["SEEING_WIND_CLIP"]).parent / "drive"
    check(MODULE in bpy.context.preferences.addons, "the extension is enabled")
    check(not {"torch", "taichi", "quadrants", "cv2"} & set(sys.modules), "nothing heavy is loaded")
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    options = {"clip": os.environ["SEEING_WIND_CLIP"], "box": (20, 20, 44, 44), "distance": 2.0, "take": str(folder / "out.take")}
    for behaviour, says in (("error", "outside the frame"), ("die", "SIGKILL")):
        os.environ["SEEING_WIND_FAKE"] = behaviour
        try:
            bpy.ops.seeing_wind.recover(**options)
            raise AssertionError(f"{behaviour} went unnoticed")
        except RuntimeError as error:
            check(says in str(error), f"a worker that ends by '{behaviour}' is told")
    os.environ["SEEING_WIND_FAKE"] = "done"
    check(bpy.ops.seeing_wind.choose_clip(filepath=options["clip"]) == {"FINISHED"}, "choose a clip")
    check(scene.camera.data.background_images[0].clip == scene.active_clip, "it is seen behind the scene")
    check(bpy.ops.seeing_wind.recover(**options) == {"FINISHED"}, "recover")
    settings = scene.seeing_wind
    check(settings.field_object.field.type == "TEXTURE" and settings.field_object.field.shape == "POINTS", "the field object")
    check(settings.arrows_object is not None and scene.camera is settings.camera_object, "arrows and camera")
    drift = world_vertices(settings.recovered_object, 13) - world_vertices(settings.recovered_object, 1)
    check(np.allclose(drift, [0.24, 0.0, 0.12], atol=1e-5), "the recovered object follows its trajectory")
    bpy.ops.mesh.primitive_cube_add(size=0.2)
    cube = bpy.context.object
    cube.vertex_groups.new(name="Held").add([0, 1], 1.0, "REPLACE")
    bpy.ops.seeing_wind.insert_mesh(mass_scale=2.0)
    bpy.ops.seeing_wind.pin_vertices()
    check(bpy.ops.seeing_wind.resimulate() == {"FINISHED"} and bpy.ops.seeing_wind.bake() == {"FINISHED"}, "re-simulate and bake")
    moved = (world_vertices(cube, 13) - world_vertices(cube, 1))[:, 2]
    check(np.allclose(moved, [0.0, 0.0] + [-0.5 * 3.0 * 0.25 / 2.0] * 6, atol=1e-5), "keyframes: pinned vertices stay, the others fall")
    check(np.allclose(world_vertices(cube, 13), motion_by_point_cache(cube), atol=1e-5), "a point cache plays the same motion")
    bpy.ops.seeing_wind.duplicate_edit()
    bpy.ops.seeing_wind.insert_collider(object=cube.name)
    bpy.ops.seeing_wind.scale_stiffness(factor=2.0)
    check(settings.active_edit == 1 and settings.bodies[0].object != cube, "a second edit beside the first")
    settings.active_edit = 0
    check(settings.bodies[0].object == cube and not len(settings.colliders), "and back to the first")
    saved = str(folder / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=saved)
    bpy.ops.wm.open_mainfile(filepath=saved)
    check(bpy.context.scene.seeing_wind.field_object is not None, "results survive save and load")
    bpy.ops.preferences.addon_disable(module=MODULE)
    check(not hasattr(bpy.types.Scene, "seeing_wind"), "it can be switched off")
    bpy.ops.preferences.addon_enable(module=MODULE)
    check(hasattr(bpy.context.scene, "seeing_wind"), "and on again")


main()
