"""The forces of Blender's own force fields in every frame of a clip, sampled on a lattice by means of Blender's particles.

Blender offers no other way to evaluate a force field at a point: particles of 1 kg are released there, and their change of velocity over
one frame gives the force. This is done in temporary scenes, so that the user's own simulations keep their caches. The particles feel copies
of the fields that are constant during the frame, as Blender does not document whether a solver runs before or after the keyframes of a
field's strength are evaluated.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ....engine.errors import UsageError
from ...field.lattice import SampledField, fine_lattice, lattice_counts
from .force_fields import feels_speed

SECONDS = 0.04
"""Duration of a frame of Blender's particles [s]."""
BESIDE = 0.25
"""Margin of the lattice on every side, relative to the longest side of the box of bodies and field."""
FINER, CLOSE = 40, 0.01
"""Cells along the longest side of a finer lattice, and the interpolation error of the usual lattice, relative to the size of the forces,
above which the finer one is used."""
COARSER = 2
"""The dependence on the velocity, ten numbers per node, is stored at every second node along each axis only."""
MOST = 4096
"""Largest number of particles in one system: with many more, Blender puts two on one vertex."""
SLIGHT = 1e-4
"""Change of the force [N] at 1 scene unit/s below which it counts as independent of the velocity: single precision."""

REST = (0.0, 0.0, 0.0)
MOVING = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (2.0, 0.0, 0.0))
"""Velocities with which particles are released [scene units/s]."""


@dataclass(frozen=True)
class FurtherForces:
    """Sampled forces in the form that the engine reads, see `recovery.resimulate.forces`."""

    arrays: dict[str, np.ndarray]
    error: float
    """Mean interpolation error of the forces between the nodes, relative to their size."""


def further_forces(fields: list[bpy.types.Object], box: np.ndarray, frames: list[float], metres: float) -> FurtherForces:
    """The forces of `fields` in each interval of a clip.

    Args:
        box: (2, 3) bounding box of the bodies and the recovered field [m].
        frames: scene frames of the T + 1 clip frames.
        metres: length of one scene unit [m].

    Raises:
        UsageError: when Blender does not emit the particles, or a force is not finite.
    """
    margin = BESIDE * float(np.ptp(box, axis=0).max())
    box = np.stack([box[0] - margin, box[1] + margin])
    # a solver steps to a whole frame, so a clip frame between two scene frames belongs to the step to the later one
    asked = [int(frame // 1) + 1 for frame in frames[:-1]]
    nodes = fine_lattice(box)
    with _probes(fields, nodes / metres, None) as probes:
        if _error(nodes, probes.felt(asked[0])[:1]) > CLOSE:
            nodes = fine_lattice(box, FINER)
    counts = lattice_counts(nodes)
    some = np.arange(len(nodes)).reshape(counts)[::COARSER, ::COARSER, ::COARSER]
    with _probes(fields, nodes / metres, nodes[some.ravel()] / metres if feels_speed(fields) else None) as probes:
        felt = {frame: probes.felt(frame) for frame in sorted(set(asked))}
    still = np.stack([felt[frame][0] for frame in asked])
    if not np.isfinite(still).all():
        raise UsageError("A force field of the scene pushes by what is no number.", "Check its strength and its falloff.")
    arrays = {"force": (still * metres).reshape(len(asked), *counts, 3).astype(np.float32)}
    if len(felt[asked[0]]) > 1:
        moving = [np.stack([felt[frame][1 + k] for frame in asked]) for k in range(len(MOVING))]
        arrays |= _by_speed(still[:, some.ravel()], moving, some.shape, metres)
    return FurtherForces({"box": box, **arrays}, _error(nodes, still))


def _error(nodes: np.ndarray, forces: np.ndarray | list[np.ndarray]) -> float:
    """Mean interpolation error of forces (T, L, 3) between the nodes, relative to their size; 0 if any force is not finite."""
    if not np.isfinite(forces).all():
        return 0.0
    return SampledField(nodes, np.asarray(forces), np.ones(np.shape(forces)[:2])).error_between_nodes()[1]


def _by_speed(still: np.ndarray, moving: list[np.ndarray], counts: tuple[int, ...], metres: float) -> dict[str, np.ndarray]:
    """Dependence on the velocity, from forces (T, L, 3) [kg scene units/s²] at rest and at each of `MOVING`; empty if there is none."""
    quadratic = -0.5 * (moving[3][..., 0] - 2.0 * moving[0][..., 0] + still[..., 0])
    linear = np.stack([moving[axis] - still for axis in range(3)], axis=-1) + quadratic[..., None, None] * np.eye(3)
    if max(np.abs(linear).max(), np.abs(quadratic).max()) <= SLIGHT:
        return {}
    return {
        "linear": linear.reshape(len(still), *counts, 3, 3).astype(np.float32),
        "quadratic": (quadratic / metres).reshape(len(still), *counts).astype(np.float32),
    }


class _Probes:
    """Particle systems at given places, one row of them per velocity.

    Args:
        scene: holds the particles and the copies; source: holds the force fields themselves.
        rows: a velocity [scene units/s] and the objects that emit particles with it.
    """

    def __init__(
        self, scene: bpy.types.Scene, source: bpy.types.Scene, copies: dict[bpy.types.Object, bpy.types.Object],
        rows: list[tuple[tuple[float, float, float], list[bpy.types.Object]]],
    ) -> None:  # fmt: skip
        self._scene, self._source, self._copies, self._rows = scene, source, copies, rows

    def felt(self, frame: int) -> list[np.ndarray]:
        """Forces (L, 3) [kg scene units/s²] during the step to a frame, one array per velocity."""
        self._source.frame_set(frame)
        depsgraph = self._source.view_layers[0].depsgraph
        for obj, copy in self._copies.items():
            _pose(copy, obj.evaluated_get(depsgraph))
        for _, row in self._rows:
            for obj in row:
                settings = obj.particle_systems[0].settings
                settings.frame_start, settings.frame_end = frame - 1, frame - 1
        self._scene.frame_set(frame - 1)
        self._scene.frame_set(frame)
        depsgraph = self._scene.view_layers[0].depsgraph
        return [
            (np.concatenate([_velocities(obj.evaluated_get(depsgraph)) for obj in row]) - speed) / SECONDS for speed, row in self._rows
        ]


def _pose(copy: bpy.types.Object, evaluated: bpy.types.Object) -> None:
    """Give a copy the place and the force field settings of the evaluated object."""
    copy.matrix_world = evaluated.matrix_world
    for prop in copy.field.bl_rna.properties:
        if not prop.is_readonly and prop.type != "POINTER":
            value = getattr(evaluated.field, prop.identifier)
            if getattr(copy.field, prop.identifier) != value:
                setattr(copy.field, prop.identifier, value)


def _still_copy(obj: bpy.types.Object) -> bpy.types.Object:
    copy = obj.copy()
    copy.animation_data_clear()
    copy.parent = None
    copy.constraints.clear()
    return copy


def _velocities(evaluated: bpy.types.Object) -> np.ndarray:
    particles = evaluated.particle_systems[0].particles
    if len(particles) != len(evaluated.data.vertices):
        raise UsageError("Blender's particles do not show what the force fields do.", "Switch Force Fields off in the panel Edit.")
    flat = np.empty(3 * len(particles), dtype=np.float32)
    particles.foreach_get("velocity", flat)
    return flat.reshape(-1, 3).astype(np.float64)


@contextlib.contextmanager
def _probes(fields: list[bpy.types.Object], places: np.ndarray, some: np.ndarray | None) -> Iterator[_Probes]:
    """Particles that feel only the force fields: at rest at places (L, 3) and, if `some` is given, moving at these (S, 3) [scene units].

    Everything is removed at the end.
    """
    scene, source = bpy.data.scenes.new("Seeing Wind Probes"), bpy.data.scenes.new("Seeing Wind Force Fields")
    around, copies = bpy.data.collections.new("Seeing Wind Force Fields"), dict[bpy.types.Object, bpy.types.Object]()
    try:
        scene.use_gravity = False
        scene.collection.children.link(around)
        for obj in fields:
            source.collection.objects.link(obj)
            copies[obj] = _still_copy(obj)
            around.objects.link(copies[obj])
        speeds = [(REST, places), *((speed, some) for speed in MOVING if some is not None)]
        rows = [
            (speed, [_let_go(scene, part, speed, around) for part in np.array_split(where, -(-len(where) // MOST))])
            for speed, where in speeds
        ]  # fmt: skip
        yield _Probes(scene, source, copies, rows)
    finally:
        for obj in list(scene.collection.objects):
            mesh, settings = obj.data, obj.particle_systems[0].settings
            bpy.data.objects.remove(obj)
            bpy.data.meshes.remove(mesh)
            bpy.data.particles.remove(settings)
        bpy.data.batch_remove([*copies.values(), around, scene, source])


def _let_go(
    scene: bpy.types.Scene, places: np.ndarray, speed: tuple[float, float, float], around: bpy.types.Collection
) -> bpy.types.Object:
    """An object that emits one particle at each of `places`, all with the velocity `speed`."""
    mesh = bpy.data.meshes.new("Seeing Wind Probes")
    mesh.from_pydata(places.tolist(), [], [])
    obj = bpy.data.objects.new("Seeing Wind Probes", mesh)
    scene.collection.objects.link(obj)
    settings = obj.modifiers.new("Probes", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.emit_from, settings.use_emit_random, settings.lifetime = len(places), "VERT", False, 2.0
    settings.physics_type, settings.integrator, settings.timestep = "NEWTON", "EULER", SECONDS
    settings.mass, settings.normal_factor, settings.object_align_factor = 1.0, 0.0, speed
    settings.drag_factor = settings.damping = settings.brownian_factor = 0.0
    settings.effector_weights.gravity, settings.effector_weights.collection = 0.0, around
    return obj
