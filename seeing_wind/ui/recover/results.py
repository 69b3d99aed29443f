"""Put a take into a scene: field object, arrows, camera with the clip behind it, and recovered object with its motion."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...engine.conventions import UNHELD
from ...engine.errors import SeeingWindError
from ...engine.take import Take
from ..bake.motion import bake_shape_keys
from ..clip.clip_scene import create_recovered_object, setup_clip_scene
from ..clip.inputs.clips import clip_of_take, found_clip, start_of
from ..clip.inputs.pace import pace_of_scene
from ..clip.match import followed, hide_default_cube
from ..field.arrows import create_arrows
from ..field.conform import conform
from ..field.display import is_field
from ..field.field_object import create_field_object
from ..field.legend import create_legend
from ..field.samples import samples_of
from ..field.solvers import physics_nodes
from ..field.solvers.apart import keep_apart
from ..job import status, takes
from ..job.panel_words import in_panel_words, in_scene_frames
from ..job.take_reading import FieldSummary, Seen, WindTold, field_summary, read_seen, recovery_notes, wind_told
from ..scene_units import metres_per_unit
from ..user_paths import absolute
from .fill import fill
from .renew_in_place import can_renew, discard, renew, tidy
from .request import RecoverRequest
from .sampling import Places, Sampled, places, read_answer
from .shown import LEGEND, POINTERS, SAMPLES_OBJECT, made_before

COLLECTION = "Seeing Wind"
LOADED = "loaded"
"""Stands in for the digest of results whose settings the scene does not have."""


def notes(scene: bpy.types.Scene, folder: Path) -> list[str]:
    """Notes on the recovery in `folder`, which the scene shows: the recovery's own notes, worst first, without the verdict on its wind (a
    property of the scene holds that), then the scene's warnings."""
    take = Take(folder)
    told, frame_of = wind_told(take), pace_of_scene(scene).frame_of
    own = [note for note in recovery_notes(take) if told is None or note not in told.notes]
    first = field_summary(take).first_frame if own else 0
    own = [in_panel_words(in_scene_frames(note, frame_of, first)) for note in own]
    return own + status.of(scene.session_uid).warnings


def build(scene: bpy.types.Scene, folder: Path, clip: str = "") -> bool:
    """Put the results of a take into `scene`, reusing the objects of a former run (see `renew_in_place`).

    Args:
        scene: changed in place; for the settings that change see `clip_scene.setup_clip_scene`.
        folder: of the take, whose field was sampled before (`sampling`).
        clip: path of the video; by default found by `clip_of_take`.

    Returns:
        Whether the scene's settings now equal those of the take, see `fill`.

    Raises:
        TakeError: when the take is incomplete; the scene is then unchanged.
        ClipError: when Blender cannot read the clip; the scene is then unchanged.
    """
    settings, take = scene.seeing_wind, Take(folder)
    field, where, told = field_summary(take), places(take), wind_told(take)
    blown = told if told is not None and told.is_wind else None
    sampled = read_answer(take, where, field.frames, blown is not None)
    seen = read_seen(take, field)
    path = "" if seen is None else clip or clip_of_take(settings, field.clip, folder)
    if seen is not None:
        _show_clip(scene, path, field, seen)
    _leave_to_others(settings)
    _keep_other_take(settings, folder)
    former, followers, groups = made_before(settings), physics_nodes.companions(settings.field_object), _groups(settings.recovered_object)
    collection = collection_of(scene, settings.field_object)
    made = _objects(scene, folder, field, where, sampled, blown, collection)
    if seen is not None and seen.surface is not None:
        made["recovered_object"] = _recovered(scene, seen, field.fps, collection)
    kept = _in_place(scene, former, made)
    for name in POINTERS:
        setattr(settings, name, kept.get(name))
    if settings.real_time:
        conform(scene, settings.field_object, True)
    frame_of, said = pace_of_scene(scene).frame_of, told.notes if told is not None else ()
    settings.field_verdict = " ".join(in_panel_words(in_scene_frames(note, frame_of, field.first_frame)) for note in said)
    settings.answers_gravity = any(note.startswith(UNHELD) for note in recovery_notes(take))
    filled = seen is not None and fill(scene, take, path)
    _clear_the_view(scene)
    physics_nodes.follow(followers, settings.field_object)
    keep_apart(scene)
    if settings.recovered_object is not None:
        _restore_groups(settings.recovered_object, groups)
    return filled


def _show_clip(scene: bpy.types.Scene, path: str, field: FieldSummary, seen: Seen) -> None:
    """Set up the take's camera with the video at `path` behind it.

    Raises:
        ClipError: when Blender cannot read the clip.
    """
    settings = scene.seeing_wind
    known = found_clip(path, scene)
    if known is not None:
        settings.frame_start = start_of(known, field.first_frame, settings.frame_start)
    _forget_deleted_camera(settings)
    settings.camera_object = setup_clip_scene(
        scene, path, vars(seen.camera), field.fps, field.first_frame, field.frames, settings.frame_start, followed(scene)
    )


def _objects(
    scene: bpy.types.Scene,
    folder: Path,
    field: FieldSummary,
    where: Places,
    sampled: Sampled,
    blown: WindTold | None,
    collection: bpy.types.Collection,
) -> dict[str, bpy.types.Object]:
    """The field object, its samples, its arrows and their legend, by the names of `POINTERS`."""
    settings = scene.seeing_wind
    wind = create_field_object(
        scene, "Recovered Wind", sampled.nodes, fps=field.fps, density=field.density,
        frame_start=settings.frame_start, reach=settings.own_reach, take=folder,
        kind=settings.own_kind, speeds=(blown.mean, blown.gust) if blown else (0.0, 0.0), drag=blown.drag if blown else 0.0,
        collection=collection,
    )  # fmt: skip
    standing = np.broadcast_to(where.arrows, (field.frames, *where.arrows.shape))
    arrows = create_arrows(
        scene, "Recovered Wind Arrows", np.concatenate([standing, where.riding], axis=1), sampled.arrows, sampled.sure,
        settings.frame_start, parent=wind, collection=collection, units="N/m³" if blown is None else "m/s", distance=sampled.away,
    )  # fmt: skip
    low, high = field.box / metres_per_unit(scene)
    # far enough left that its plate hides no part of the field
    aside = low - [0.28 * (high - low).max(), 0.0, 0.0]
    legend = create_legend(
        "Recovered Wind Legend", arrows["seeing_wind_peak"], arrows["seeing_wind_units"], aside, 0.4 * float((high - low).max()),
        collection, wind,
    )  # fmt: skip
    return {"field_object": wind, SAMPLES_OBJECT: samples_of(wind), "arrows_object": arrows, LEGEND: legend}


def digest_of_loaded(scene: bpy.types.Scene, filled: bool) -> str:
    """Digest for a loaded take: that of the scene's settings if they were `filled` from the take, else `LOADED`."""
    if not filled:
        return LOADED
    try:
        return RecoverRequest.of(scene).digest()
    except SeeingWindError:  # the panel shows what is missing
        return LOADED


def _in_place(
    scene: bpy.types.Scene, former: dict[str, bpy.types.Object], made: dict[str, bpy.types.Object]
) -> dict[str, bpy.types.Object]:
    """Put new results into the objects of a former run. Objects that cannot take them, or have no counterpart, are removed."""
    kept, called_now = {}, made["field_object"].name
    for name, new in made.items():
        old = former.pop(name, None)
        if old is not None and not can_renew(old, scene):
            former[name], old = old, None
        kept[name] = renew(old, new) if old is not None else new
    for name, obj in former.items():
        for child in obj.children:
            child.parent = None
        called = obj.name
        discard(obj)
        if name in kept:  # an object that the user deleted held its name until now
            kept[name].name = called
    tidy(kept, called_now)
    return kept


def _forget_deleted_camera(settings: bpy.types.PropertyGroup) -> None:
    """Remove the camera if the user deleted it from all scenes: the settings' pointer still keeps it, and its name, alive."""
    camera = settings.camera_object
    if camera is not None and not camera.users_scene and camera.library is None:
        data = camera.data
        bpy.data.objects.remove(camera)
        if data.users == 0:
            bpy.data.cameras.remove(data)


def _leave_to_others(settings: bpy.types.PropertyGroup) -> None:
    """Leave result objects that a copied scene shares with its original to the original."""
    scene, names = settings.id_data, POINTERS
    others = [other for other in bpy.data.scenes if other != scene]
    theirs = {getattr(other.seeing_wind, name) for other in others for name in names}
    shared = [name for name in names if getattr(settings, name) is not None and getattr(settings, name) in theirs]
    for name in shared:
        setattr(settings, name, None)
    if shared:
        held = {collection for other in others for collection in other.collection.children_recursive}
        for collection in [each for each in scene.collection.children if each.get("seeing_wind") and each in held]:
            scene.collection.children.unlink(collection)


def _keep_other_take(settings: bpy.types.PropertyGroup, folder: Path) -> None:
    """Keep a former field, with its results, beside the new one if it is from another take that still exists, or from no take."""
    field = settings.field_object
    if field is None:
        return
    called = field.name
    if not takes.shows_lone(settings):
        if not field.get("seeing_wind_take"):
            return
        other = Path(absolute(field["seeing_wind_take"]))
        if other.resolve() == folder.resolve() or not (other / "field.safetensors").is_file():
            return
        called = f"{field.name} of {other.name}"
    for name in POINTERS:
        setattr(settings, name, None)
    status.of(settings.id_data.session_uid).warnings.append(
        f"{called} stays: solvers feel both winds until you delete one, set its strength to 0, or calibrate with "
        "Only This Wind"
    )


def _recovered(scene: bpy.types.Scene, seen: Seen, fps: float, collection: bpy.types.Collection) -> bpy.types.Object:
    surface = seen.surface
    obj = create_recovered_object(
        scene, "Recovered Object", surface.vertices, surface.triangles, surface.uv, seen.frame, collection, seen.outline
    )
    bake_shape_keys(obj, seen.motion, scene.seeing_wind.frame_start, fps, scene)
    return obj


def _clear_the_view(scene: bpy.types.Scene) -> None:
    """Hide the default cube in front of the results, and switch Solid views of this scene to vertex colors."""
    hidden = hide_default_cube(scene)
    if hidden:
        status.of(scene.session_uid).warnings.append(hidden)
    for window in bpy.context.window_manager.windows:
        spaces = [area.spaces.active for area in window.screen.areas if area.type == "VIEW_3D"] if window.scene == scene else []
        for space in spaces:
            if space.shading.type == "SOLID" and space.shading.color_type == "MATERIAL":
                space.shading.color_type = "VERTEX"


def _groups(obj: bpy.types.Object | None) -> tuple[int, dict[str, list[tuple[int, float]]]]:
    """Vertex groups that the user made on the recovered object: number of vertices of the mesh, and indices and weights per group."""
    if obj is None:
        return 0, {}
    members: dict[str, list[tuple[int, float]]] = {group.name: [] for group in obj.vertex_groups}
    names = [group.name for group in obj.vertex_groups]
    for vertex in obj.data.vertices:
        for element in vertex.groups:
            members[names[element.group]].append((vertex.index, element.weight))
    return len(obj.data.vertices), members


def _restore_groups(obj: bpy.types.Object, former: tuple[int, dict[str, list[tuple[int, float]]]]) -> None:
    """Restore the vertex groups of `_groups`; not on a mesh with another vertex count, whose indices mean other vertices."""
    count, members = former
    for name, weighted in members.items() if count == len(obj.data.vertices) else ():
        group = obj.vertex_groups.new(name=name)
        for index, weight in weighted:
            group.add([index], weight, "REPLACE")


def collection_of(scene: bpy.types.Scene, field: bpy.types.Object | None) -> bpy.types.Collection:
    """The collection for results: the one that holds `field`; without a field, one of ours that holds no field; else a new one."""
    ours = [each for each in scene.collection.children_recursive if each.get("seeing_wind")]
    if field is not None and field.users_scene:
        collection = next((each for each in ours if field.name in each.objects), None)
    else:
        collection = next((each for each in ours if not any(is_field(obj) for obj in each.objects)), None)
    if collection is None:
        collection = bpy.data.collections.new(COLLECTION)
        collection["seeing_wind"] = True
        scene.collection.children.link(collection)
    return collection
