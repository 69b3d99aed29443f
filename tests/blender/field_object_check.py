"""Field object, arrows, bake, export and clip scene in a real Blender; the tests in tests/ui use the same functions.

    blender -b --factory-startup --python-exit-code 9 --python tests/blender/field_object_check.py

Ends with exit code 9 when something is not as it should be.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Vector

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seeing_wind.ui.bake.motion import bake_shape_keys, clear_bake  # noqa: E402
from seeing_wind.ui.bake.shapes import evaluation_time_curves  # noqa: E402
from seeing_wind.ui.clip.clip_scene import setup_clip_scene  # noqa: E402
from seeing_wind.ui.edit.resimulate.edit_files import export_mesh  # noqa: E402
from seeing_wind.ui.field.arrows import create_arrows  # noqa: E402
from seeing_wind.ui.field.field_object import create_field_object  # noqa: E402
from seeing_wind.ui.field.lattice import SampledField, fine_lattice, lattice  # noqa: E402
from seeing_wind.ui.field.solvers.particles import calibrate_particles  # noqa: E402
from seeing_wind.ui.scene_mesh import pinned_vertices  # noqa: E402

FPS = 24.0
DENSITY = 120.0
FRAME_START = 5
FRAMES = 6
HALF_SIZE = 0.5
CENTRE = np.array([0.2, -0.1, 0.6])
BOX = np.array([CENTRE - HALF_SIZE, CENTRE + HALF_SIZE])


def swirl(points: np.ndarray, frame: float) -> np.ndarray:
    """A swirl round Z with a wavy updraught, nowhere zero, turning and growing with time: (P, 3) [N/m³]."""
    x, y, z = ((points - CENTRE) / HALF_SIZE).T
    flow = np.stack([-y + 0.3 * np.sin(2.0 * z + frame), x + 0.2 * z**2, 1.0 + 0.3 * np.sin(2.0 * x + y - frame)], axis=-1)
    return 40.0 * (1.0 + 0.5 * frame) * flow


def swirl_field(scene: bpy.types.Scene, reach: str = "CONTINUE") -> bpy.types.Object:
    """The field object of the swirl, from values where Recover asks for them."""
    nodes = fine_lattice(BOX)
    values = np.stack([swirl(nodes, frame) for frame in range(FRAMES)])
    return create_field_object(
        scene,
        "Wind",
        SampledField(nodes, values, np.ones(values.shape[:2])),
        fps=FPS,
        density=DENSITY,
        frame_start=FRAME_START,
        reach=reach,
        take="/clips/a.take",
    )


def released_accelerations(scene: bpy.types.Scene, field: bpy.types.Object, points: np.ndarray, frame: int, mass: float = 0.3, **options):
    """Release native particles at rest at `points` in scene frame `frame`; their positions then and next accelerations [m/s²]."""
    mesh = bpy.data.meshes.new("Emitter")
    mesh.from_pydata(points.tolist(), [], [])
    emitter = bpy.data.objects.new("Emitter", mesh)
    scene.collection.objects.link(emitter)
    system = emitter.modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system
    settings = system.settings
    settings.count, settings.emit_from, settings.use_emit_random = len(points), "VERT", False
    settings.normal_factor, settings.lifetime = 0.0, 100.0
    settings.frame_start = settings.frame_end = frame
    settings.effector_weights.gravity = 0.0
    calibrate_particles(settings, field, mass=mass, **options)
    states = []
    for now in range(1, frame + 2):
        scene.frame_set(now)
        if now >= frame:
            particles = emitter.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0].particles
            states.append([np.array([getattr(p, name)[:] for p in particles]) for name in ("location", "velocity")])
    bpy.data.objects.remove(emitter)
    (before, slow), (_, fast) = states
    return before, (fast - slow) * FPS


def worst_errors(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Largest angle [degrees] and relative difference of magnitude between rows of two (P, 3)."""
    size_found, size_truth = np.linalg.norm(found, axis=1), np.linalg.norm(truth, axis=1)
    cosine = (found * truth).sum(axis=1) / (size_found * size_truth)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max()), float(np.abs(size_found / size_truth - 1.0).max())


def field_errors(scene: bpy.types.Scene, field: bpy.types.Object, interval: int, count: int = 200, **options) -> tuple[float, float]:
    """Worst errors of native particles against f / rho during a frame interval of the clip, wherever the field now stands."""
    bpy.context.view_layer.update()
    moved, rest = np.array(field.matrix_world), CENTRE
    points = np.random.default_rng(interval).uniform(*BOX, (count, 3))
    released = (points - rest) @ moved[:3, :3].T + moved[:3, 3]
    places, found = released_accelerations(scene, field, released, FRAME_START + interval, **options)
    at_home = (places - moved[:3, 3]) @ moved[:3, :3] + rest
    return worst_errors(found, swirl(at_home, interval) / options.get("density", DENSITY) @ moved[:3, :3].T)


def _check(name: str, good: bool, figures: str = "") -> None:
    print(("ok   " if good else "FAIL ") + name, figures, flush=True)
    if not good:
        raise SystemExit(9)


def _check_field(scene: bpy.types.Scene) -> None:
    field = swirl_field(scene)
    for place in ("made", "moved and turned", "saved and loaded"):
        if place == "moved and turned":
            field.location += Vector((0.4, 1.0, -0.3))
            field.rotation_euler = Euler((0.5, -0.7, 1.1))
        elif place == "saved and loaded":
            with tempfile.TemporaryDirectory() as folder:
                path = str(Path(folder) / "field.blend")
                bpy.ops.wm.save_as_mainfile(filepath=path)
                bpy.ops.wm.open_mainfile(filepath=path)
            scene = bpy.context.scene
            field = scene.objects["Wind"]
        for interval in (0, 3):
            angle, size = field_errors(scene, field, interval)
            _check(
                f"native particles, field {place}, interval {interval}",
                angle < 1.0 and size < 0.02,
                f"{angle:.2f} degrees, {100 * size:.2f} %",
            )


def _check_arrows(scene: bpy.types.Scene) -> None:
    points = lattice(BOX, 4)
    vectors = np.stack([swirl(points, frame) for frame in range(FRAMES)])
    arrows = create_arrows(scene, "Arrows", points, vectors, frame_start=FRAME_START)
    sizes = []
    for frame in (FRAME_START, FRAME_START + FRAMES - 1, FRAME_START + 20):
        scene.frame_set(frame)
        mesh = arrows.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        sizes.append((len(mesh.vertices), "strength" in mesh.attributes))
    _check("arrows on every point of every frame", len(set(sizes)) == 1 and sizes[0][0] >= 20 * len(points) and sizes[0][1], str(sizes))


def _check_bake(scene: bpy.types.Scene) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4)
    grid = bpy.context.object
    grid.location = (1.0, 2.0, 3.0)
    with tempfile.TemporaryDirectory() as folder:
        exported = export_mesh(grid, bpy.context.evaluated_depsgraph_get(), Path(folder) / "grid.npz")
        rest = np.load(exported)["vertices"]
        grid.vertex_groups.new(name="Pin").add([0, 7], 1.0, "REPLACE")
        pins, _ = pinned_vertices(grid, bpy.context.evaluated_depsgraph_get(), "Pin")
    _check("pinned vertices", pins.tolist() == [0, 7], str(pins))
    motion = rest + np.linspace(0.0, 1.0, FRAMES + 1)[:, None, None] ** 2 * [0.0, 0.3, 1.0]
    key = bake_shape_keys(grid, motion, FRAME_START, FPS)
    _check("two keyframes of the evaluation time", [len(curve.keyframe_points) for curve in evaluation_time_curves(key)] == [2])
    worst = 0.0
    for frame in range(FRAMES + 1):
        scene.frame_set(FRAME_START + frame)
        evaluated = grid.evaluated_get(bpy.context.evaluated_depsgraph_get())
        shown = np.array([(evaluated.matrix_world @ vertex.co)[:] for vertex in evaluated.data.vertices])
        worst = max(worst, float(np.abs(shown - motion[frame]).max()))
    _check("baked vertices play back", worst < 1e-5, f"{worst:.1e} m")
    _check("bake cleared", clear_bake(grid) and grid.data.shape_keys is None)


def _check_clip_scene(scene: bpy.types.Scene) -> None:
    with tempfile.TemporaryDirectory() as folder:
        image = bpy.data.images.new("Picture", 64, 48)
        for frame in range(4):
            image.filepath_raw, image.file_format = str(Path(folder) / f"picture_{frame:04}.png"), "PNG"
            image.save()
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]], [0.0, -2.0, 0.5]
        camera = {"width": 64, "height": 48, "fx": 70.0, "fy": 70.0, "cx": 31.5, "cy": 23.5, "camera_to_world": pose}
        obj = setup_clip_scene(scene, Path(folder) / "picture_0000.png", camera, 30.19, 0, 3)
    _check("camera level, looking along +Y", (obj.matrix_basis.to_3x3() @ Vector((0, 0, -1)) - Vector((0, 1, 0))).length < 1e-6)
    _check("frame rate", math.isclose(scene.render.fps / scene.render.fps_base, 30.19, rel_tol=1e-5))
    _check("clip behind the camera", obj.data.background_images[0].clip is not None)


def main() -> None:
    for check in (_check_field, _check_arrows, _check_bake, _check_clip_scene):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        check(bpy.context.scene)
    print("field_object_check: all good in Blender", bpy.app.version_string)


if __name__ == "__main__":
    main()
