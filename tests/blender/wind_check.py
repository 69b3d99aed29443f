"""Cloth, particles, rigid bodies and hair of a real Blender in a field that carries a wind; the tests in tests/ui use the same functions.

    blender -b --factory-startup --python-exit-code 9 --python tests/blender/wind_check.py

Prints how far each is off the drag law, and ends with exit code 9 when one is too far.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seeing_wind.ui.field.field_object import create_field_object  # noqa: E402
from seeing_wind.ui.field.lattice import SampledField, fine_lattice  # noqa: E402
from seeing_wind.ui.field.solvers.calibration import calibrate_object  # noqa: E402

FPS, DRAG = 25.0, 0.5 * 1.2 * 1.17
SPEED = 1.5
U = np.array([0.0, 0.0, SPEED])
"""m/s."""
BALL = 2.0 / 3.0 * np.pi * 0.1**2
"""Of a ball of 10 cm, in place of the area of a plate across [m²]: the integral of cos² over its windward half."""
BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


def steady(scene: bpy.types.Scene, kind: str = "WIND") -> bpy.types.Object:
    """A wind upwards that is the same everywhere, with a force along X beside it, so that nothing is mistaken for the other."""
    nodes = fine_lattice(BOX)
    velocity, force = (np.broadcast_to(vector, (4, len(nodes), 3)) for vector in (U, [300.0, 0.0, 0.0]))
    return create_field_object(
        scene, "Wind", SampledField(nodes, force, np.ones((4, len(nodes))), velocity), fps=FPS, density=30.0, reach="HOLD", kind=kind,
        speeds=(SPEED, SPEED), drag=DRAG,
    )  # fmt: skip


def sheet(scene: bpy.types.Scene) -> bpy.types.Object:
    """A square of cloth across it, near the lower end of the box."""
    bpy.ops.mesh.primitive_grid_add(size=0.2, x_subdivisions=4, y_subdivisions=4, location=(0.0, 0.0, -0.9))
    obj = bpy.context.object
    cloth = obj.modifiers.new("Cloth", "CLOTH")
    cloth.settings.quality, cloth.settings.mass = 20, 0.02
    scene.use_gravity, scene.render.fps, scene.frame_end = False, int(FPS), 100
    return obj


def places(obj: bpy.types.Object, scene: bpy.types.Scene, frames: int) -> np.ndarray:
    """Middle of a mesh (frames, 3), from frame 1 on."""
    found = []
    for frame in range(1, frames + 1):
        scene.frame_set(frame)
        evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found.append(np.mean([(evaluated.matrix_world @ vertex.co)[:] for vertex in evaluated.data.vertices], axis=0))
    return np.array(found)


def dust(scene: bpy.types.Scene) -> bpy.types.Object:
    """Twenty particles of 2 cm at the same place."""
    bpy.ops.mesh.primitive_plane_add(size=0.02, location=(0.0, 0.0, -0.9))
    obj = bpy.context.object
    settings = obj.modifiers.new("Dust", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.frame_start, settings.frame_end, settings.lifetime, settings.normal_factor = 20, 1, 1, 500, 0.0
    settings.particle_size, scene.use_gravity, scene.frame_end, scene.render.fps = 0.01, False, 100, int(FPS)
    return obj


def dust_speeds(obj: bpy.types.Object, scene: bpy.types.Scene, frames: int) -> np.ndarray:
    """Mean speed upwards [m/s] (frames,), from frame 1 on."""
    speeds = []
    for frame in range(1, frames + 1):
        scene.frame_set(frame)
        system = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
        speeds.append(np.mean([particle.velocity[2] for particle in system.particles]))
    return np.array(speeds)


def ball(scene: bpy.types.Scene, radius: float = 0.1, mass: float = 0.005) -> bpy.types.Object:
    """A rigid ball near the lower end of the box."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, segments=64, ring_count=32, location=(0.0, 0.0, -0.9))
    obj = bpy.context.object
    if scene.rigidbody_world is None:
        bpy.ops.rigidbody.world_add()
    bpy.ops.rigidbody.object_add()
    obj.rigid_body.mass = mass
    scene.use_gravity, scene.render.fps, scene.frame_end = False, int(FPS), 100
    return obj


def strands(scene: bpy.types.Scene) -> tuple[bpy.types.Object, bpy.types.ParticleSystem]:
    """Hairs of 2 m and 1 cm along X, without stiffness, so that their ends drift with the wind."""
    mesh = bpy.data.meshes.new("Hair")
    mesh.from_pydata([(0.0, 0.0, -0.5), (0.01, 0.0, -0.5), (0.0, 0.01, -0.5)], [], [(0, 1, 2)])
    obj = bpy.data.objects.new("Hair", mesh)
    scene.collection.objects.link(obj)
    system = obj.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system
    settings = system.settings
    settings.type, settings.count, settings.emit_from, settings.use_emit_random = "HAIR", 3, "VERT", False
    settings.normal_factor, settings.object_align_factor, settings.hair_length, settings.hair_step = 0.0, (0.5, 0.0, 0.0), 0.5, 3
    settings.root_radius = settings.tip_radius = 1.0
    scene.use_gravity, scene.render.fps, scene.frame_end = False, int(FPS), 100
    bpy.context.view_layer.update()
    system.use_hair_dynamics = True
    cloth = system.cloth.settings
    cloth.pin_stiffness, cloth.bending_stiffness, cloth.quality = 0.0, 0.0, 20
    return obj, system


def tip_heights(obj: bpy.types.Object, scene: bpy.types.Scene, frames: int) -> np.ndarray:
    """Mean height of the hairs' tips (frames,) over where they start, from frame 1 on."""
    found = []
    for frame in range(1, frames + 1):
        scene.frame_set(frame)
        system = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
        found.append(np.mean([particle.hair_keys[-1].co[2] for particle in system.particles]))
    return np.array(found) - found[0]


def drag_way(rate: float, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Way [m] and speed [m/s] (frames,) of what starts at rest under a linear drag: v = u (1 - exp(-rate t))."""
    t = np.arange(frames) / FPS
    return SPEED * (t - (1.0 - np.exp(-rate * t)) / rate), SPEED * (1.0 - np.exp(-rate * t))


def check_vdb(scene: bpy.types.Scene, field: bpy.types.Object) -> None:
    """The velocity is in the files, with its unit and class, where this Blender can write them."""
    from seeing_wind.ui.field.display import openvdb_available
    from seeing_wind.ui.field.vdb import write_vdb

    if not openvdb_available():
        return
    import openvdb

    with tempfile.TemporaryDirectory() as aside:
        grids, _ = openvdb.readAll(str(write_vdb(scene, field, Path(aside))[0]))
    velocity = next(grid for grid in grids if grid.name == "velocity")
    assert {grid.name for grid in grids} == {"force", "velocity", "confidence"}
    assert (velocity["unit"], velocity["vector_type"]) == ("m/s", "contravariant relative")
    assert np.allclose(velocity.getConstAccessor().getValue((1, 1, 1)), U, atol=1e-5)


def main() -> None:
    """Measure all four."""
    scene = bpy.context.scene
    for obj in list(scene.objects):
        bpy.data.objects.remove(obj)
    field, cloth = steady(scene), sheet(scene)
    check_vdb(scene, field)
    print(calibrate_object(scene, cloth, field, areal_density=0.1)[0])
    way = drag_way(DRAG * SPEED / 0.1, 26)[0]
    off = (places(cloth, scene, 26)[:, 2] + 0.9)[[5, 25]] / way[[5, 25]] - 1.0
    grains = dust(scene)
    print(calibrate_object(scene, grains, field, density=5.0)[0])
    speed = drag_way(DRAG * SPEED / (2.0 * 5.0 * 0.01), 30)[1]
    late = dust_speeds(grains, scene, 30)[-1] / speed[-1] - 1.0
    thrown = ball(scene)
    print(calibrate_object(scene, thrown, field)[0])
    rolled = (places(thrown, scene, 26)[:, 2] + 0.9)[[5, 25]] / drag_way(DRAG * SPEED * BALL / 0.005, 26)[0][[5, 25]] - 1.0
    hair, _ = strands(scene)
    print(calibrate_object(scene, hair, field, density=30.0)[0])
    swept = tip_heights(hair, scene, 26)
    blown = swept[5] / drag_way(DRAG * SPEED / (30.0 * 0.01), 26)[0][5] - 1.0
    print(f"rigid body: {100 * rolled[0]:.1f} % off its way after 5 frames, {100 * rolled[1]:.1f} % after 25")
    print(f"hair, its tip: {100 * blown:.1f} % off after 5 frames")
    print(f"cloth: {100 * off[0]:.1f} % off its way after 5 frames, {100 * off[1]:.1f} % after 25")
    print(f"particles: {100 * late:.1f} % off the speed at the end")
    assert np.abs(off).max() < 0.06 and abs(late) < 0.08
    assert np.abs(rolled).max() < 0.06 and abs(blown) < 0.08


if __name__ == "__main__":
    main()
