"""The recovered force field as one native Blender force field object.

A mesh of vertices only with a WIND field of shape *Every Point*: a source near each lattice node, two vertices per source, whose
directions (attribute `custom_normal`) and falloff together carry the field, see `fit`. A field with a wind carries its velocity instead,
pushes faces (*Wind Factor*) and slows what moves in it (*Flow*), unless solvers are to feel the force.

A Geometry Nodes modifier picks the current
frame's directions, so the field changes with time without handlers or keyframes, follows the object when it is moved or turned, and is
saved with the file.

What a native solver feels of it depends on the solver; `solvers` sets each object's weights so that matter of density rho accelerates by
f / rho. The field's own values are kept in a hidden child (`samples`): for Geometry Nodes, for exports, and to fit the sources again.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...engine.errors import UsageError
from ..scene_units import metres_per_unit
from .display import CARRIED, DRAG, FLOW, FORCE, KIND, LINEAR, SPEEDS, WIND, has_wind, share, stride_of
from .fit.choose import FADE, FieldFit, fit_field
from .fit.kernels import paired_directions
from .fit.lattice import SampledField
from .node_groups import FRAMES_PER_PICTURE, GroupBuilder, get_input, points_of_current_frame, set_input, set_up_modifier
from .samples import create_samples, read_samples, sample_wind_group, samples_of, set_reach

DIRECTION = "custom_normal"
"""The attribute that Blender 4.5 and later take a mesh's normals from."""

SOLVER_DELAY = 1
"""Blender's solvers step *to* a frame with the effectors as they are *at* that frame, and the recovered force is held from picture t to
picture t + 1: so the force of interval t must stand at the scene frame of picture t + 1."""


def create_field_object(
    scene: bpy.types.Scene,
    name: str,
    sampled: SampledField,
    *,
    fps: float,
    density: float,
    frame_start: int = 1,
    resolution: int = 0,
    reach: str = FADE,
    take: str | Path = "",
    kind: str = FORCE,
    speeds: tuple[float, float] = (0.0, 0.0),
    drag: float = 0.0,
    collection: bpy.types.Collection | None = None,
) -> bpy.types.Object:
    """Make the force field object of a sampled field and link it to the scene.

    Args:
        scene: its length unit is respected.
        sampled: the field [m, N/m³]; row t acts from picture t to picture t + 1.
        fps: frames per second of the clip; one scene frame is one picture.
        density: of the recovered material [kg/m³], the default of a calibration.
        frame_start: scene frame of picture 0.
        resolution, reach: see `fit_field`.
        take: folder of the take, kept on the object.
        kind: WIND lets solvers feel the wind of a field that has one, FORCE the force.
        speeds: of that wind, its mean and its strongest gust [m/s].
        drag: pressure on a plate across it over the square of the speed [kg/m³].
        collection: where to link it, by default the scene's own collection.

    Returns:
        The object, its origin in the middle of the box. Move and turn it freely; a change of scale is locked, as it would change the
        field's falloff and not its strength.

    Raises:
        UsageError: when a number is out of range.
    """
    if not (fps > 0.0 and density > 0.0):
        raise UsageError(f"Frame rate {fps:g} and density {density:g} must be above zero.", "Correct the settings of the take.")
    unit, centre = metres_per_unit(scene), sampled.box.mean(axis=0)
    # forces in scene units too, so that f / rho comes out in scene units per square second
    wind = None if sampled.velocity is None else sampled.velocity / unit
    local = SampledField((sampled.points - centre) / unit, sampled.force / unit, sampled.confidence, wind)
    kind = kind if wind is not None else FORCE
    fit = fit_field(local.felt_as(kind), resolution, reach)
    obj = bpy.data.objects.new(name, _mesh(name, fit))
    obj.location = centre / unit
    obj.lock_scale = (True, True, True)
    # its sources are drawn as black dots in front of everything otherwise
    obj.display_type = "BOUNDS"
    (collection or scene.collection).objects.link(obj)
    # an object has no field settings until this operator gave it some
    with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0], object=obj, active_object=obj):
        bpy.ops.object.forcefield_toggle()
    _set_field(obj.field)
    properties = {
        "take": str(take),
        "density": float(density),
        "fps": float(fps),
        "frame_start": frame_start,
        "frames": len(fit.vectors),
        "stride": 1.0,
    }
    for key, value in properties.items():
        obj[f"seeing_wind_{key}"] = value
    if sampled.velocity is not None:
        obj[SPEEDS], obj[DRAG], obj[LINEAR] = speeds, drag, linear_drag(sampled.velocity)
    _blow(obj, fit, reach, kind)
    _show_frames(obj, fit, frame_start)
    samples = create_samples(obj, local.thinned(), frame_start, SOLVER_DELAY)
    set_reach(samples, reach, fit.power)
    # so that appending or linking the field brings its values along: Blender follows pointers, not children
    obj[CARRIED] = samples
    sample_wind_group(samples, density)
    return obj


def fit_again(field: bpy.types.Object, resolution: int, reach: str, kind: str = FORCE) -> FieldFit:
    """Fit the sources of a field object anew to the values that it carries: it needs neither the take nor the engine.

    Its place, the user's strength relative to the recovered one, and all that points at it stay.

    Raises:
        UsageError: when its values are gone, or it is linked from another file.
    """
    samples = samples_of(field)
    if samples is None:
        raise UsageError(f"The values under {field.name} are gone.", "Load the results again (Reload in the Recover panel).")
    if field.library is not None or field.data.library is not None:
        raise UsageError(f"{field.name} is linked from another file.", "Fit it there, or append it here.")
    kind = kind if has_wind(field) else FORCE
    fit = fit_field(read_samples(samples).felt_as(kind), resolution, reach)
    factor, first = share(field), int(field["seeing_wind_frame_start"])
    former, field.data = field.data, _mesh(field.data.name, fit)
    if former.users == 0:
        name = former.name
        bpy.data.meshes.remove(former)
        field.data.name = name
    for modifier in [each for each in field.modifiers if each.type == "NODES" and FRAMES in each.name]:
        tree, first = modifier.node_group, int(get_input(modifier, "First Frame") or first)
        field.modifiers.remove(modifier)
        if tree is not None and tree.users == 0:
            bpy.data.node_groups.remove(tree)
    _blow(field, fit, reach, kind)
    field.field.strength *= factor
    set_input(_show_frames(field, fit, first), FRAMES_PER_PICTURE, stride_of(field))
    set_reach(samples, reach, fit.power)
    return fit


FRAMES = "Frames"
"""In the name of the modifier that picks the current frame."""


def _show_frames(obj: bpy.types.Object, fit: FieldFit, frame_start: int) -> bpy.types.Modifier:
    """The modifier that leaves only the current frame's sources."""
    group = GroupBuilder(f"{obj.name} {FRAMES}")
    current = points_of_current_frame(group, 2 * len(fit.places), len(fit.vectors), frame_start, SOLVER_DELAY)
    return set_up_modifier(obj, group.finish(current))


def linear_drag(velocity: np.ndarray) -> tuple[float, float]:
    """Where a drag that is linear in the speed comes nearest to the real one, which is quadratic, on a body that stands still.

    Args:
        velocity: of the air (T, L, 3) [m/s].

    Returns:
        The speed at which both are the same [m/s], and the root mean square of the difference over that of the real drag.
    """
    speed = np.linalg.norm(velocity, axis=-1)
    if not (speed > 0.0).any():
        return 0.0, 0.0
    best = float((speed**3).sum() / (speed**2).sum())
    return best, float(np.sqrt(((speed * (speed - best)) ** 2).sum() / (speed**4).sum()))


def _strength(fit: FieldFit) -> float:
    """Of the whole object, so that two unit vectors can encode its strongest source."""
    return 0.5 * float(np.linalg.norm(fit.vectors, axis=-1).max()) or 1.0


def _mesh(name: str, fit: FieldFit) -> bpy.types.Mesh:
    """All frames of the sources as T * 2M vertices."""
    directions = paired_directions(fit.vectors, _strength(fit))
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(directions.shape[0] * directions.shape[1])
    positions = np.tile(np.repeat(fit.places, 2, axis=0), (len(directions), 1))
    mesh.vertices.foreach_set("co", positions.astype(np.float32).ravel())
    attribute = mesh.attributes.new(DIRECTION, "FLOAT_VECTOR", "POINT")
    attribute.data.foreach_set("vector", directions.astype(np.float32).ravel())
    mesh.update()
    return mesh


def _blow(obj: bpy.types.Object, fit: FieldFit, reach: str, kind: str) -> None:
    """Strength, falloff and flow of a fit, and what the panel says of it."""
    obj.field.strength, obj.field.falloff_power = _strength(fit), fit.power
    obj["seeing_wind_strength"] = obj.field.strength
    obj["seeing_wind_nodes"], obj["seeing_wind_reach"] = fit.resolution, reach
    obj["seeing_wind_error"], obj[KIND], obj["seeing_wind_units"] = [fit.angle, fit.size], kind, "m/s" if kind == WIND else "N/m3"
    obj[FLOW] = [0.5 / fit.reach, fit.unevenness]  # half, as every source is two vertices
    obj.field.flow, obj.field.wind_factor = (obj[FLOW][0], 1.0) if kind == WIND else (0.0, 0.0)


def _set_field(field: bpy.types.FieldSettings) -> None:
    field.type = "WIND"
    field.shape = "POINTS"
    field.falloff_type = "SPHERE"
    field.use_min_distance = field.use_max_distance = False
    field.noise = 0.0
    field.use_absorption = False
    field.apply_to_location, field.apply_to_rotation = True, False
