"""How fast a thousand native particles play in a curved field, forwards for the first time, and how far what they feel is off the field.

    blender -b --factory-startup --python-exit-code 9 --python tests/blender/playback_check.py

Prints a line for each length of the field's waves, in half lengths of its box: the shorter they are, the more nodes its lattice has. Frames
per second are the scene's evaluation without drawing, by the clock and by processor time. Ends with exit code 9 when the error of the mean
misses `BAR`; speed is printed only.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seeing_wind.ui.field.display import NODES, said_of_fit  # noqa: E402
from seeing_wind.ui.field.field_object import create_field_object  # noqa: E402
from seeing_wind.ui.field.lattice import SampledField, differences, fine_lattice  # noqa: E402
from seeing_wind.ui.field.solvers.particles import calibrate_particles  # noqa: E402

FPS, FRAMES, COUNT, DENSITY = 24.0, 48, 1000, 120.0
BOX = np.array([[-0.5, -0.5, -0.4], [0.5, 0.5, 0.4]])
LENGTHS = (16.0, 4.0, 2.0, 1.2)
BAR = (1.0, 0.02)
"""Mean angle [degrees] and mean relative error of the size."""


def waves(points: np.ndarray, picture: float, length: float) -> np.ndarray:
    """(P, 3) [N/m³]: a steady wind and waves across it, which wander."""
    x, y, z = points.T / 0.5 * (2.0 * np.pi / length)
    phase = 0.15 * picture
    turning = np.stack([np.sin(y + 0.5 + phase), np.sin(z + 0.3 * x - phase), np.cos(x - 0.4 * y + phase)], axis=-1)
    return 60.0 * (np.array([1.0, 0.3, 0.5]) + 0.4 * turning)


def wavy_field(scene: bpy.types.Scene, length: float) -> bpy.types.Object:
    """Its field object, from values where Recover asks for them."""
    nodes = fine_lattice(BOX)
    values = np.stack([waves(nodes, picture, length) for picture in range(FRAMES)])
    return create_field_object(scene, "Wind", SampledField(nodes, values, np.ones(values.shape[:2])), fps=FPS, density=DENSITY)


def particles(scene: bpy.types.Scene, field: bpy.types.Object) -> bpy.types.Object:
    """Released at rest all over the box, in the first frame; everything as Blender has it, but for the calibration."""
    points = np.random.default_rng(3).uniform(*BOX, (COUNT, 3))
    mesh = bpy.data.meshes.new("Emitter")
    mesh.from_pydata(points.tolist(), [], [])
    emitter = bpy.data.objects.new("Emitter", mesh)
    scene.collection.objects.link(emitter)
    settings = emitter.modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.emit_from, settings.use_emit_random = COUNT, "VERT", False
    settings.normal_factor, settings.lifetime, settings.frame_start, settings.frame_end = 0.0, 1000.0, 1, 1
    settings.effector_weights.gravity = 0.0
    calibrate_particles(settings, field)
    return emitter


def state(emitter: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Places [m] and velocities [m/s] (COUNT, 3)."""
    system = emitter.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
    found = [np.empty(3 * COUNT, dtype=np.float32) for _ in range(2)]
    for name, values in zip(("location", "velocity"), found, strict=True):
        system.particles.foreach_get(name, values)
    return found[0].reshape(-1, 3).astype(float), found[1].reshape(-1, 3).astype(float)


def measured(length: float) -> tuple[bpy.types.Object, float, float, tuple[float, float]]:
    """The field object, frames per second by the clock and by processor time, and the mean errors in the first frame."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_end = int(FPS), FRAMES
    field = wavy_field(scene, length)
    emitter = particles(scene, field)
    scene.frame_set(1)
    places, slow = state(emitter)
    scene.frame_set(2)
    felt = (state(emitter)[1] - slow) * FPS
    off = differences(felt[None], waves(places, 0, length)[None] / DENSITY)
    clock, work = time.perf_counter(), time.process_time()
    for frame in range(3, FRAMES + 1):
        scene.frame_set(frame)
    frames = FRAMES - 2
    return field, frames / (time.perf_counter() - clock), frames / (time.process_time() - work), off


def main() -> None:
    """The table."""
    missed = False
    for length in LENGTHS:
        field, clock, work, off = measured(length)
        missed |= off[0] > BAR[0] or off[1] > BAR[1]
        nodes = "x".join(str(count) for count in field[NODES])
        print(
            f"waves of {length:g}: {nodes} nodes, {clock:.1f} frames/s ({work:.1f} by processor time), felt {off[0]:.2f} degrees and "
            f"{100 * off[1]:.2f} % off; said: {said_of_fit(field)}",
            flush=True,
        )
    if missed:
        raise SystemExit(9)


if __name__ == "__main__":
    main()
