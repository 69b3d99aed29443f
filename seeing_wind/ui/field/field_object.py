"""The recovered force field as one native Blender force field object.

The force field is of type *Texture*: its texture holds the whole lattice for all frames, see `texture`, so that a solver finds the force
at a point by one look-up, however many nodes the lattice has. For a field with a wind, the texture holds the velocity instead and pushes
faces (*Wind Factor*), unless solvers are to feel the force; a companion object slows what moves in it, see `solvers.in_wind`.

The texture follows the current frame and the object's rotation without handlers or keyframes, and is saved with the file. The object's mesh
is its box.

Each native solver applies the field in its own way; `solvers` sets each object's weights so that matter of density rho accelerates by
f / rho. The field's own values are kept in a hidden child (`samples`): for Geometry Nodes, for exports, and for making the texture anew.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...engine.errors import UsageError
from ..scene_units import METRES, SAME, metres_per_unit, unit_of
from .arrows import show_reach
from .display import BLOWS, CARRIED, DRAG, FORCE, KIND, LINEAR, LOOP, NODES, SPEEDS, STRIDE, SURE, WIND, has_wind, share
from .lattice import SampledField
from .node_groups import GroupBuilder, set_up_modifier
from .samples import create_samples, read_samples, sample_wind_group, samples_of, scale_samples, set_reach
from .texture.atlas import make_atlas
from .texture.followers import COLOR, Followers, make_followers
from .texture.reach import FADE, reach_of
from .texture.tree import make_texture, remove_texture

SOLVER_DELAY = 1
"""Blender's solvers step *to* a frame with the effectors as they are *at* that frame, and the recovered force is constant from clip frame t
to t + 1: so the force of interval t must be present at the scene frame of clip frame t + 1."""

FRAMES, AGAIN = "Frames", "Turned"
"""Parts of the names of the modifiers that make solvers wait for the texture: of a field, and of a turned library override."""


def create_field_object(
    scene: bpy.types.Scene,
    name: str,
    sampled: SampledField,
    *,
    fps: float,
    density: float,
    frame_start: int = 1,
    reach: str = FADE,
    take: str | Path = "",
    kind: str = FORCE,
    speeds: tuple[float, float] = (0.0, 0.0),
    drag: float = 0.0,
    loops: bool = False,
    collection: bpy.types.Collection | None = None,
) -> bpy.types.Object:
    """Make the force field object of a sampled field and link it to the scene.

    Args:
        scene: its length unit is respected.
        sampled: the field [m, N/m³]; row t acts from frame t to frame t + 1.
        fps: frames per second of the clip; one scene frame is one clip frame.
        density: of the recovered material [kg/m³], the default of a calibration.
        frame_start: scene frame of clip frame 0.
        reach: how the field behaves away from the filmed object and outside the box, see `texture.reach`.
        take: folder of the take, kept on the object.
        kind: WIND makes solvers feel the wind of a field that has one, FORCE the force.
        speeds: mean and strongest gust of that wind [m/s].
        drag: pressure on a plate across the wind over the square of the speed [kg/m³].
        loops: whether the first frame follows the last; otherwise the last one persists.
        collection: where to link it, by default the scene's own collection.

    Returns:
        The object, with its origin in the middle of the box. It can be moved and turned freely; its scale is locked, as scaling would
        change the field's size but not its strength.

    Raises:
        UsageError: when a number is out of range.
    """
    if not (fps > 0.0 and density > 0.0):
        raise UsageError(f"Frame rate {fps:g} and density {density:g} must be above zero.", "Correct the settings of the take.")
    unit, centre = metres_per_unit(scene), sampled.box.mean(axis=0)
    # forces in scene units too, so that f / rho comes out in scene units per square second
    wind = None if sampled.velocity is None else sampled.velocity / unit
    away = None if sampled.distance is None else sampled.distance / unit
    local = SampledField((sampled.points - centre) / unit, sampled.force / unit, sampled.confidence, wind, away).thinned()
    obj = bpy.data.objects.new(name, _box(name, local.box))
    obj.location = centre / unit
    obj.lock_scale = (True, True, True)
    obj.display_type = "WIRE"
    (collection or scene.collection).objects.link(obj)
    # an object has no field settings until this operator creates them
    with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0], object=obj, active_object=obj):
        bpy.ops.object.forcefield_toggle()
    _set_field(obj.field)
    properties = {"take": str(take), "density": float(density), "fps": float(fps), "frame_start": frame_start, "frames": len(local.force)}
    for key, value in properties.items():
        obj[f"seeing_wind_{key}"] = value
    obj[STRIDE], obj[LOOP], obj[METRES] = 1.0, loops, unit
    if sampled.velocity is not None:
        obj[SPEEDS], obj[DRAG], obj[LINEAR] = speeds, drag, linear_drag(sampled.velocity)
    samples = create_samples(obj, local, frame_start, SOLVER_DELAY)
    # so that appending or linking the field brings its values along: Blender follows pointers, not children
    obj[CARRIED] = samples
    _blow(obj, local, reach, kind)
    sample_wind_group(samples, density)
    return obj


def make_again(field: bpy.types.Object, reach: str, kind: str = FORCE) -> None:
    """Make the texture of a field object anew from the values that it carries; neither the take nor the engine is needed.

    The object's place, the user's factor on the strength, and all references to the object are kept.

    Raises:
        UsageError: when its values are gone, or it is linked from another file.
    """
    samples = samples_of(field)
    if samples is None:
        raise UsageError(f"The values under {field.name} are gone.", "Load the results again (Reload in the Recover panel).")
    if field.library is not None or field.data.library is not None:
        raise UsageError(f"{field.name} is linked from another file.", "Set it up there, or append it here.")
    factor = share(field)
    for modifier in [each for each in field.modifiers if each.type == "NODES" and FRAMES in each.name]:
        tree = modifier.node_group
        field.modifiers.remove(modifier)
        if tree is not None and tree.users == 0:
            bpy.data.node_groups.remove(tree)
    _blow(field, read_samples(samples), reach, kind)
    field.field.strength *= factor


def convert_unit(field: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Convert a field object that was made for another scene unit to that of `scene`, so that it is the same in metres; its place stays.

    A field object of another file, or that does not know its unit, is left as it is.
    """
    unit, samples = metres_per_unit(scene), samples_of(field)
    factor = (unit_of(field) or unit) / unit
    if abs(factor - 1.0) < SAME or samples is None or any(each.library or each.override_library for each in (field, samples, samples.data)):
        return
    for obj in (field, samples):
        if obj.data.users > 1:  # a copy of the field, which is converted for itself
            obj.data = obj.data.copy()
    for vertex in field.data.vertices:
        vertex.co *= factor
    scale_samples(samples, factor)
    field[METRES] = unit
    make_again(field, field["seeing_wind_reach"], field[KIND])


def turn_override(field: bpy.types.Object) -> None:
    """Give a library override of a field its own texture in this file, which turns with it; the linked one turns with the original.

    The values stay in the library; place and strength are the override's own.

    Raises:
        UsageError: when it is no library override, or its values are gone.
    """
    samples = samples_of(field)
    if field.override_library is None:
        raise UsageError(f"{field.name} is no library override.", "Choose a field that was linked and overridden.")
    if samples is None:
        raise UsageError(f"The values under {field.name} are gone.", "Link it again.")
    sampled = read_samples(samples)
    end = reach_of(field["seeing_wind_reach"], sampled.box)
    felt = sampled.felt_as(field[KIND], end)
    atlas = make_atlas(f"{field.name} Atlas", felt)
    followers = make_followers(field, atlas.frames, atlas.counts[1] * atlas.pixel[1], SOLVER_DELAY)
    former = field.field.texture
    field.field.texture = make_texture(field.name, atlas, felt.box, followers, end)
    remove_texture(former)
    for modifier in [each for each in field.modifiers if each.type == "NODES" and AGAIN in each.name]:
        field.modifiers.remove(modifier)
    group = GroupBuilder(f"{field.name} {AGAIN}")
    place = group.node("ShaderNodeCombineXYZ", {"X": _zero(group, followers)}).outputs[0]
    moved = group.node("GeometryNodeSetPosition", {"Geometry": group.input.outputs["Geometry"], "Offset": place}).outputs[0]
    set_up_modifier(field, group.finish(moved))


def linear_drag(velocity: np.ndarray) -> tuple[float, float]:
    """The linear drag that best fits the real, quadratic drag (least squares) on a body at rest.

    Args:
        velocity: of the air (T, L, 3) [m/s].

    Returns:
        The speed at which both drags agree [m/s], and the root mean square of their difference, relative to that of the real drag.
    """
    speed = np.linalg.norm(velocity, axis=-1)
    if not (speed > 0.0).any():
        return 0.0, 0.0
    best = float((speed**3).sum() / (speed**2).sum())
    return best, float(np.sqrt(((speed * (speed - best)) ** 2).sum() / (speed**4).sum()))


def _box(name: str, box: np.ndarray) -> bpy.types.Mesh:
    """A mesh of the edges of a box (2, 3)."""
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    edges = [(a, b) for a in range(8) for b in range(a) if sum(u != v for u, v in zip(corners[a], corners[b], strict=True)) == 1]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([[float(box[k][axis]) for axis, k in enumerate(corner)] for corner in corners], edges, [])
    return mesh


def _blow(obj: bpy.types.Object, sampled: SampledField, reach: str, kind: str) -> None:
    """Set the texture and strength of a field, and the properties that the panel displays."""
    kind = kind if has_wind(obj) else FORCE
    end = reach_of(reach, sampled.box)
    felt, field, former = sampled.felt_as(kind, end), obj.field, obj.field.texture
    atlas = make_atlas(f"{obj.name} Atlas", felt)
    followers = make_followers(obj, atlas.frames, atlas.counts[1] * atlas.pixel[1], SOLVER_DELAY)
    field.texture = make_texture(obj.name, atlas, felt.box, followers, end)
    remove_texture(former)
    _wait(obj, followers)
    field.strength, field.wind_factor = atlas.strength, float(kind == WIND)
    obj["seeing_wind_strength"], obj["seeing_wind_reach"], obj[NODES] = field.strength, reach, atlas.counts
    obj["seeing_wind_error"], obj[KIND] = felt.error_between_nodes(), kind
    obj[BLOWS], obj["seeing_wind_units"] = float(kind == WIND), "m/s" if kind == WIND else "N/m3"
    set_reach(samples_of(obj), end)
    for arrows in [child for child in obj.children if SURE in child]:
        show_reach(arrows, obj)


def _wait(obj: bpy.types.Object, followers: Followers) -> None:
    """Add the modifier that reduces the mesh to one vertex, at which the force field acts, and curves that show the box.

    Blender makes solvers wait for the geometry of a field of shape *Points*, but not for the textures its texture depends on. So the
    vertex depends on these, without moving.
    """
    group = GroupBuilder(f"{obj.name} {FRAMES}")
    place = group.node("ShaderNodeCombineXYZ", {"X": _zero(group, followers)}).outputs[0]
    vertex = group.node("GeometryNodeMeshLine", {"Count": 1, "Start Location": place}).outputs[0]
    shown = group.node("GeometryNodeMeshToCurve", {"Mesh": group.input.outputs["Geometry"]}).outputs[0]
    joined = group.node("GeometryNodeJoinGeometry")
    for part in (vertex, shown):
        group.tree.links.new(part, joined.inputs[0])
    set_up_modifier(obj, group.finish(joined.outputs[0]))


def _zero(group: GroupBuilder, followers: Followers) -> Any:
    """Output socket of a node whose value is 0, evaluated only after the followers."""
    still = group.tree.nodes.new("ShaderNodeValue")
    driver = still.outputs[0].driver_add("default_value").driver
    for name, texture in zip("abcde", followers.all, strict=True):
        variable = driver.variables.new()
        target = variable.targets[0]
        variable.name, target.id_type, target.id, target.data_path = name, "TEXTURE", texture, f"{COLOR}[0]"
    driver.expression = "0*(a+b+c+d+e)"
    return still.outputs[0]


def _set_field(field: bpy.types.FieldSettings) -> None:
    field.type, field.shape = "TEXTURE", "POINTS"
    field.texture_mode, field.use_object_coords = "RGB", True
    field.falloff_type, field.falloff_power = "SPHERE", 0.0
    field.use_min_distance = field.use_max_distance = False
    field.use_absorption = field.use_2d_force = False
    field.apply_to_location, field.apply_to_rotation = True, False
