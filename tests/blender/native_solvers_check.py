"""What Blender's own solvers feel of a field object, against the field that it was made from; the tests in tests/ui use the same functions.

    blender -b --factory-startup --python-exit-code 9 --python tests/blender/native_solvers_check.py [-- cloth hair ...]

Every solver gets 200 probes, spread over the box and released at rest: one body of the solver's kind each. A probe's acceleration over a
frame is compared with f / rho of the known swirl where it is. Ends with exit code 9 when a bar is missed.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Vector

sys.path[:0] = [str(Path(__file__).resolve().parents[2]), str(Path(__file__).parent)]
checks = runpy.run_path(str(Path(__file__).with_name("field_object_check.py")), run_name="checks")

from felt import Felt  # noqa: E402

from seeing_wind.ui.field.node_groups import GroupBuilder, set_input, set_up_modifier  # noqa: E402
from seeing_wind.ui.field.samples import sample_wind_group, samples_of  # noqa: E402
from seeing_wind.ui.field.solvers.calibration import calibrate_object  # noqa: E402

PROBES = 200
BOX, CENTRE, DENSITY, FPS, FRAMES, FRAME_START = (checks[name] for name in ("BOX", "CENTRE", "DENSITY", "FPS", "FRAMES", "FRAME_START"))
INTERVALS = range(FRAMES)
MOVED = ((0.4, 1.0, -0.3), (0.5, -0.7, 1.1))
"""How far [m] and by which Euler angles [rad] the field object is moved and turned for the second half of the measurements."""
BARS = {"particles": (1.0, 0.02), "rigid": (1.0, 0.02), "hair": (2.0, 0.05), "cloth": (2.0, 0.05), "nodes": (1.0, 0.03)}
"""Largest angle [degrees] and relative error of the size, by kind of solver."""


def places(interval: int) -> np.ndarray:
    """(PROBES, 3) in the box of the swirl."""
    return np.random.default_rng(interval).uniform(*BOX, (PROBES, 3))


def released(field: bpy.types.Object, points: np.ndarray) -> np.ndarray:
    """Points of the box, moved and turned as the field object is."""
    bpy.context.view_layer.update()
    moved = np.array(field.matrix_world)
    return (points - CENTRE) @ moved[:3, :3].T + moved[:3, 3]


def worst(field: bpy.types.Object, felt: Felt, interval: int) -> tuple[float, float]:
    """Worst angle [degrees] and relative error of the size against the swirl."""
    return checks["worst_errors"](*felt.beside(field, CENTRE, checks["swirl"], interval))


def first_move(obj: bpy.types.Object, cache: bpy.types.PointCache | None, frame: int, read, substeps: int) -> np.ndarray:
    """Accelerations [scene units/s²] from how far a solver moves things from rest in its first frame.

    A solver that adds to the velocity before it moves goes a (n + 1) / 2n dt² in n equal substeps.
    """
    scene = bpy.context.scene
    if cache is not None:
        cache.frame_start, cache.frame_end = frame, frame + 10
    seen = []
    for now in (frame, frame + 1):
        scene.frame_set(now)
        seen.append(read(obj.evaluated_get(bpy.context.evaluated_depsgraph_get())))
    return (seen[1] - seen[0]) * FPS**2 * 2 * substeps / (substeps + 1)


def patches(points: np.ndarray, cells: int, size: float) -> bpy.types.Object:
    """One mesh of a small square sheet at every point, turned every way."""
    axis = np.linspace(-size / 2, size / 2, cells + 1)
    flat = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2)
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    faces = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    rng, vertices = np.random.default_rng(0), []
    for point in points:
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        vertices.append(point + flat @ turn[:2])
    mesh = bpy.data.meshes.new("Patches")
    corners = np.concatenate([faces + k * len(flat) for k in range(len(points))])
    mesh.from_pydata(np.concatenate(vertices).tolist(), [], corners.tolist())
    obj = bpy.data.objects.new("Patches", mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def middles(evaluated: bpy.types.Object) -> np.ndarray:
    """(PROBES, 3) middles of the patches, in the world."""
    mesh = evaluated.data
    flat = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", flat)
    matrix = np.array(evaluated.matrix_world)
    return flat.reshape(PROBES, -1, 3).astype(float).mean(1) @ matrix[:3, :3].T + matrix[:3, 3]


def felt_by_particles(field: bpy.types.Object, interval: int) -> Felt:
    """Newtonian particles."""
    at, found = checks["released_accelerations"](bpy.context.scene, field, released(field, places(interval)), FRAME_START + interval)
    return Felt(at, found * DENSITY)


def felt_by_rigid_bodies(field: bpy.types.Object, interval: int) -> Felt:
    """Small cubes as rigid bodies."""
    scene, frame = bpy.context.scene, FRAME_START + interval
    bpy.ops.rigidbody.world_add()
    world = scene.rigidbody_world
    world.effector_weights.gravity = 0.0
    world.collection = bpy.data.collections.new("Rigid")
    mesh = bpy.data.meshes.new("Cube")
    mesh.from_pydata([(x, y, z) for x in (-0.001, 0.001) for y in (-0.001, 0.001) for z in (-0.001, 0.001)], [], [])
    at, cubes = released(field, places(interval)), []
    for point in at:
        cube = bpy.data.objects.new("Cube", mesh)
        cube.location = point
        scene.collection.objects.link(cube)
        world.collection.objects.link(cube)
        cube.rigid_body.mass, cube.rigid_body.collision_shape, cube.rigid_body.linear_damping = 0.05, "SPHERE", 0.0
        cubes.append(cube)
    calibrate_object(scene, cubes[0], field)

    def read(_) -> np.ndarray:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        return np.array([cube.evaluated_get(depsgraph).matrix_world.translation[:] for cube in cubes])

    found = first_move(cubes[0], world.point_cache, frame, read, world.substeps_per_frame)
    bpy.ops.rigidbody.world_remove()
    for cube in cubes:
        bpy.data.objects.remove(cube)
    return Felt(at, found * DENSITY)


def felt_by_cloth(field: bpy.types.Object, interval: int, cells: int) -> Felt:
    """Small sheets of cells x cells faces; a sheet's acceleration is that of its middle."""
    scene = bpy.context.scene
    obj = patches(released(field, places(interval)), cells, 0.04)
    cloth = obj.modifiers.new("Cloth", "CLOTH")
    cloth.settings.effector_weights.gravity = 0.0
    calibrate_object(scene, obj, field)
    at = middles(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    found = first_move(obj, cloth.point_cache, FRAME_START + interval, middles, cloth.settings.quality)
    bpy.data.objects.remove(obj)
    return Felt(at, found * DENSITY)


def felt_by_hair(field: bpy.types.Object, interval: int) -> Felt:
    """Short hairs without stiffness; their tips, across the hair: along it the hair itself holds them."""
    obj = patches(released(field, places(interval)), 1, 0.001)
    system = obj.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system
    settings = system.settings
    settings.type, settings.count, settings.emit_from, settings.use_emit_random = "HAIR", PROBES, "VERT", False
    settings.hair_length, settings.hair_step = 0.02, 3
    bpy.context.view_layer.update()
    system.use_hair_dynamics = True
    cloth = system.cloth.settings
    cloth.pin_stiffness = cloth.bending_stiffness = settings.effector_weights.gravity = 0.0
    calibrate_object(bpy.context.scene, obj, field)

    def keys(evaluated: bpy.types.Object) -> np.ndarray:
        return np.array([[key.co[:] for key in particle.hair_keys] for particle in evaluated.particle_systems[0].particles])

    found = first_move(obj, system.point_cache, FRAME_START + interval, keys, cloth.quality)[:, -1]
    bpy.context.scene.frame_set(FRAME_START + interval)
    at = keys(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    bpy.data.objects.remove(obj)
    along = at[:, -1] - at[:, -2]
    return Felt(at[:, -1], found * DENSITY, along / np.linalg.norm(along, axis=1, keepdims=True))


def sample_wind(field: bpy.types.Object, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 3) in the world, and the accelerations that the node group Sample Wind gives there in a scene frame."""
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("Points")
    mesh.from_pydata(points.tolist(), [], [])
    obj = bpy.data.objects.new("Points", mesh)
    scene.collection.objects.link(obj)
    # the object stands elsewhere than the world's origin, with its points where they were
    obj.matrix_world = Euler((0.2, 0.3, -0.4)).to_matrix().to_4x4()
    bpy.context.view_layer.update()
    mesh.transform(obj.matrix_world.inverted())
    group = GroupBuilder("Read")
    wind = group.tree.nodes.new("GeometryNodeGroup")
    wind.node_tree = sample_wind_group(samples_of(field), DENSITY)
    stored = group.node(
        "GeometryNodeStoreNamedAttribute", {"Geometry": group.input.outputs[0], "Name": "a", "Value": wind.outputs["Acceleration"]},
        data_type="FLOAT_VECTOR", domain="POINT",
    )  # fmt: skip
    set_up_modifier(obj, group.finish(stored.outputs[0]))
    scene.frame_set(frame)
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    turn = np.array(evaluated.matrix_world)
    found = np.array([value.vector[:] for value in evaluated.data.attributes["a"].data]) @ turn[:3, :3].T
    at = np.array([vertex.co[:] for vertex in evaluated.data.vertices]) @ turn[:3, :3].T + turn[:3, 3]
    bpy.data.objects.remove(obj)
    return at, found


def felt_by_sample_wind(field: bpy.types.Object, interval: int) -> Felt:
    """Sample Wind in the frame in which solvers feel the interval."""
    at, found = sample_wind(field, released(field, places(interval)), FRAME_START + interval + 1)
    return Felt(at, found * DENSITY)


def felt_by_nodes(field: bpy.types.Object, interval: int, substeps: int) -> Felt:
    """Blender 5.2's Cloth Dynamics as a modifier, on small sheets; two frames, since it starts with half a move."""
    scene = bpy.context.scene
    from seeing_wind.ui.field.solvers.physics_nodes import ASSETS

    path = str(Path(bpy.utils.system_resource("DATAFILES")) / ASSETS)
    with bpy.data.libraries.load(path) as (source, wanted):
        wanted.node_groups = [name for name in source.node_groups if name.startswith("Cloth Dynamics")]
    obj = patches(released(field, places(interval)), 1, 0.04)
    modifier = obj.modifiers.new("Cloth Dynamics", "NODES")
    modifier.node_group = wanted.node_groups[0]
    tree = modifier.node_group
    sockets = [item for item in tree.interface.items_tree if item.item_type == "SOCKET"]
    switch = next(item for item in sockets if item.socket_type == "NodeSocketBool" and item.name == "Gravity")
    getattr(modifier.properties.inputs, switch.identifier).value = False
    for name, value in {"Substeps": substeps, "Linear Damping": 0.0, "Mass": 0.37}.items():
        set_input(modifier, name, value)
    # light, so that it moves farther in a substep than single precision blurs
    said = calibrate_object(scene, obj, field, density=DENSITY / 10)
    assert len(said) == 1 and "Cloth Dynamics" in said[0], said
    frame = FRAME_START + interval
    scene.frame_start, scene.frame_end = frame, frame + 10
    seen = []
    for now in (frame, frame + 1):
        scene.frame_set(now)
        seen.append(middles(obj.evaluated_get(bpy.context.evaluated_depsgraph_get())))
    bpy.data.objects.remove(obj)
    return Felt(seen[0], (seen[1] - seen[0]) * FPS**2 * 2 * substeps / (substeps + 1) * DENSITY / 10)


KINDS = {
    "particles": ("particles", felt_by_particles),
    "rigid bodies": ("rigid", felt_by_rigid_bodies),
    "cloth of 2x2 faces": ("cloth", lambda field, interval: felt_by_cloth(field, interval, 2)),
    "cloth of 5x5 faces": ("cloth", lambda field, interval: felt_by_cloth(field, interval, 5)),
    "hair": ("hair", felt_by_hair),
    "Sample Wind": ("nodes", felt_by_sample_wind),
    "Cloth Dynamics, 1 substep": ("nodes", lambda field, interval: felt_by_nodes(field, interval, 1)),
    "Cloth Dynamics, 20 substeps": ("nodes", lambda field, interval: felt_by_nodes(field, interval, 20)),
}


def kinds_here(wanted: list[str]) -> list[str]:
    """The kinds of solver that this Blender has, or those of them whose names begin as wanted."""
    here = [name for name in KINDS if not name.startswith("Cloth Dynamics") or bpy.app.version >= (5, 2, 0)]
    return [name for name in here if not wanted or name.startswith(tuple(wanted))]


def measured(name: str, moved: bool) -> tuple[list[tuple[float, float]], int]:
    """Worst angle [degrees] and relative error of one kind of solver in each frame of the clip, and how many frames miss its bar."""
    kind, measure = KINDS[name]
    found = []
    for interval in INTERVALS:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        field = checks["swirl_field"](bpy.context.scene)
        if moved:
            field.location += Vector(MOVED[0])
            field.rotation_euler = Euler(MOVED[1])
        found.append(worst(field, measure(field, interval), interval))
    return found, sum(angle > BARS[kind][0] or size > BARS[kind][1] for angle, size in found)


def main() -> None:
    """Every kind in every frame of the clip, the field object as made, then moved and turned."""
    all_missed = 0
    for name in kinds_here(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []):
        for moved in (False, True):
            found, missed = measured(name, moved)
            all_missed += missed
            worst = np.max(found, axis=0)
            frames = " ".join(f"{100 * size:.2f}" for _, size in found)
            print(
                f"{'FAIL' if missed else 'ok  '} {name}{', field moved and turned' if moved else ''}: {worst[0]:.2f} degrees, "
                f"{100 * worst[1]:.2f} % ({frames} in frames 0 to {FRAMES - 1})",
                flush=True,
            )
    if all_missed:
        raise SystemExit(9)
    print("native_solvers_check: all good in Blender", bpy.app.version_string)


if __name__ == "__main__":
    main()
