"""Names and texts of the field's objects. Without NumPy, as panels are drawn before any of them exists."""

from __future__ import annotations

import importlib.util
import math
from typing import Any

from ...engine.conventions import beaufort, in_figures

ARROWS_MATERIAL = "Seeing Wind Arrows"

SAMPLES_MARK, LEGEND_MARK = "seeing_wind_samples", "seeing_wind_legend"
"""Custom properties of the object with the field's values, and of the arrows' legend."""

CARRIED = "seeing_wind_carried"
"""Custom property of the field object: the object with its values."""


FORCE, WIND = "FORCE", "WIND"
"""Values of a field object's custom property `KIND`: solvers feel a force per volume, or moving air."""

KIND, SPEEDS = "seeing_wind_kind", "seeing_wind_speeds"
"""Custom properties of a field object: what solvers feel, and, only if it has a wind, the mean and the strongest gust [m/s]."""

DRAG, LINEAR = "seeing_wind_drag", "seeing_wind_linear"
"""Custom properties of a field with a wind, see `solvers.in_wind`. DRAG: pressure on a plate across the wind over the square of the speed
[kg/m³]. LINEAR: the speed [m/s] at which Blender's linear drag is right, and its root mean square error relative to the real drag."""

BLOWS = "seeing_wind_blows"
"""Custom property of a field object, for drivers: 1 if solvers feel a wind, else 0."""

NODES = "seeing_wind_nodes"
"""Custom property of a field object: the numbers of nodes of its lattice along x, y and z."""

FELT = "seeing_wind_felt"
"""Custom property of a collection that was made so that solvers feel one kind of field, see `solvers.apart`."""

STRIDE = "seeing_wind_stride"
"""Custom property of a field object: scene frames that a clip frame lasts; 1 unless it was conformed to the scene's frame rate."""


SURE = "seeing_wind_sure"
"""Custom property of the arrows: for each frame, the greatest confidence of any arrow, in 0..1."""

ARROWS = "seeing_wind_arrows"
"""Custom property of a field object from the library: its arrows, which are made in the scene. On the arrows themselves: True."""

WITH_FIELD = "seeing_wind_with_field"
"""Custom property of the object with a field's values: True if it is deleted with the field, as for a copy or a wind from the library."""

SLOWS = "seeing_wind_slows"
"""Custom property of the companion object that slows what moves in a wind: the field object. See `solvers.in_wind`."""

LOOP = "seeing_wind_loop"
"""Custom property of a field object, set by the user: whether its first frame follows its last."""


def said_of_unseen(arrows: Any, asked: float) -> str:
    """Why arrows are drawn in few frames or none; "" if they are drawn in at least half of them.

    Args:
        asked: the confidence below which they are hidden.
    """
    sure = list(arrows.get(SURE, ()))
    shown = sum(each > asked for each in sure)
    if 2 * shown >= len(sure):
        return ""
    why = f"the confidence is {max(sure):.2g} at most, and Min Confidence in the panel Field asks for more than {asked:.2g}"
    return f"Arrows are drawn in {shown or 'none'} of {len(sure)} frames: {why}"


def frames_per_second(scene: Any) -> float:
    """The scene's frame rate."""
    return scene.render.fps / scene.render.fps_base


def stride_of(field: Any) -> float:
    """The number of scene frames that a clip frame of a field lasts."""
    return field[STRIDE]


def blows_from_to(field: Any) -> tuple[int, int]:
    """Scene frames at which a field's first clip frame begins and its last one ends; of a field that loops, those of the first cycle."""
    first = int(field["seeing_wind_frame_start"])
    return first, first + math.ceil(stride_of(field) * field["seeing_wind_frames"] - 1e-6)


def said_of_speed(field: Any, scene: Any) -> str:
    """How much faster or slower than filmed a field plays; "" at the right speed."""
    speed = frames_per_second(scene) / (stride_of(field) * field["seeing_wind_fps"])
    if abs(speed - 1.0) < 1e-3:
        return ""
    rates = f"{field['seeing_wind_fps']:.4g} clip frames and {frames_per_second(scene):.4g} scene frames a second"
    return f"Plays at {speed:.3g} times the speed of the clip ({rates})"


def said_of_pace(stride: float) -> str:
    """How many clip frames are repeated or left out if each lasts `stride` scene frames; "" if that is one."""
    if abs(stride - 1.0) < 1e-3:
        return ""
    if stride > 1.0:
        return f"every scene frame shows the nearest clip frame: {100.0 * (1.0 - 1.0 / stride):.2g} in 100 repeat the one before"
    return f"every scene frame shows the nearest clip frame: {100.0 * (1.0 - stride):.2g} in 100 clip frames are left out"


def said_of_mirror(field: Any) -> str:
    """A warning if a field or a parent of it has a negative scale; else ""."""
    if field.matrix_world.determinant() >= 0.0:
        return ""
    return "Mirrored by a negative scale: solvers feel this wind against its arrows, in the opposite direction. Turn it instead"


def said_of_override(field: Any) -> str:
    """A warning if a field is a rotated library override, whose wind does not turn with it; else ""."""
    linked = field.override_library.reference if field.override_library is not None else None
    texture = field.field.texture
    if linked is None or texture is None or texture.library is None:  # a texture in this file turns with the field
        return ""
    if linked.matrix_world.to_quaternion().rotation_difference(field.matrix_world.to_quaternion()).angle < 1e-3:
        return ""
    return "A library override that is turned: Blender's solvers feel it at its new place, in the old directions"


def has_wind(field: Any) -> bool:
    """Whether a field object carries the velocity of a wind as well as its force."""
    return field is not None and SPEEDS in field


def is_wind(field: Any) -> bool:
    """Whether solvers feel a field object as moving air."""
    return field is not None and field.get(KIND) == WIND


def share(field: Any) -> float:
    """Strength of a field object divided by the recovered strength: the user's factor."""
    return field.field.strength / field.get("seeing_wind_strength", field.field.strength or 1.0)


def in_beaufort(speed: float) -> str:
    """A speed [m/s] as text, with its Beaufort number."""
    return f"{in_figures(speed, 2)} m/s (Beaufort {beaufort(speed)})"


def said_of_wind(field: Any) -> str:
    """Mean and gust speeds of a field's wind at its present strength, as text; "" for a field without a wind."""
    if not has_wind(field):
        return ""
    mean, gust = (in_beaufort(abs(share(field)) * speed) for speed in field[SPEEDS])
    return f"Wind: {mean} in the mean, gusts up to {gust}"


def said_of_fit(field: Any) -> str:
    """Mean difference between what Blender's solvers feel and the recovered field, over its box, as text; "" if not measured."""
    error = field.get("seeing_wind_error")
    if error is None:
        return ""
    what = "wind" if is_wind(field) else "field"
    nodes = " x ".join(f"{count}" for count in field[NODES])
    return f"{nodes} nodes; between them solvers feel about {100.0 * error[1]:.1f} % and {error[0]:.1f}° off the recovered {what}"


def arrows_of(field: Any, scene: Any) -> Any:
    """The arrows that show a field object in a scene; None if there are none."""
    arrows = scene.seeing_wind.arrows_object
    if arrows is None or arrows.parent != field:
        arrows = field.get(ARROWS)
    return arrows if arrows is not None and arrows.parent == field and scene in arrows.users_scene else None


def lacks_arrows(obj: Any) -> bool:
    """Whether an object is a wind without its take that has no arrows yet: one from the library, or a copy of one."""
    if not is_field(obj) or not has_wind(obj) or obj.get("seeing_wind_take") or obj.library is not None or obj.override_library is not None:
        return False
    arrows = obj.get(ARROWS)
    return ARROWS not in obj or (arrows is not None and arrows.parent != obj)


def has_lost_field(obj: Any, scene: Any) -> bool:
    """Whether an object belonged to a field that has been deleted: arrows or values of a wind from the library, values of a copy, or the
    companion that slows what moves in a wind."""
    if obj.library is None and SLOWS in obj:
        return obj[SLOWS] is None or scene not in obj[SLOWS].users_scene
    if obj.library is not None or not (obj.get(ARROWS) is True or WITH_FIELD in obj):
        return False
    return obj.parent is None or scene not in obj.parent.users_scene


def is_field(obj: Any) -> bool:
    """Whether an object is a recovered field: from this scene's own Recover, appended, or linked."""
    return obj is not None and "seeing_wind_density" in obj and obj.field is not None and obj.field.type == "TEXTURE"


def home_of(field: Any, scene: Any) -> Any:
    """The collection for objects that belong to a field object: a local one of the field's that does not merely select effectors."""
    return next((each for each in field.users_collection if each.library is None and FELT not in each), scene.collection)


def field_at_hand(context: Any) -> Any:
    """The field among the active and selected objects, else the scene's own; None if there is none."""
    # while Blender runs a startup script there is no window yet, and the context has no selection
    selected = (getattr(context, "active_object", None), *getattr(context, "selected_objects", ()))
    candidates = (*selected, context.scene.seeing_wind.field_object)
    return next((obj for obj in candidates if is_field(obj)), None)


def out_of_time(scene: Any) -> list[Any]:
    """Outdated calibrations: those made when the field was of the other kind, and those of rigid bodies made at another frame rate.

    Other solvers apply a field per frame, so that their calibration does not depend on the frame rate.
    """
    fps = frames_per_second(scene)
    listed = (each for each in scene.seeing_wind.calibrations if each.object is not None and each.field is not None)
    return [
        each for each in listed
        if each.wind != is_wind(each.field) or (each.object.rigid_body is not None and abs(each.fps - fps) > 1e-3 * fps)
    ]  # fmt: skip


def openvdb_available() -> bool:
    """Whether OpenVDB's Python module exists: it does in Blender's own builds, not in the `bpy` wheels."""
    return importlib.util.find_spec("openvdb") is not None
