"""What the re-simulation gets of Blender's own force fields, against particles in them; the tests in tests/ui use the same functions.

    blender -b --factory-startup --python-exit-code 9 --python tests/blender/force_fields_check.py

For each kind the mean ratio of the accelerations is printed. Ends with exit code 9 when one is more than a hundredth off.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seeing_wind.ui.edit.resimulate.further_forces import further_forces  # noqa: E402
from seeing_wind.ui.field.lattice import SampledField  # noqa: E402

MASS = 2.5
"""kg of the body, and of the particles."""
KINDS = {
    "FORCE": {"strength": 7.0, "falloff_power": 0.0}, "WIND": {"strength": 5.0}, "VORTEX": {"strength": 3.0},
    "TURBULENCE": {"strength": 4.0, "size": 1.5}, "HARMONIC": {"strength": 2.0, "rest_length": 0.5},
}  # fmt: skip
"""Force fields with settings."""


def push(kind: str, location=(0.0, 0.0, 0.0), **settings) -> bpy.types.Object:
    """A force field of Blender's own."""
    bpy.ops.object.effector_add(type=kind, location=location)
    for name, value in settings.items():
        setattr(bpy.context.object.field, name, value)
    return bpy.context.object


def at(found: dict[str, np.ndarray], places: np.ndarray) -> np.ndarray:
    """The forces (T, P, 3) [N] of the file's arrays at places (P, 3) [m]."""
    counts = found["force"].shape[1:4]
    axes = [np.linspace(*found["box"][:, k], counts[k]) for k in range(3)]
    nodes, frames = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3), len(found["force"])
    return SampledField(nodes, found["force"].reshape(frames, -1, 3).astype(float), np.ones((frames, len(nodes)))).at(places)


def felt_by_particles(places: np.ndarray, mass: float, frames: range, speed=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Accelerations (T, P, 3) [scene units/s²] of Blender's particles of a mass, let go in the user's scene a frame before each."""
    mesh = bpy.data.meshes.new("Dust")
    mesh.from_pydata(places.tolist(), [], [])
    obj = bpy.data.objects.new("Dust", mesh)
    scene = bpy.context.scene
    scene.collection.objects.link(obj)
    settings = obj.modifiers.new("Dust", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.emit_from, settings.use_emit_random = len(places), "VERT", False
    settings.integrator = "EULER"  # a step without what it changes by itself: a drag at the velocity that it is asked for
    settings.mass, settings.normal_factor, settings.object_align_factor = mass, 0.0, speed
    settings.effector_weights.gravity = settings.effector_weights.texture = 0.0  # the latter is the recovered field
    found = []
    for frame in frames:
        settings.frame_start = settings.frame_end = frame - 1
        scene.frame_set(frame - 1)
        scene.frame_set(frame)
        particles = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0].particles
        found.append(np.array([np.array(each.velocity) for each in particles]) - speed)
    bpy.data.objects.remove(obj)
    return np.stack(found) / 0.04


def compared(found: dict[str, np.ndarray], unit: float = 1.0) -> tuple[float, float]:
    """Mean ratio of the accelerations of a body of `MASS` and of Blender's particles, and the mean error over the mean size."""
    places = np.random.default_rng(3).uniform(-0.2, 0.2, (40, 3))
    truth = felt_by_particles(places / unit, MASS, range(2, 2 + len(found["force"]))) * unit
    ours = at(found, places) / MASS
    size = np.linalg.norm(truth, axis=-1)
    return float((np.linalg.norm(ours, axis=-1) / size).mean()), float(np.linalg.norm(ours - truth, axis=-1).mean() / size.mean())


def main() -> None:
    """Each kind, in an empty scene."""
    for kind, settings in KINDS.items():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        field = push(kind, (3.0, 0.4, -0.2), **settings)
        found = further_forces([field], np.array([[-0.5, -0.3, -0.5], [0.7, 0.3, 0.6]]), [1.0, 2.0, 3.0, 4.0], 1.0)
        ratio, error = compared(found.arrays)
        print(f"{'ok ' if abs(ratio - 1.0) < 0.01 else 'OFF'} {kind}: {ratio:.5f} of a particle's acceleration, {100.0 * error:.2f} % off")
        assert abs(ratio - 1.0) < 0.01 and error < 0.02, kind


if __name__ == "__main__":
    main()
