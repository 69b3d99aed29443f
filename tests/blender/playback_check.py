"""How far all that feels a curved field is off it, and how fast a thousand particles play in it: `make solvers BLENDER=PROGRAM`.

    blender -b --factory-startup --python-exit-code 9 --python tests/blender/playback_check.py

First some lines for each length of the field's waves, in half lengths of its box: the shorter they are, the more nodes its lattice has.
They have the mean errors of each kind of solver and the frames per second of the particles, played forwards for the first time: the
scene's evaluation without drawing, by the clock and by processor time. Then the particles' speed with what an artist may do to the field.
Ends with exit code 9 when an error misses `BAR`; speed is printed only.
"""

from __future__ import annotations

import runpy
import sys
import time
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
solvers = runpy.run_path(str(Path(__file__).with_name("native_solvers_check.py")), run_name="solvers")

from seeing_wind.ui.field.conform import set_stride  # noqa: E402
from seeing_wind.ui.field.display import LOOP, NODES, WIND, said_of_fit  # noqa: E402
from seeing_wind.ui.field.field_object import create_field_object  # noqa: E402
from seeing_wind.ui.field.lattice import SampledField, differences, fine_lattice  # noqa: E402
from seeing_wind.ui.field.solvers.particles import calibrate_particles  # noqa: E402

BOX, CENTRE, DENSITY, FPS, FRAME_START = (solvers[name] for name in ("BOX", "CENTRE", "DENSITY", "FPS", "FRAME_START"))
FRAMES, COUNT = 48, 1000
LENGTHS = (6.0, 4.0, 2.0, 1.2)
INTERVALS = (0, 3)
"""Frames in which errors are measured."""
BAR = (1.0, 0.02)
"""Mean angle [degrees] and mean relative error of the size."""
STEADY, SPEED = 60.0, 6.0
"""Force density [N/m³] of the steady wind, and its velocity [m/s] where solvers feel one."""


def waves(length: float) -> Callable[[np.ndarray, float], np.ndarray]:
    """A steady wind and waves across it, which wander."""

    def flow(points: np.ndarray, frame: float) -> np.ndarray:
        """(P, 3) [N/m³] in a frame."""
        x, y, z = (points - CENTRE).T / 0.5 * (2.0 * np.pi / length)
        phase = 0.15 * frame
        turning = np.stack([np.sin(y + 0.5 + phase), np.sin(z + 0.3 * x - phase), np.cos(x - 0.4 * y + phase)], axis=-1)
        return STEADY * (np.array([1.0, 0.3, 0.5]) + 0.4 * turning)

    return flow


def wavy_field(length: float, frames: int, **options) -> bpy.types.Object:
    """Its field object in an empty scene, from values where Recover asks for them."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = int(FPS), FRAME_START, FRAME_START + frames - 1
    nodes, flow = fine_lattice(BOX), waves(length)
    values = np.stack([flow(nodes, frame) for frame in range(frames)])
    wind = SPEED / STEADY * values if "kind" in options else None
    sampled = SampledField(nodes, values, np.ones(values.shape[:2]), wind)
    return create_field_object(scene, "Wind", sampled, fps=FPS, density=DENSITY, frame_start=FRAME_START, **options)


def mean_errors(name: str, length: float) -> tuple[bpy.types.Object, tuple[float, float]]:
    """The field object, and mean angle [degrees] and mean relative error of one kind of solver."""
    pairs = []
    for interval in INTERVALS:
        field = wavy_field(length, max(INTERVALS) + 2)
        pairs.append(solvers["KINDS"][name][1](field, interval).beside(field, CENTRE, waves(length), interval))
    found, truth = (np.concatenate(parts)[None] for parts in zip(*pairs, strict=True))
    return field, differences(found, truth)


def particles(field: bpy.types.Object) -> None:
    """Released at rest all over the box, in the first frame; everything as Blender has it, but for the calibration."""
    scene, points = bpy.context.scene, np.random.default_rng(3).uniform(*BOX, (COUNT, 3))
    mesh = bpy.data.meshes.new("Emitter")
    mesh.from_pydata(points.tolist(), [], [])
    emitter = bpy.data.objects.new("Emitter", mesh)
    scene.collection.objects.link(emitter)
    settings = emitter.modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.emit_from, settings.use_emit_random = COUNT, "VERT", False
    settings.normal_factor, settings.lifetime = 0.0, 1000.0
    settings.frame_start = settings.frame_end = FRAME_START
    settings.effector_weights.gravity = 0.0
    calibrate_particles(settings, field)


def tell_pace(what: str, field: bpy.types.Object) -> None:
    """Print how fast a thousand particles play for the first time."""
    particles(field)
    scene = bpy.context.scene
    scene.frame_set(FRAME_START)
    clock, work = time.perf_counter(), time.process_time()
    for frame in range(FRAME_START + 1, FRAME_START + FRAMES):
        scene.frame_set(frame)
    pace = [(FRAMES - 1) / taken for taken in (time.perf_counter() - clock, time.process_time() - work)]
    print(f"{what}: {COUNT} particles play at {pace[0]:.1f} frames/s ({pace[1]:.1f} by processor time)", flush=True)


def key(field: bpy.types.Object) -> None:
    """Strength and direction with a keyframe at both ends."""
    for frame, factor, turn in ((FRAME_START, 0.5, 0.0), (FRAME_START + FRAMES, 1.5, 1.0)):
        field.field.strength, field.rotation_euler = factor * field["seeing_wind_strength"], (0.3 * turn, 0.0, turn)
        field.keyframe_insert("field.strength", frame=frame)
        field.keyframe_insert("rotation_euler", frame=frame)


def loop(field: bpy.types.Object) -> None:
    """Retimed and looped."""
    set_stride(field, 0.37)
    field[LOOP] = True


CASES = {
    "strength and direction keyed": (key, {}),
    "retimed and looped": (loop, {}),
    "holding beside the box": (lambda field: None, {"reach": "HOLD"}),
    "continuing beside the box": (lambda field: None, {"reach": "CONTINUE"}),
    "felt as a wind": (lambda field: None, {"kind": WIND, "speeds": (SPEED, SPEED), "drag": 0.6}),
}
"""What an artist may do to a field, and how it is made for that."""


def main() -> None:
    """The table."""
    missed = False
    for length in LENGTHS:
        for name in solvers["kinds_here"]([]):
            field, off = mean_errors(name, length)
            missed |= off[0] > BAR[0] or off[1] > BAR[1]
            what = f"{'x'.join(str(count) for count in field[NODES])} nodes, waves of {length:g}"
            print(f"{what}, {name}: {off[0]:.2f} degrees and {100 * off[1]:.2f} % off", flush=True)
        print(f"{what}; the panel says: {said_of_fit(field)}")
        tell_pace(what, wavy_field(length, FRAMES))
    for name, (change, options) in CASES.items():
        field = wavy_field(LENGTHS[-1], FRAMES, **options)
        change(field)
        tell_pace(name, field)
    if missed:
        raise SystemExit(9)


if __name__ == "__main__":
    main()
