"""The recovered force field as one native Blender force field object.

Its force field is of the type *Texture*: a texture that holds the whole lattice of all frames, see `texture`. So a solver finds the
force at a place by one look-up, however many nodes the lattice has. A field with a wind carries its velocity instead and pushes faces
(*Wind Factor*), unless solvers are to feel the force; what moves in it is slowed by a companion, see `solvers.in_wind`.

The texture follows the current frame and the object's rotation without handlers or keyframes, and is saved with the file. The object's mesh
is its box.

What a native solver feels of it depends on the solver; `solvers` sets each object's weights so that matter of density rho accelerates by
f / rho. The field's own values are kept in a hidden child (`samples`): for Geometry Nodes, for exports, and to make the texture again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...engine.errors import UsageError
from ..scene_units import METRES, metres_per_unit
from .arrows import show_reach
from .display import BLOWS, CARRIED, DRAG, FORCE, KIND, LINEAR, LOOP, NODES, SPEEDS, STRIDE, SURE, WIND, has_wind, share
from .lattice import SampledField
from .node_groups import GroupBuilder, set_up_modifier
from .samples import create_samples, read_samples, sample_wind_group, samples_of, set_reach
from .texture.atlas import make_atlas
from .texture.followers import COLOR, Followers, make_followers
from .texture.reach import FADE, reach_of
from .texture.tree import make_texture, remove_texture

SOLVER_DELAY = 1
"""Blender's solvers step *to* a frame with the effectors as they are *at* that frame, and the recovered force is held from clip frame t to
clip frame t + 1: so the force of interval t must stand at the scene frame of clip frame t + 1."""

FRAMES, AGAIN = "Frames", "Turned"
"""In the name of the modifier that lets solvers wait for the texture."""


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
        reach: what becomes of it away from the filmed object and beside the box, see `texture.reach`.
        take: folder of the take, kept on the object.
        kind: WIND lets solvers feel the wind of a field that has one, FORCE the force.
        speeds: of that wind, its mean and its strongest gust [m/s].
        drag: pressure on a plate across it over the square of the speed [kg/m³].
        loops: its first frame follows its last, else the last one stays.
        collection: where to link it, by default the scene's own collection.

    Returns:
        The object, its origin in the middle of the box. Move and turn it freely; a change of scale is locked, as it would change the
        field's size and not its strength.

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
    # an object has no field settings until this operator gave it some
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
    """Make the texture of a field object anew from the values that it carries: it needs neither the take nor the engine.

    Its place, the user's strength relative to the recovered one, and all that points at it stay.

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


def turn_override(field: bpy.types.Object) -> None:
    """Give a library override of a field a texture in this file, which turns with it; that of the library turns with the linked original.

    Its values stay in the library, its place and strength are the override's own.

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


def _box(name: str, box: np.ndarray) -> bpy.types.Mesh:
    """The edges of a box (2, 3)."""
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    edges = [(a, b) for a in range(8) for b in range(a) if sum(u != v for u, v in zip(corners[a], corners[b], strict=True)) == 1]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([[float(box[k][axis]) for axis, k in enumerate(corner)] for corner in corners], edges, [])
    return mesh


def _blow(obj: bpy.types.Object, sampled: SampledField, reach: str, kind: str) -> None:
    """Texture and strength of a field, and what the panel says of it."""
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
    """The modifier that leaves one vertex, at which the force field stands, and shows the box.

    Blender lets solvers wait for the geometry of a field that stands at points, not for textures that its texture shows. So the vertex
    depends on these, and stays where it is.
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
    """Output of a node: 0, known only once the followers are."""
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
