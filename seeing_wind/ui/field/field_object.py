"""The recovered force field as one native Blender force field object.

A mesh of vertices only with a WIND field of shape *Every Point*: a source near each lattice node, two vertices per source, whose
directions (attribute `custom_normal`) and falloff together carry the field, see `field_kernels`. A Geometry Nodes modifier picks the
current frame's directions, so the field changes with time without handlers or keyframes, follows the object when it is moved or turned,
and is saved with the file.

What a native solver feels of it depends on the solver; `field_calibration` sets each object's weights so that matter of density rho
accelerates by f / rho. For Geometry Nodes, `samples` keeps the field's values in a hidden child.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...engine.errors import UsageError
from ..scene_units import metres_per_unit
from .kernels import choose_power, evaluate, fit_nodes, halved, lattice_counts, paired_directions, source_places
from .node_groups import GroupBuilder, points_of_current_frame, set_up_modifier
from .samples import create_samples, sample_wind_group

DIRECTION = "custom_normal"
"""The attribute that Blender 4.5 and later take a mesh's normals from."""

SOLVER_DELAY = 1
"""Blender's solvers step *to* a frame with the effectors as they are *at* that frame, and the recovered force is held from picture t to
picture t + 1: so the force of interval t must stand at the scene frame of picture t + 1."""

DENSE = 7
"""A lattice of fewer nodes than this per side is halved for Geometry Nodes, which interpolate linearly between the values."""


def create_field_object(
    scene: bpy.types.Scene,
    name: str,
    nodes: np.ndarray,
    vectors: np.ndarray,
    *,
    fps: float,
    density: float,
    frame_start: int = 1,
    probes: np.ndarray | None = None,
    probe_vectors: np.ndarray | None = None,
    confidence: np.ndarray | None = None,
    take: str | Path = "",
    collection: bpy.types.Collection | None = None,
) -> bpy.types.Object:
    """Make the force field object of a sampled field and link it to the scene.

    Args:
        scene: its length unit is respected.
        nodes: (M, 3) where the field is known [m, world], a lattice as `field_kernels.lattice` gives them; a source stands near each.
        vectors: (T, M, 3) the field there [N/m³]; row t acts from picture t to picture t + 1.
        fps: frames per second of the clip; one scene frame is one picture.
        density: of the recovered material [kg/m³], the default of a calibration.
        frame_start: scene frame of picture 0.
        probes: (P, 3) further places [m] where the field is known, for a better fit between the nodes.
        probe_vectors: (T, P, 3) [N/m³].
        confidence: (T, M) in 0..1 at the nodes, for Geometry Nodes; None: all are sure.
        take: folder of the take, kept on the object.
        collection: where to link it, by default the scene's own collection.

    Returns:
        The object, its origin in the middle of the nodes. Move and turn it freely; a change of scale is locked, as it would change the
        field's falloff and not its strength.

    Raises:
        UsageError: when arrays do not agree, are not finite, or a number is out of range.
    """
    counts = _check(nodes, vectors, fps, density, probes, probe_vectors)
    unit = metres_per_unit(scene)
    nodes, points, samples = np.asarray(nodes, dtype=np.float64) / unit, np.asarray(nodes, dtype=np.float64) / unit, np.asarray(vectors)
    if probes is not None and probe_vectors is not None:
        points, samples = np.concatenate([points, np.asarray(probes) / unit]), np.concatenate([samples, probe_vectors], axis=1)
    power = choose_power(nodes)
    # forces in scene units too, so that f / rho comes out in scene units per square second
    standing = source_places(nodes)
    sources = fit_nodes(standing, points, samples / unit, power)
    strength = 0.5 * float(np.linalg.norm(sources, axis=-1).max()) or 1.0

    centre = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0))
    obj = bpy.data.objects.new(name, _mesh(name, standing - centre, paired_directions(sources, strength)))
    obj.location = centre
    obj.lock_scale = (True, True, True)
    (collection or scene.collection).objects.link(obj)
    # an object has no field settings until this operator gave it some
    with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0], object=obj, active_object=obj):
        bpy.ops.object.forcefield_toggle()
    _set_field(obj.field, strength, power)
    group = GroupBuilder(f"{name} Frames")
    set_up_modifier(obj, group.finish(points_of_current_frame(group, 2 * len(nodes), len(sources), frame_start, SOLVER_DELAY)))
    properties = {
        "take": str(take),
        "density": float(density),
        "fps": float(fps),
        "frame_start": frame_start,
        "frames": len(sources),
        "units": "N/m3",
        "strength": strength,
    }
    for key, value in properties.items():
        obj[f"seeing_wind_{key}"] = value
    sure = np.ones((len(samples), len(nodes), 1)) if confidence is None else np.asarray(confidence)[..., None]
    places = nodes - centre
    if max(counts) <= DENSE:
        places, sure = halved(counts, places[None])[0], halved(counts, sure)
        counts = (2 * counts[0] - 1, 2 * counts[1] - 1, 2 * counts[2] - 1)
    values = evaluate(standing, sources, places + centre, power)
    samples = create_samples(scene, obj, counts, places, values, sure[..., 0], frame_start, SOLVER_DELAY)
    sample_wind_group(samples, density)
    return obj


def _check(
    nodes: np.ndarray, vectors: np.ndarray, fps: float, density: float, probes: np.ndarray | None, probe_vectors: np.ndarray | None
) -> tuple[int, int, int]:
    """Refuse arrays that do not agree; returns the lattice's counts."""
    shape = np.shape(vectors)
    if len(shape) != 3 or shape[0] < 1 or shape[1] < 2 or shape[1:] != np.shape(nodes):
        raise UsageError(
            f"The field's samples have the shape {shape} for nodes of the shape {np.shape(nodes)}.", "Expected (T, M, 3) for (M, 3)."
        )
    if (probes is None) != (probe_vectors is None) or (probes is not None and np.shape(probe_vectors) != (shape[0], len(probes), 3)):
        raise UsageError(f"The probes' samples have the shape {np.shape(probe_vectors)}.", "Expected (T, P, 3) for (P, 3) probes.")
    if not (np.isfinite(vectors).all() and (probe_vectors is None or np.isfinite(probe_vectors).all())):
        raise UsageError("The sampled field is not finite everywhere.", "Recover it again.")
    if not (fps > 0.0 and density > 0.0):
        raise UsageError(f"Frame rate {fps:g} and density {density:g} must be above zero.", "Correct the settings of the take.")
    try:
        return lattice_counts(np.asarray(nodes, dtype=np.float64))
    except ValueError as error:
        raise UsageError("The nodes do not fill a lattice.", "Use nodes as `field_kernels.lattice` gives them.") from error


def _mesh(name: str, nodes: np.ndarray, directions: np.ndarray) -> bpy.types.Mesh:
    """All frames of the sources, (M, 3) nodes and (T, 2M, 3) directions, as T * 2M vertices."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(directions.shape[0] * directions.shape[1])
    positions = np.tile(np.repeat(nodes, 2, axis=0), (len(directions), 1))
    mesh.vertices.foreach_set("co", positions.astype(np.float32).ravel())
    attribute = mesh.attributes.new(DIRECTION, "FLOAT_VECTOR", "POINT")
    attribute.data.foreach_set("vector", directions.astype(np.float32).ravel())
    mesh.update()
    return mesh


def _set_field(field: bpy.types.FieldSettings, strength: float, power: float) -> None:
    field.type = "WIND"
    field.shape = "POINTS"
    field.strength = strength
    field.falloff_type = "SPHERE"
    field.falloff_power = power
    field.use_min_distance = field.use_max_distance = False
    field.flow = field.wind_factor = field.noise = 0.0
    field.use_absorption = False
    field.apply_to_location, field.apply_to_rotation = True, False
