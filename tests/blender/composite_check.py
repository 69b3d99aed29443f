"""Recover (with the stand-in for the engine), calibrate, export VDB, set up the composite and render a frame, in a real Blender.

    SEEING_WIND_PYTHON=.../fake_python SEEING_WIND_CLIP=.../clip.mp4 \\
        blender -b --factory-startup --python-exit-code 9 --python tests/blender/composite_check.py

`run.sh` sets both variables. Ends with exit code 9 when something is not as it should be.
"""

from __future__ import annotations

import dataclasses
import os
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seeing_wind import ui  # noqa: E402
from seeing_wind.engine.record_arrays import from_arrays, to_arrays  # noqa: E402
from seeing_wind.engine.records import Camera  # noqa: E402
from seeing_wind.engine.take import Take  # noqa: E402
from seeing_wind.ui.field.display import openvdb_available  # noqa: E402
from seeing_wind.ui.field.samples import read_samples, samples_of  # noqa: E402


def check(name: str, good: bool, figures: str = "") -> None:
    """One line; the end when it is not good."""
    print(("ok   " if good else "FAIL ") + name, figures, flush=True)
    if not good:
        raise SystemExit(9)


def check_vdb(scene: bpy.types.Scene, folder: Path) -> None:
    """What a file says at a place against the samples, with the field object moved, turned and doubled."""
    field = scene.seeing_wind.field_object
    field.location.x += 0.3
    field.rotation_euler = (0.0, 0.0, 0.6)
    field.field.strength *= 2.0
    bpy.context.view_layer.update()
    if not openvdb_available():
        print("-    this Blender has no OpenVDB for Python", flush=True)
        return
    import openvdb

    check("export", bpy.ops.seeing_wind.export_field(filepath=str(folder / "vdb")) == {"FINISHED"})
    files = sorted((folder / "vdb").glob("*.vdb"))
    check("one file per frame", len(files) == 12 and files[0].name == "wind_0002.vdb", str(len(files)))
    sampled = read_samples(samples_of(field))
    points, far = sampled.points, 1.0 - np.clip(sampled.distance[4] / (0.75 * np.ptp(sampled.points, axis=0).max()), 0.0, 1.0)
    force = sampled.force * (far**2 * (3.0 - 2.0 * far))[:, None]  # of what it leaves of this frame
    grids = {grid.name: grid for grid in openvdb.readAllGridMetadata(str(files[4]))}
    check("grids", set(grids) == {"force", "confidence"})
    said = {name: (str(grid.gridClass), grid["unit"]) for name, grid in grids.items()}
    check("class and unit", said == {"force": ("fog volume", "N/m3"), "confidence": ("fog volume", "1")}, str(said))
    grid = openvdb.read(str(files[4]), "force")
    turn = np.array(field.matrix_world)
    for number in (0, len(points) // 2 + 3, len(points) - 1):
        world = turn[:3, :3] @ points[number] + turn[:3, 3]
        index = [round(each) for each in grid.transform.worldToIndex(tuple(world))]
        want = 2.0 * turn[:3, :3] @ force[4][number]
        found = np.array(grid.getConstAccessor().getValue(tuple(index)))
        check(f"value {number}", np.allclose(found, want, rtol=1e-4, atol=1e-3 * np.abs(force).max()), f"{found} {want}")
    bpy.ops.object.volume_import(filepath=str(files[4]), directory=str(files[4].parent), files=[{"name": files[4].name}])
    bpy.context.object.data.grids.load()
    check("Blender reads it", {grid.name for grid in bpy.context.object.data.grids} == {"force", "confidence"})


def check_composite(scene: bpy.types.Scene, folder: Path) -> None:
    """The clip behind a glowing cube."""
    bpy.ops.mesh.primitive_cube_add(size=0.2, location=(-0.5, 0.0, -0.3))
    material = bpy.data.materials.new("Red")
    material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"].inputs
    surface["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    surface["Emission Color"].default_value, surface["Emission Strength"].default_value = (1.0, 0.0, 0.0, 1.0), 1.0
    bpy.context.object.data.materials.append(material)
    scene.frame_set(4)
    check("set up", bpy.ops.seeing_wind.set_up_composite(samples=1) == {"FINISHED"})
    check("render", bpy.ops.seeing_wind.render_composite(filepath=str(folder / "over.png"), still=True) == {"FINISHED"})
    image = read(folder / "over.png")
    check("the clip's ground", bool(np.abs(image[4:16, 60:90] - 60).max() < 14), str(image[8, 70]))
    check("the clip's square", bool(np.abs(image[28:36, 32:44] - 230).max() < 16), str(image[30, 36]))
    cube = image[44:56, 12:24].reshape(-1, 3).mean(0)
    check("the cube", bool(cube[0] > 150 and cube[0] > cube[1] + 80), str(cube))
    video = folder / "over.mp4"
    scene.frame_end = 3
    check("video", bpy.ops.seeing_wind.render_composite(filepath=str(video)) == {"FINISHED"} and video.stat().st_size > 500)


def check_conformed(scene: bpy.types.Scene, folder: Path) -> None:
    """At 30 frames a second the clip of 24 shows the clip frame at which the recovered object is, still and in a video."""
    scene.render.fps, scene.render.fps_base = 30, 1.0
    check("conform", bpy.ops.seeing_wind.conform() == {"FINISHED"})
    for frame, clip_frame in ((2, 1), (6, 4), (11, 8)):
        scene.frame_set(frame)
        bpy.ops.seeing_wind.render_composite(filepath=str(folder / "paced.png"), still=True)
        left = np.flatnonzero(read(folder / "paced.png")[30].mean(axis=1) > 145)[0]
        check(f"frame {clip_frame} at frame {frame}", abs(left - 20 - 2 * clip_frame) <= 1, str(left))
    check("a clip frame a frame", bpy.ops.seeing_wind.conform(real_time=False) == {"FINISHED"} and scene.active_clip.frame_start == 1)


def check_lens(scene: bpy.types.Scene, folder: Path) -> None:
    """The cube where a barrel lens would show it."""
    straight = red(read(folder / "over.png"))
    take = Take(folder / "out.take")
    arrays = take.read_arrays("observation.npz")
    camera = dataclasses.replace(from_arrays(Camera, arrays, "camera."), distortion=(-1.0, 0.2, 0.0, 0.0, 0.0))
    take.write_arrays("observation.npz", arrays | to_arrays(camera, "camera."))
    scene.frame_set(4)
    check("set up with a lens", bpy.ops.seeing_wind.set_up_composite(samples=4, shutter=0.0, grain=0.0) == {"FINISHED"})
    bpy.ops.seeing_wind.render_composite(filepath=str(folder / "bent.png"), still=True)
    found, want = red(read(folder / "bent.png")), camera.filmed(straight)
    check("bent", bool(np.abs(found - want).max() < 0.6 < np.abs(want - straight).max()), f"{straight} {found} {want}")


def check_hdri(scene: bpy.types.Scene, folder: Path) -> None:
    """A panorama lights, and the world that was there comes back."""
    image, world = bpy.data.images.new("panorama", 16, 8, float_buffer=True, is_data=True), scene.world
    image.filepath_raw, image.file_format = str(folder / "panorama.exr"), "OPEN_EXR"
    image.save()
    bpy.data.images.remove(image)
    check("set up with an HDRI", bpy.ops.seeing_wind.set_up_composite(samples=1, hdri=str(folder / "panorama.exr")) == {"FINISHED"})
    check("its world", scene.world != world and any(node.bl_idname == "ShaderNodeTexEnvironment" for node in scene.world.node_tree.nodes))
    check("and the former one", bpy.ops.seeing_wind.set_up_composite(samples=1, hdri="") == {"FINISHED"} and scene.world == world)


def read(path: Path) -> np.ndarray:
    """(64, 96, 3) in 0..255, row 0 at the top."""
    image = bpy.data.images.load(str(path))
    pixels = np.empty(4 * 64 * 96, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    return 255.0 * pixels.reshape(64, 96, 4)[::-1, :, :3]


def red(image: np.ndarray) -> np.ndarray:
    """(2,) column and row of what shines red."""
    shine = np.maximum(image[..., 0] - image[..., 1:].max(axis=2) - 60.0, 0.0)
    rows, columns = np.indices(shine.shape)
    return np.array([(shine * columns).sum(), (shine * rows).sum()]) / shine.sum()


def main() -> None:
    """In an empty file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    ui.register()
    ui.look_round()
    scene = bpy.context.scene
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        options = {"clip": os.environ["SEEING_WIND_CLIP"], "box": (20, 20, 44, 44), "distance": 2.0, "take": str(folder / "out.take")}
        check("recover", bpy.ops.seeing_wind.recover(**options) == {"FINISHED"})
        bpy.ops.mesh.primitive_grid_add(size=0.5)
        bpy.context.object.modifiers.new("Cloth", "CLOTH")
        check("calibrate", bpy.ops.seeing_wind.calibrate() == {"FINISHED"})
        check_composite(scene, folder)
        check_conformed(scene, folder)
        check_lens(scene, folder)
        check_hdri(scene, folder)
        check_vdb(scene, folder)
    ui.unregister()
    print("composite_check: all good in Blender", bpy.app.version_string)


if __name__ == "__main__":
    main()
